# SPDX-License-Identifier: MIT
"""The system of equations: the user's bulk residual with contact rows beside it."""

import weakref
from collections.abc import Callable, Mapping, Sequence
from itertools import zip_longest
from typing import TypeVar

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import default_scalar_type, fem, mesh
from dolfinx.fem.petsc import assemble_matrix
from dolfinx.la import InsertMode

from ..base.collective import on_all_ranks
from ..base.compilation import compiled
from ..base.errors import ContactInputError
from ..base.literals import lifted
from ..certificate.certificate import Certificate, certify
from ..certificate.nodal_state import OPEN, SLIP, STICK, NodalState
from ..contact.checks import check_normals
from ..contact.contact import Contact
from ..contact.sides import check_sides
from ..surfaces.measures import share_facet_data
from .conditions import constrained, constrained_dofs, with_conditions
from .contact_terms import ContactTerms
from .equations import FurtherEquation
from .forces import ForceScales
from .newton import Newton
from .report import ContactReport, SubstepReport
from .settings import StepSettings, settings_of
from .substep import Substep

#: Where a node sticks in several contacts, its multipliers are redundant: pivots vanish. With this
#: option MUMPS takes one of the solutions.
REDUNDANT: dict[str, object] = {"mat_mumps_icntl_24": 1}

T = TypeVar("T")


class ContactSystem:
    """The equations of a problem: assembles, certifies and commits; all methods are collective.

    Args:
        blocks: Bulk residuals in UFL, the momentum balance first.
        unknowns: Their unknowns, displacement first.
        contacts: The contacts.
        bcs: Dirichlet conditions on the unknowns.
        prefix: Prefix of PETSc options.
        options: PETSc options for all substeps.
        entity_maps: Entity maps of further meshes in ``blocks``; those of the contacts are added.
        settings: How a step is solved.

    Attributes:
        u: The displacement.
        u_old: The displacement of the last accepted step.
        contacts: The contacts; ``contact.c`` are the multipliers.
        dt: Length of the step (s), ``fem.Constant``; only rate-dependent laws need it.
        num_steps: Number of accepted steps.
        monitor: Called with each :class:`~fenicsx_friction.SubstepReport`, or ``None``.
        terms: How contact enters the equations.
        constrained_dofs: Dofs of ``u`` under a boundary condition (local, unrolled).
        scales: Measures residuals by the forces of each body and contact.
        bulk: The momentum balance without contact, ready to be assembled.
        newton: What the substeps share: forms, matrix and linear solver.
        stick: The stick predictor, eq. (14).
        slip: The slip corrector, eq. (15).
        projection: The natural map.
    """

    def __init__(
        self,
        blocks: list[ufl.Form],
        unknowns: Sequence[fem.Function],
        contacts: Sequence[Contact],
        bcs: Sequence[fem.DirichletBC],
        prefix: str,
        options: Mapping[str, object] | None,
        entity_maps: Sequence[mesh.EntityMap] | None,
        settings: StepSettings,
    ) -> None:
        self.unknowns, self.contacts, self.bcs = list(unknowns), list(contacts), list(bcs)
        self._settings = settings
        self.u = self.unknowns[0]
        V = self.u.function_space
        self.comm: MPI.Intracomm = V.mesh.comm
        self.u_old = fem.Function(V, name="u_old")
        self.u_old.x.array[:] = self.u.x.array
        self.num_steps = 0
        self.monitor: Callable[[SubstepReport], None] | None = None
        self._xi = fem.Constant(V.mesh, default_scalar_type(0.0))
        self._eps = fem.Constant(V.mesh, default_scalar_type(0.0))
        self._ramp_sign = fem.Constant(V.mesh, default_scalar_type(self.settings.ramp_sign))
        self.dt = fem.Constant(V.mesh, default_scalar_type(1.0))
        kept = [(k, dict(vars(k))) for k in self.contacts]
        try:
            self._set_up(blocks, prefix, options, entity_maps)
        except BaseException:
            for part, attributes in kept:
                vars(part).clear()
                vars(part).update(attributes)
            raise

    def _set_up(
        self,
        blocks: list[ufl.Form],
        prefix: str,
        options: Mapping[str, object] | None,
        entity_maps: Sequence[mesh.EntityMap] | None,
    ) -> None:
        """Bind the contacts and make forms, scales and substeps."""
        surfaces = [k.surface for k in self.contacts]
        self._entity_maps = [*(entity_maps or []), *(s.entity_map for s in surfaces)]
        blocks = [lifted(f, self.u.function_space.mesh) for f in share_facet_data(blocks)]
        self.bulk = blocks[0]
        stiffness = self._set_up_contacts()
        self._bulk_form, *self._other_forms = (
            compiled(fem.form, self.comm)(f, entity_maps=self._entity_maps) for f in blocks
        )
        self.constrained_dofs = constrained_dofs(self.u.function_space, self.bcs)
        self.state = [*self.unknowns, *(k.c for k in self.contacts)]
        self.terms = ContactTerms(self.contacts, self.state, self.bcs)
        self.scales = ForceScales(
            self.unknowns,
            self.contacts,
            self.bcs,
            stiffness,
            self._further_equations(blocks[1:], stiffness),
            self.terms,
            _weakly(self, lambda there: there.assemble_momentum()),
            _weakly(self, lambda there: [there.assemble_momentum(), *there.assemble_others()]),
        )
        if _share_nodes(self.contacts, self.comm):
            options = {**REDUNDANT, **(options or {})}
        forms = [*blocks, *(_place(k) for k in self.contacts)]
        arguments = (prefix, options, self._entity_maps, self.scales, self.terms)
        self.newton = newton = Newton(forms, self.state, self.bcs, *arguments)
        eps, xi, sign = self._eps, self._xi, self._ramp_sign  # not self: no reference cycle
        self.stick = Substep("stick", prefix, newton, lambda k: k.rows.stick(eps))
        self.slip = Substep("slip", prefix, newton, lambda k: k.rows.slip(eps, xi, sign))
        self.projection = Substep(
            "projection", prefix, newton, lambda k: k.rows.projection(eps, xi)
        )

    @property
    def settings(self) -> StepSettings:
        """How a step is solved; may be replaced between steps, but for ``normal``."""
        return self._settings

    @settings.setter
    def settings(self, settings: StepSettings) -> None:
        settings = settings_of(settings)
        if settings.normal != self._settings.normal:
            raise ContactInputError(
                f"settings.normal = {settings.normal!r}: the rows were made with "
                f"{self._settings.normal!r}; make another problem."
            )
        self._settings = settings

    @property
    def accepted(self) -> list[NodalState]:
        """Nodal values of each contact (this rank's nodes) in the last accepted step, if any."""
        return [k.accepted for k in self.contacts if k.accepted is not None]

    @accepted.setter
    def accepted(self, states: Sequence[NodalState]) -> None:
        for k, nodal in zip_longest(self.contacts, states):
            k.accepted = nodal

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
        self.set_smoothing(xi=xi, eps=eps)
        report = substep.solve(
            tolerance, xi=xi, eps=eps, line_search=line_search, max_it=max_it, target=target
        )
        if (monitor := self.monitor) is not None:
            on_all_ranks(self.comm, lambda: monitor(report))
        return report

    def set_smoothing(self, *, xi: float, eps: float) -> None:
        """Set ``xi`` and ``eps`` (Pa) of the rows."""
        self._xi.value, self._eps.value = np.asarray(xi), np.asarray(eps)
        self._ramp_sign.value = np.asarray(float(self.settings.ramp_sign))

    def assemble_momentum(self) -> np.ndarray:
        """Return the unbalanced nodal forces (N), reactions at prescribed dofs; owned dofs."""
        return assemble_owned(self._bulk_form) + self.terms.momentum()

    def assemble_bulk(self) -> np.ndarray:
        """Return the nodal forces (N) without those of contact; owned dofs."""
        return assemble_owned(self._bulk_form)

    def assemble_others(self) -> list[np.ndarray]:
        """Return the rows of the equations beside the momentum balance; owned dofs."""
        return [assemble_owned(form) for form in self._other_forms]

    def nodal_states(self) -> list[NodalState]:
        """Return the nodal values of each contact on this rank."""
        return [k.present() for k in self.contacts]

    def certify(self) -> Certificate:
        """Certify the current values of the unknowns as a solution of the increment."""
        certificate = self._certify()
        if not certificate.excess <= 1.0:
            self.scales.find_noise()
            certificate = self._certify()
        return certificate

    def _certify(self) -> Certificate:
        """Certify the current values with the rounding errors measured so far."""
        states = self.nodal_states()
        found = self.scales.residuals(self.assemble_momentum(), *self.assemble_others())
        equations = self.scales.equilibrium
        pushed = max(k.pushed(s) for k, s in zip(self.contacts, states, strict=True))
        return certify(
            self.comm,
            states,
            surfaces=self.scales.surfaces,
            scales=self.scales.scales(),
            unbalanced=(found[0][equations], found[1][equations]),
            boundary=self._missed_boundary_values(),
            pushed=self.comm.allreduce(pushed, MPI.MAX),
            tolerance=self.settings.tolerance,
        )

    def _missed_boundary_values(self) -> float:
        """Return how far the unknowns are from their Dirichlet values, relative."""
        worst = 0.0
        for f in self.unknowns:
            values = with_conditions(f, self.bcs)
            # NaN on one rank becomes infinite on all.
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
            force, moment = forces.sum(axis=0), _moment(k.pairing.positions(), forces)
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
        for k in self.contacts:
            k.commit()
        for motion in {id(k.obstacle.motion): k.obstacle.motion for k in self.contacts}.values():
            if motion is not None:
                motion.commit()
        self.u_old.x.array[:] = self.u.x.array
        self.num_steps += 1

    # -- set-up ------------------------------------------------------------------------------

    def _further_equations(
        self, blocks: Sequence[ufl.Form], stiffness: npt.NDArray[np.floating]
    ) -> list[FurtherEquation]:
        """Return the equations beside the momentum balance; collective."""
        stiffest = self.comm.allreduce(float(np.max(abs(stiffness), initial=0.0)), MPI.MAX)
        return [
            FurtherEquation(block, unknown, self.unknowns, stiffest, self.bcs, self._entity_maps)
            for block, unknown in zip(blocks, self.unknowns[1:], strict=True)
        ]

    def _set_up_contacts(self) -> npt.NDArray[np.floating]:
        """Derive kinematics, scales and prescribed directions of the contacts.

        Returns:
            The diagonal of the bulk stiffness (N/m) at the owned dofs.
        """
        V = self.u.function_space
        form = compiled(fem.form, self.comm)
        tangent = form(ufl.derivative(self.bulk, self.u), entity_maps=self._entity_maps)
        matrix = assemble_matrix(tangent)
        matrix.assemble()
        diagonal, owned = fem.Function(V), matrix.getLocalSize()[0]
        diagonal.x.array[:owned] = matrix.getDiagonal().array
        diagonal.x.scatter_forward()
        matrix.destroy()
        held = constrained(V, self.bcs)
        for k in self.contacts:
            k.bind(self.u, self.u_old, self.dt, self.settings.normal)
            check_normals(k)
            check_sides(k)
            k.set_scale(diagonal)
        lowest = min(np.min(k.scale.x.array, initial=np.inf) for k in self.contacts)
        if not self.comm.allreduce(lowest, MPI.MIN) > 0.0:
            raise ContactInputError(
                "The bulk residual has no positive stiffness at some contact node; check F, its "
                "sign (internal minus external forces) and the initial u."
            )
        for k in self.contacts:
            k.hold(held)
        return diagonal.x.array[:owned].copy()


def _moment(x: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Return the moment of nodal forces about the origin; about ``z`` alone in 2D."""
    if x.shape[1] == 2:
        return np.array([np.sum(x[:, 0] * forces[:, 1] - x[:, 1] * forces[:, 0])])
    return np.cross(x, forces).sum(axis=0)


def _place(contact: Contact) -> ufl.Form:
    """Return an empty form that keeps the place of the rows of contact; no form assembles them."""
    nothing = fem.Constant(contact.surface.mesh, default_scalar_type(0.0))
    q = ufl.TestFunction(contact.surface.Q)
    return nothing * ufl.inner(contact.c, q) * contact.surface.measure()


def _share_nodes(contacts: Sequence[Contact], comm: MPI.Intracomm) -> bool:
    """Tell whether a node belongs to several contacts; collective."""
    nodes = np.concatenate([np.unique(k.parent_dofs) for k in contacts])
    return bool(comm.allreduce(len(np.unique(nodes)) < len(nodes), MPI.LOR))


def _weakly(system: ContactSystem, work: Callable[[ContactSystem], T]) -> Callable[[], T]:
    """Return a call of work on a system, without a reference cycle, see ``Callbacks``."""
    there = weakref.ref(system)
    return lambda: work(there())  # type: ignore[arg-type]


def assemble_owned(form: fem.Form) -> np.ndarray:
    """Assemble a linear form and return the values of the owned dofs."""
    vector = fem.assemble_vector(form)
    vector.scatter_reverse(InsertMode.add)
    return np.asarray(vector.array[: vector.index_map.size_local * vector.block_size])
