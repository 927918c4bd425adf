# SPDX-License-Identifier: MIT
"""What a step reports."""

from __future__ import annotations

from dataclasses import dataclass

from ..certificate.certificate import Certificate
from ..solvers.report import SubstepReport


@dataclass(frozen=True)
class ContactReport:
    """Totals of one contact after a step.

    Attributes:
        name: Name of the contact surface.
        open: Number of open nodes.
        stick: Number of sticking nodes.
        slip: Number of slipping nodes.
        force: Contact force on the body in global axes (N, per unit depth in 2D). Of rings, the
            radial one is the integral of radial tractions, whose resultant vanishes.
        normal_force: Sum of the normal forces of its nodes (N), positive in compression. Unlike
            those of ``force``, they do not cancel, as on a surface that meets itself.
        moment: Moment of the contact force about the origin (N m), about ``z`` alone in 2D.
        dissipation: Frictional work of the step (J), each node's at least zero.
        penetration: Largest penetration of a point (m): of the nodes; for displacements with dofs
            on edges or faces, whose nodes meet the obstacle on average, of all points and corners.
    """

    name: str
    open: int
    stick: int
    slip: int
    force: tuple[float, ...]
    normal_force: float
    moment: tuple[float, ...]
    dissipation: float
    penetration: float


@dataclass(frozen=True)
class BodyReport:
    """Where a rigid body that carries loads is after a step, and what contact does to it.

    Attributes:
        name: Name of the body.
        translation: Translation of its center (m).
        rotation: Angle in 2D, rotation vector in 3D (rad).
        force: Force of all its contacts on the body in global axes (N, per unit depth in 2D).
        moment: Their moment about its center where this is now (N m), about ``z`` alone in 2D.
    """

    name: str
    translation: tuple[float, ...]
    rotation: tuple[float, ...]
    force: tuple[float, ...]
    moment: tuple[float, ...]


@dataclass(frozen=True)
class OtherSolution:
    """Another certified solution of a step, which was not taken.

    Attributes:
        contacts: Totals of each contact.
        force_difference: Largest difference of a contact's force from the one taken (N).
        traction_difference: Largest difference of a node's traction (Pa).
    """

    contacts: tuple[ContactReport, ...]
    force_difference: float
    traction_difference: float


@dataclass(frozen=True)
class StepReport:
    """The report of one step.

    Attributes:
        step: Number of the step, 1 for the first accepted one.
        corrector: The corrector that was asked for.
        substeps: All substeps in the order they were solved, failed ones included, until the first
            certified solution.
        contacts: Totals of each contact.
        certificate: The certificate of the final state.
        factorisations: How many bulks were factored for condensed substeps; a full iteration
            factors the whole system.
        others: Further solutions that were found, see ``StepSettings.look_for_others``.
        searched: The substeps of the search for them.
        bodies: The rigid bodies that carry loads.
        solver: ``condensed`` or ``full``, see :class:`SubstepReport`: what led to the final state.
        linear_solver: ``direct`` or ``multigrid``: what solved its linear systems.
        set_ups: How often the levels of multigrid were made.
    """

    step: int
    corrector: str
    substeps: tuple[SubstepReport, ...]
    contacts: tuple[ContactReport, ...]
    certificate: Certificate
    factorisations: int = 0
    solver: str = "full"
    linear_solver: str = "direct"
    set_ups: int = 0
    others: tuple[OtherSolution, ...] = ()
    searched: tuple[SubstepReport, ...] = ()
    bodies: tuple[BodyReport, ...] = ()

    @property
    def iterations(self) -> int:
        """Newton iterations up to the first solution, each one linear solve of any size."""
        return sum(substep.iterations for substep in self.substeps)

    @property
    def krylov(self) -> int:
        """Iterations of the linear solver up to the first solution, none if it is direct."""
        return sum(substep.krylov for substep in self.substeps)

    @property
    def certified(self) -> bool:
        """Whether the state solves the unsmoothed law to the tolerance."""
        return self.certificate.certified
