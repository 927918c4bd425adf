# SPDX-License-Identifier: MIT
"""What a step reports."""

from __future__ import annotations

from dataclasses import dataclass

from ..certificate.certificate import Certificate


@dataclass(frozen=True)
class SubstepReport:
    """How one substep went.

    Attributes:
        name: ``stick``, ``slip`` or ``projection``.
        xi: Blend of the slip rows (0 where they are not used).
        eps: Smoothing of the normal complementarity (Pa).
        iterations: Newton iterations, each one linear solve.
        converged: Whether the residual met its tolerance.
        reason: PETSc's name of the reason, or ``CYCLE``.
        residuals: 2-norms of the residual (N), one an iteration and the initial one, of the last
            try if it was repeated with more memory.
        accepted: Whether the substep's end state was used.
        failure: Why a factorisation failed, in plain words.
        solver: ``full``: an iteration solves the whole system; ``condensed``: a dense system of
            the dofs of the contact surfaces.
    """

    name: str
    xi: float
    eps: float
    iterations: int
    converged: bool
    reason: str
    residuals: tuple[float, ...]
    accepted: bool = True
    failure: str = ""
    solver: str = "full"


@dataclass(frozen=True)
class ContactReport:
    """Totals of one contact after a step.

    Attributes:
        name: Name of the contact surface.
        open: Number of open nodes.
        stick: Number of sticking nodes.
        slip: Number of slipping nodes.
        force: Contact force on the body in global axes (N, per unit depth in 2D).
        moment: Moment of the contact force about the origin (N m), about ``z`` alone in 2D.
        dissipation: Frictional work of the step (J), each node's at least zero.
    """

    name: str
    open: int
    stick: int
    slip: int
    force: tuple[float, ...]
    moment: tuple[float, ...]
    dissipation: float


@dataclass(frozen=True)
class StepReport:
    """The report of one step.

    Attributes:
        step: Number of the step, 1 for the first accepted one.
        corrector: The corrector that was asked for.
        substeps: All substeps in the order they were solved, failed ones included.
        contacts: Totals of each contact.
        certificate: The certificate of the final state.
        factorisations: How many bulks were factored for condensed substeps; a full iteration
            factors the whole system.
        solver: ``condensed`` or ``full``, see :class:`SubstepReport`: what led to the final state.
    """

    step: int
    corrector: str
    substeps: tuple[SubstepReport, ...]
    contacts: tuple[ContactReport, ...]
    certificate: Certificate
    factorisations: int = 0
    solver: str = "full"

    @property
    def iterations(self) -> int:
        """Newton iterations of the step, which is the number of linear solves of any size."""
        return sum(substep.iterations for substep in self.substeps)

    @property
    def certified(self) -> bool:
        """Whether the state solves the unsmoothed law to the tolerance."""
        return self.certificate.certified
