# SPDX-License-Identifier: MIT
"""How a load path fails: its errors, what they say and advise."""

from collections.abc import Sequence

from ..base.errors import StepFailed
from ..increment.diagnosis import SMALLER_STEP
from .record import FailedAttempt

FAILURE_ADVICE = (
    "Smaller steps did not help. Where a body snaps or loses its hold there is no solution nearby: "
    "prescribe displacements there instead of forces, hold the body, or let it creep to its next "
    "equilibrium by LoadStepper(relaxation=ViscousRelaxation(u)). Where nodes cycle, refine "
    "the surface, lower mu (above about 3 there may be several solutions or none) or try "
    'StepSettings(corrector="ramp").'
)
INACCURATE_ADVICE = (
    "Tractions that jump do so in any step: allow a larger error, or a smaller smallest step."
)


class StepperFailed(StepFailed):
    """No step down to the smallest was accepted; the problem is at the last accepted one.

    Attributes:
        time: Where the last accepted step ended.
        failed: All attempts at the next one.
    """

    def __init__(
        self,
        message: str,
        report: object,
        time: float,
        failed: tuple[FailedAttempt, ...],
        background: str = "",
    ) -> None:
        super().__init__(message, report, background)
        self.time, self.failed = time, failed


class Inaccurate(StepFailed):
    """The step-doubling error is beyond the tolerance."""

    def __init__(
        self, error: float, tolerance: float, report: object, background: str = ""
    ) -> None:
        super().__init__(
            f"The tractions of one step and of two half steps differ by {error:.2e}, relative "
            f"(tolerance {tolerance:.0e}).",
            report,
            background,
        )
        self.error = error


def explain(
    failure: StepFailed, failed: Sequence[FailedAttempt], last: str, cycling: Sequence[str]
) -> str:
    """Say what was tried, what went wrong and what to do.

    Args:
        failure: What was wrong with the last attempt.
        failed: All attempts, the smallest step last.
        last: Which steps were refused, and where the problem is now.
        cycling: Lines that name the nodes that cycle.
    """
    lines = [
        last,
        "Tried: " + "; ".join(f"step {f.step:.3g}: {f.reason}" for f in failed),
        *cycling,
        "The last attempt:",
        # The path has followed that advice already.
        *(f"  {line}" for line in failure.message.splitlines() if line != SMALLER_STEP),
        INACCURATE_ADVICE if isinstance(failure, Inaccurate) else FAILURE_ADVICE,
    ]
    return "\n".join(lines)
