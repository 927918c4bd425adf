# SPDX-License-Identifier: MIT
"""The frictional contact problem: takes the user's arguments, solves increments."""

from collections.abc import Mapping, Sequence

import ufl
from dolfinx import fem, mesh

from .base.validators import choice
from .contact.contact import Contact
from .equations import checks
from .increment.advance import advance
from .increment.report import StepReport
from .increment.settings import StepSettings, settings_of
from .increment.system import ContactSystem
from .solvers.choice import LinearSolver
from .solvers.options import SolverOptions


class FrictionalContactProblem(ContactSystem):
    """Quasi-static Signorini contact with friction, one certified increment a ``solve()``.

    Args:
        F: Bulk residual in UFL (internal minus external forces) without contact terms, or a
            sequence of blocks whose first is the momentum balance. Blocks may contain the tractions
            ``contact.c``, for instance in the heat of friction.
        u: Displacement, or a sequence of unknowns whose first is the displacement.
        contact: The contacts.
        bcs: Dirichlet conditions on the unknowns.
        petsc_options_prefix: Unique prefix; the substeps add ``stick_``, ``slip_`` and
            ``projection_``.
        petsc_options: PETSc options for all substeps.
        entity_maps: Entity maps of further meshes in ``F``; those of the contacts are added.
        linear_solver: What solves the linear systems: ``"direct"``, a factorisation by MUMPS;
            ``"multigrid"``, GMRES with algebraic multigrid, for large models in 3D; ``"auto"``, one
            or the other by size. See docs/solvers.md.
        settings: How a step is solved.

    Attributes:
        u: The displacement.
        u_old: The displacement of the last accepted step.
        unknowns: All unknowns; the motions of rigid bodies are the last.
        contacts: The contacts; ``contact.c`` are the tractions.
        bodies: The rigid bodies that carry loads.
        dt: Length of the step (s), a Constant; only laws with rates need it.
        num_steps: Number of accepted steps.
        comm: The communicator.
        monitor: Called with each :class:`~fenicsx_friction.SubstepReport`, or ``None``.

    Raises:
        ContactInputError: For arguments that cannot make a contact problem; the contacts are free
            for another one.
    """

    def __init__(
        self,
        F: ufl.Form | Sequence[ufl.Form],
        u: fem.Function | Sequence[fem.Function],
        *,
        contact: Contact | Sequence[Contact],
        petsc_options_prefix: str,
        bcs: fem.DirichletBC | Sequence[fem.DirichletBC] | None = None,
        petsc_options: Mapping[str, object] | None = None,
        entity_maps: Sequence[mesh.EntityMap] | None = None,
        linear_solver: LinearSolver = "auto",
        settings: StepSettings | None = None,
    ) -> None:
        blocks, unknowns = checks.residuals(F), checks.functions(u)
        contacts, conditions = checks.contacts_of(contact), checks.conditions(bcs)
        how, parts = settings_of(settings), (blocks, unknowns, contacts, conditions)
        checks.check_problem(*parts, petsc_options_prefix, petsc_options, entity_maps)
        choice(linear_solver, "linear_solver", ("auto", "direct", "multigrid"))
        options = SolverOptions(petsc_options_prefix, petsc_options or {}, linear_solver)
        super().__init__(*parts, options, entity_maps, how)

    def solve(self) -> StepReport:
        """Solve one increment to the current loads, certify it and commit it.

        Returns:
            The report of the accepted step.

        Raises:
            StepFailed: If no certified solution was found; the state is the last accepted one.
        """
        return advance(self)
