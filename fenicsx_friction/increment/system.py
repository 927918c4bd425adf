# SPDX-License-Identifier: MIT
"""The system of equations: the user's bulk residual with contact rows beside it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import zip_longest

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, mesh

from ..base.collective import on_all_ranks
from ..base.errors import ContactInputError
from ..base.literals import lifted_form
from ..certificate.certificate import Certificate, certify
from ..certificate.nodal_state import NodalState
from ..contact.contact import Contact
from ..equations.balance import Balance
from ..equations.body_equation import bodies_of
from ..equations.conditions import missed_values
from ..equations.contact_terms import ContactTerms
from ..equations.floating import FloatingBodies
from ..equations.forces import ForceScales
from ..equations.lost_loads import worst_of_lost_loads
from ..equations.numbering import num_owned
from ..equations.stiffness import Stiffness
from ..solvers.condensing import solvers_of
from ..solvers.options import SolverOptions
from ..solvers.report import SubstepReport
from ..solvers.substep import Substep, substeps
from ..surfaces.measures import share_facet_data
from . import set_up
from .report import ContactReport
from .settings import StepSettings, settings_of
from .totals import total


class ContactSystem:
    """The equations of a problem: assembles, certifies and commits; all methods are collective.

    Args:
        blocks: Bulk residuals in UFL, the momentum balance first.
        unknowns: Their unknowns, displacement first.
        contacts: The contacts.
        bcs: Dirichlet conditions on the unknowns.
        options: Options of the solvers.
        entity_maps: Entity maps of further meshes in ``blocks``; those of the contacts are added.
        settings: How a step is solved.

    Attributes:
        u, u_old: The displacement, now and at the last accepted step.
        contacts: The contacts; ``contact.c`` are the multipliers.
        bodies: The rigid bodies that carry loads; their motions are the last of ``unknowns``.
        dt: Length of the step (s), a Constant; only laws with rates need it.
        rates: Changes of unknowns and multipliers in the last accepted step, over its length.
        num_steps: Number of accepted steps.
        monitor: Called with each :class:`~fenicsx_friction.SubstepReport`, or ``None``.
        terms: How contact enters the equations.
        balance: Assembles the rows of the equations.
        constrained_dofs: Dofs of ``u`` under a boundary condition (local, unrolled).
        scales: Measures residuals by the forces of each body and contact.
        bulk, stiffness: The momentum balance without contact, and its derivative.
        floating: The deformable bodies that conditions do not hold.
        solvers: What the substeps share: forms, matrices and linear solvers.
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
        options: SolverOptions,
        entity_maps: Sequence[mesh.EntityMap] | None,
        settings: StepSettings,
    ) -> None:
        self.contacts, self.bcs, self.bodies = list(contacts), list(bcs), bodies_of(contacts)
        self.unknowns = [*unknowns, *(body.q for body in self.bodies)]
        self.u = self.unknowns[0]
        V, self.comm = self.u.function_space, self.u.function_space.mesh.comm
        self.u_old = fem.Function(V, name="u_old")
        self.u_old.x.array[:] = self.u.x.array
        self.num_steps, self._settings = 0, settings
        self.monitor: Callable[[SubstepReport], None] | None = None
        self._xi, self._eps = (fem.Constant(V.mesh, default_scalar_type(0.0)) for _ in range(2))
        self._ramp_sign = fem.Constant(V.mesh, default_scalar_type(self.settings.ramp_sign))
        self.dt = fem.Constant(V.mesh, default_scalar_type(1.0))
        with set_up.unbound_on_error(self.contacts):
            self._set_up(blocks, options, entity_maps)
            self._motions = set_up.claim_motions(self.contacts, self)

    def _set_up(
        self,
        blocks: list[ufl.Form],
        options: SolverOptions,
        entity_maps: Sequence[mesh.EntityMap] | None,
    ) -> None:
        """Bind the contacts and make forms, scales and substeps."""
        V, surfaces = self.u.function_space, [k.surface for k in self.contacts]
        self._entity_maps = [*(entity_maps or []), *(s.entity_map for s in surfaces)]
        blocks = [lifted_form(f) for f in share_facet_data(blocks)]
        blocks += [body.residual() for body in self.bodies]
        self.bulk = blocks[0]
        self.stiffness = Stiffness(self.bulk, self.u, self._entity_maps)
        stiffness, tangent = set_up.stiffness_of(self.stiffness, V)
        given = (self.dt, self.settings.normal, self.bcs, stiffness, tangent)
        set_up.set_up_contacts(self.contacts, (self.u, self.u_old), *given)
        self.floating = FloatingBodies(self.u, self.bcs)
        self.constrained_dofs = self.floating.held
        self.state = [*self.unknowns, *(k.c for k in self.contacts)]
        self.rates = set_up.rates_of(self.unknowns, self.bodies, self.contacts)
        self.terms = ContactTerms(self.contacts, self.state, self.bcs)
        number, maps = len(self.bodies), self._entity_maps
        self.balance = Balance(blocks, self.unknowns, self.terms, number, maps)
        arguments = (self.unknowns, self.bcs, stiffness, self._entity_maps, self.contacts)
        self.scales = ForceScales(
            self.unknowns,
            self.contacts,
            self.bcs,
            stiffness.x.array[: num_owned(stiffness)].copy(),
            set_up.further_equations(blocks[1:], *arguments),
            self.terms,
            self.balance,
            self.floating,
        )
        self.solvers = solvers_of(
            blocks,
            self.unknowns,
            self.contacts,
            self.bcs,
            self._entity_maps,
            options,
            self.scales,
            self.terms,
            self.balance.without_contact,
            tangent,
        )
        parts = (options.prefix, self.solvers, self._eps, self._xi, self._ramp_sign)
        self.stick, self.slip, self.projection = substeps(*parts)

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

    def nodal_states(self) -> list[NodalState]:
        """Return the nodal values of each contact on this rank."""
        return [k.present() for k in self.contacts]

    def certify(self) -> Certificate:
        """Certify the current values of the unknowns as a solution of the increment."""
        certificate = self._certify()
        if not certificate.excess <= 1.0:
            self.scales.find_noise()
            certificate = self._certify()
        return self._with_loads(certificate) if certificate.solved else certificate

    def _with_loads(self, certificate: Certificate) -> Certificate:
        """Return the certificate that also knows of loads that rounding hides."""
        lost = worst_of_lost_loads(self.scales, self.balance, self.settings.tolerance)
        return replace(certificate, resolution=lost, drowned=True) if lost > 0.0 else certificate

    def _certify(self) -> Certificate:
        """Certify the current values with the rounding errors measured so far."""
        states = self.nodal_states()
        momentum, *others = self.balance.rows()
        found = self.scales.residuals(momentum, *others)
        equations = self.scales.equilibrium
        pushed = max(k.pushed(s) for k, s in zip(self.contacts, states, strict=True))
        return certify(
            self.comm,
            states,
            surfaces=self.scales.surfaces,
            scales=self.scales.scales(momentum),
            unbalanced=(found[0][equations], found[1][equations]),
            boundary=missed_values(self.unknowns, self.bcs),
            pushed=self.comm.allreduce(pushed, MPI.MAX),
            tolerance=self.settings.tolerance,
        )

    def contact_reports(self) -> tuple[ContactReport, ...]:
        """Total the nodal values of each contact over all ranks."""
        return tuple(map(total, self.contacts, self.nodal_states()))

    def commit(self) -> None:
        """Make the current values the history of the next step."""
        for k in self.contacts:
            k.commit()
        for motion in self._motions:
            motion.commit()
        self.u_old.x.array[:] = self.u.x.array
        self.num_steps += 1
