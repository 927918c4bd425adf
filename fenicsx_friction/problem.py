# SPDX-License-Identifier: MIT
"""The frictional contact problem: the user's bulk residual with contact rows beside it."""

from collections.abc import Callable, Mapping, Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, mesh
from dolfinx.fem.petsc import assemble_matrix
from dolfinx.la import InsertMode
from ufl.core.expr import Expr

from . import step
from .certificate import OPEN, SLIP, STICK, Certificate, NodalState, certify
from .checks import check_problem
from .conditions import constrained_dofs, with_conditions
from .contact import Contact
from .coupling import Coupling
from .errors import ContactInputError
from .measures import share_facet_data
from .report import ContactReport, StepReport
from .settings import StepSettings
from .sides import check_sides
from .substep import Substep, SubstepReport


class FrictionalContactProblem:
    """Quasi-static Signorini contact with friction, one certified increment a :meth:`solve`.

    Args:
        F: Bulk residual in UFL (internal minus external forces) without contact terms, or a
            sequence of blocks whose first is the momentum balance.
        u: Displacement, or a sequence of unknowns whose first is the displacement.
        contact: The contacts.
        bcs: Dirichlet conditions on the unknowns.
        petsc_options_prefix: Unique prefix; the substeps add ``stick_``, ``slip_`` and
            ``projection_``.
        petsc_options: PETSc options for all substeps.
        entity_maps: Entity maps of further meshes in ``F``; those of the contacts are added.
        settings: How a step is solved.

    Attributes:
        u: The displacement.
        u_old: The displacement of the last accepted step.
        contacts: The contacts; ``contact.c`` are the multipliers.
        dt: Length of the step (s), ``fem.Constant``; only rate-dependent laws need it.
        num_steps: Number of accepted steps.
        accepted: Nodal values of each contact (this rank's nodes) in the last accepted step.
        monitor: Called with each :class:`~fenicsx_friction.substep.SubstepReport`, or ``None``.
        coupling: The pairs of contacts with deformable obstacles, or ``None`` without any.
        constrained_dofs: Dofs of ``u`` under a boundary condition (local, unrolled).
        bulk: The momentum balance without contact, ready to be assembled.
        stick: The stick predictor, eq. (14).
        slip: The slip corrector, eq. (15).
        projection: The natural map.
    """

    def __init__(
        self,
        F: ufl.Form | Sequence[ufl.Form],
        u: fem.Function | Sequence[fem.Function],
        *,
        contact: Contact | Sequence[Contact],
        petsc_options_prefix: str,
        bcs: Sequence[fem.DirichletBC] | None = None,
        petsc_options: Mapping[str, object] | None = None,
        entity_maps: Sequence[mesh.EntityMap] | None = None,
        settings: StepSettings | None = None,
    ) -> None:
        blocks = [F] if isinstance(F, ufl.Form) else list(F)
        self.unknowns = [u] if isinstance(u, fem.Function) else list(u)
        self.contacts = [contact] if isinstance(contact, Contact) else list(contact)
        self.settings = settings or StepSettings()
        self.bcs = list(bcs or [])
        self.u = self.unknowns[0]
        check_problem(blocks, self.unknowns, self.contacts, petsc_options_prefix)
        V = self.u.function_space
        self.comm: MPI.Intracomm = V.mesh.comm
        self.u_old = fem.Function(V, name="u_old")
        self.u_old.x.array[:] = self.u.x.array
        self.num_steps = 0
        self.accepted: list[NodalState] = []
        self.monitor: Callable[[SubstepReport], None] | None = None
        self._xi = fem.Constant(V.mesh, default_scalar_type(0.0))
        self._eps = fem.Constant(V.mesh, default_scalar_type(0.0))
        self.dt = fem.Constant(V.mesh, default_scalar_type(1.0))

        self._entity_maps = [*(entity_maps or []), *(k.surface.entity_map for k in self.contacts)]
        blocks, measures = share_facet_data(blocks, [k.surface for k in self.contacts])
        self._set_up_contacts(blocks[0])
        self.bulk = blocks[0]
        self._momentum = self.bulk - sum(
            ufl.inner(k.kinematics.traction(k.c), blocks[0].arguments()[0]) * ds
            for k, ds in zip(self.contacts, measures, strict=True)
        )
        self._momentum_form = fem.form(self._momentum, entity_maps=self._entity_maps)
        self._bulk_form = fem.form(self.bulk, entity_maps=self._entity_maps)
        self.constrained_dofs = constrained_dofs(V, self.bcs)
        self.state = [*self.unknowns, *(k.c for k in self.contacts)]

        pins, deformable = [*self.bcs, *self._pins], [k.obstacle.deformable for k in self.contacts]
        self.coupling = Coupling(self.contacts, self.state, pins) if any(deformable) else None

        def substep(name: str, rows: Callable[[Contact], Expr]) -> Substep:
            """Make the substep whose contact rows are ``rows(contact)``."""
            tests = [ufl.TestFunction(k.surface.Q) for k in self.contacts]
            equations = [
                ufl.inner(rows(k), q) * ds
                for k, q, ds in zip(self.contacts, tests, measures, strict=True)
            ]
            return Substep(
                name,
                [self._momentum, *blocks[1:], *equations],
                self.state,
                pins,
                petsc_options_prefix,
                petsc_options,
                self._entity_maps,
                self.coupling,
                rows,
            )

        sign = float(self.settings.ramp_sign)
        eps, xi = self._eps, self._xi  # not self: no reference cycle, see Substep.problem
        self.stick = substep("stick", lambda k: k.stick_rows(eps))
        self.slip = substep("slip", lambda k: k.slip_rows(eps, xi, sign))
        self.projection = substep("projection", lambda k: k.projection_rows(eps, xi))

    def solve(self) -> StepReport:
        """Solve one increment to the current loads, certify it and commit it.

        Returns:
            The report of the accepted step.

        Raises:
            StepFailed: If no certified solution was found; the state is the last accepted one.
        """
        return step.advance(self)

    # -- what the step is made of ----------------------------------------------------------

    def run(
        self,
        substep: Substep,
        tolerance: float,
        *,
        xi: float = 0.0,
        eps: float = 0.0,
        line_search: str | None = None,
        max_it: int | None = None,
        target: PETSc.Vec | None = None,
    ) -> SubstepReport:
        """Run one substep at ``xi`` and ``eps`` (Pa) and tell the monitor."""
        self._xi.value, self._eps.value = np.asarray(xi), np.asarray(eps)
        report = substep.solve(
            tolerance, xi=xi, eps=eps, line_search=line_search, max_it=max_it, target=target
        )
        if self.monitor is not None:
            self.monitor(report)
        return report

    def assemble_momentum(self) -> np.ndarray:
        """Return the unbalanced nodal forces (N), reactions at prescribed dofs; owned dofs."""
        if self.coupling is None:
            return assemble_owned(self._momentum_form)
        reaction = self.coupling.momentum()  # updates the kinematics in the form
        return assemble_owned(self._momentum_form) + reaction

    def assemble_bulk(self) -> np.ndarray:
        """Return the nodal forces (N) without those of contact; owned dofs."""
        return assemble_owned(self._bulk_form)

    def stiffness_force(self) -> float:
        """Return the largest stiffness times displacement (N) of the contact nodes."""
        local = [np.max(k.stiffness_force(), initial=0.0) for k in self.contacts]
        return float(self.comm.allreduce(max(local), MPI.MAX))

    def nodal_states(self) -> list[NodalState]:
        """Return the nodal values of each contact on this rank."""
        return [k.nodal() for k in self.contacts]

    def certify(self, step_force: float = 0.0) -> Certificate:
        """Certify the current values of the unknowns as a solution of the increment.

        Args:
            step_force: Force of the start of the step (N): the largest unbalanced one, which
                sets the scale of a step that releases all contact.
        """
        states = self.nodal_states()
        force = abs(self.assemble_momentum())
        free = np.setdiff1d(np.arange(len(force)), self.constrained_dofs)
        largest = max(
            [np.max(force, initial=0.0), step_force]
            + [np.max(s.area * np.linalg.norm(s.c, axis=1), initial=0.0) for s in states]
        )
        return certify(
            self.comm,
            states,
            equilibrium=self.comm.allreduce(np.max(force[free], initial=0.0), MPI.MAX),
            force_scale=self.comm.allreduce(largest, MPI.MAX),
            rounding=float(np.finfo(float).eps) * self.stiffness_force(),
            boundary=self._missed_boundary_values(),
            tolerance=self.settings.tolerance,
        )

    def _missed_boundary_values(self) -> float:
        """Return how far the unknowns are from their Dirichlet values, relative."""
        worst = 0.0
        for f in self.unknowns:
            values = with_conditions(f, self.bcs)
            # Not a number on one rank is infinite on all.
            local = [np.max(abs(a), initial=0.0) for a in (values - f.x.array, values)]
            local = np.nan_to_num(local, nan=np.inf)
            missed, largest = (self.comm.allreduce(float(a), MPI.MAX) for a in local)
            worst = max(worst, missed / largest if 0.0 < largest < np.inf else missed)
        return worst

    def contact_reports(self) -> tuple[ContactReport, ...]:
        """Total the nodal values of each contact over all ranks."""
        reports = []
        for k, state in zip(self.contacts, self.nodal_states(), strict=True):
            counts = np.bincount(state.states()[state.takes_part], minlength=3)
            forces = state.area[:, None] * k.nodal_traction()
            force, moment = forces.sum(axis=0), _moment(k.nodal_position(), forces)
            work = -np.einsum("i,ij,ij->", state.area, state.c[:, 1:], state.slip)
            total = self.comm.allreduce(np.array([*counts, *force, *moment, work]), MPI.SUM)
            reports.append(
                ContactReport(
                    name=k.surface.name,
                    open=int(total[OPEN]),
                    stick=int(total[STICK]),
                    slip=int(total[SLIP]),
                    force=tuple(total[3 : 3 + len(force)].tolist()),
                    moment=tuple(total[3 + len(force) : -1].tolist()),
                    dissipation=float(total[-1]),
                )
            )
        return tuple(reports)

    def commit(self) -> None:
        """Make the current values the history of the next step."""
        self.accepted = self.nodal_states()
        for k in self.contacts:
            k.commit()
        for motion in {id(k.obstacle.motion): k.obstacle.motion for k in self.contacts}.values():
            if motion is not None:
                motion.commit()
        self.u_old.x.array[:] = self.u.x.array
        self.num_steps += 1

    # -- set-up ------------------------------------------------------------------------------

    def _set_up_contacts(self, bulk: ufl.Form) -> None:
        """Derive kinematics, scales and prescribed directions of the contacts."""
        V = self.u.function_space
        tangent = fem.form(ufl.derivative(bulk, self.u), entity_maps=self._entity_maps)
        matrix = assemble_matrix(tangent)
        matrix.assemble()
        diagonal = fem.Function(V)
        diagonal.x.array[: matrix.getLocalSize()[0]] = matrix.getDiagonal().array
        diagonal.x.scatter_forward()
        matrix.destroy()
        self._pins: list[fem.DirichletBC] = []
        for k in self.contacts:
            k.bind(self.u, self.u_old, self.dt, self.settings.normal)
            check_sides(k, self.u)
            k.set_scale(diagonal)
            self._pins += k.pin_prescribed(V, self.bcs)
        lowest = min(np.min(k.r.x.array, initial=np.inf) for k in self.contacts)
        if not self.comm.allreduce(lowest, MPI.MIN) > 0.0:
            raise ContactInputError(
                "The bulk residual has no positive stiffness at some contact node; check F, its "
                "sign (internal minus external forces) and the initial u, or give Contact(r_p=...)."
            )


def _moment(x: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Return the moment of nodal forces about the origin; about ``z`` alone in 2D."""
    if x.shape[1] == 2:
        return np.array([np.sum(x[:, 0] * forces[:, 1] - x[:, 1] * forces[:, 0])])
    return np.cross(x, forces).sum(axis=0)


def assemble_owned(form: fem.Form) -> np.ndarray:
    """Assemble a linear form and return the values of the owned dofs."""
    vector = fem.assemble_vector(form)
    vector.scatter_reverse(InsertMode.add)
    return np.asarray(vector.array[: vector.index_map.size_local * vector.block_size])
