# SPDX-License-Identifier: MIT
"""What a step reports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .certificate import Certificate
from .substep import SubstepReport

if TYPE_CHECKING:
    from .energy import EnergyBalance
    from .events import Event


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
    """

    step: int
    corrector: str
    substeps: tuple[SubstepReport, ...]
    contacts: tuple[ContactReport, ...]
    certificate: Certificate

    @property
    def iterations(self) -> int:
        """Newton iterations of the step, which is the number of linear solves."""
        return sum(substep.iterations for substep in self.substeps)

    @property
    def certified(self) -> bool:
        """Whether the state solves the unsmoothed law to the tolerance."""
        return self.certificate.certified


@dataclass(frozen=True)
class FailedAttempt:
    """A step that was tried and not accepted.

    Attributes:
        time: Where it should have ended.
        step: Its size.
        reason: The first words of what was wrong.
    """

    time: float
    step: float
    reason: str


@dataclass(frozen=True)
class StepRecord:
    """An accepted step; the problem is in the state at its end.

    Attributes:
        time: Where the step ended.
        step: Its size.
        report: The report of the problem.
        energy: Its energy balance, or ``None`` without an audit.
        events: The nodes that changed state, by contact and node.
        error: Relative step-doubling error of the tractions, of the pair of half steps this is
            one of, or ``None`` without error control.
        failed: The larger steps that were tried in vain before.
        relaxed: Increments of viscous relaxation that the step took, 0 where it was solved at once.
            The totals of ``report`` and its certificate are of the last one, without damping.
    """

    time: float
    step: float
    report: StepReport
    energy: EnergyBalance | None
    events: list[Event]
    error: float | None = None
    failed: tuple[FailedAttempt, ...] = ()
    relaxed: int = 0
