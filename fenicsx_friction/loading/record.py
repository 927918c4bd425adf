# SPDX-License-Identifier: MIT
"""What a load path reports of its steps."""

from dataclasses import dataclass

from ..system.report import StepReport
from .energy import EnergyBalance
from .events import Event


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
