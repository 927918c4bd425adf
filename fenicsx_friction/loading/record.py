# SPDX-License-Identifier: MIT
"""What a load path reports of its steps."""

from dataclasses import dataclass

from ..increment.report import StepReport
from .energy import EnergyBalance
from .events import Event


@dataclass(frozen=True)
class FailedAttempt:
    """A step that was tried and not accepted.

    Attributes:
        time: Where it should have ended.
        step: Its size.
        reason: The beginning of the error message.
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
        error: Relative step-doubling error of the tractions, for the pair of half steps that this
            step belongs to; ``None`` without error control.
        failed: The larger steps that were rejected before.
        relaxed: Number of increments of viscous relaxation, 0 where the step was solved without.
            ``report`` is of the last increment, which has no damping.
    """

    time: float
    step: float
    report: StepReport
    energy: EnergyBalance | None
    events: list[Event]
    error: float | None = None
    failed: tuple[FailedAttempt, ...] = ()
    relaxed: int = 0
