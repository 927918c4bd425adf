# SPDX-License-Identifier: MIT
"""How large the next load step is: stops, cuts after failures, growth, step-doubling error."""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from ..base.errors import ContactInputError
from ..base.validators import integer, number, shown

#: Factors of the step after a failure and after an easy step.
CUT, GROW = 0.5, 1.5
#: Bounds of the factor that the step-doubling error asks for, and its safety.
SHRINK_MOST, GROW_MOST, SAFETY = 0.1, 2.0, 0.9
#: If less than this fraction of a step would remain up to a stop, the step ends at the stop.
SLIVER = 1e-6
#: Times that differ by this fraction of the largest are the same.
ROUNDING = 1e-13
#: The smallest step by default, as a fraction of the first.
SMALLEST = 1e-3

Tractions = list[npt.NDArray[np.floating]]


class StepSize:
    """The size of the steps along a path; arguments as those of ``LoadStepper``.

    Attributes:
        next: Size of the next step, stops aside.
        smallest: Smallest step to be tried.
        tolerance: Tolerance of the step-doubling error, if that controls the steps.
    """

    def __init__(
        self,
        start: float,
        end: float,
        step: float,
        smallest: float | None,
        largest: float | None,
        stops: Sequence[float],
        error: float | None,
        easy: int,
    ) -> None:
        self._start, self._end = number(start, "start"), number(end, "end")
        self.next = number(step, "step", above=0.0)
        self.tolerance = None if error is None else number(error, "error", above=0.0)
        self._easy = integer(easy, "easy", at_least=0)
        self.smallest = SMALLEST * self.next
        if smallest is not None:
            self.smallest = number(smallest, "smallest", above=0.0)
        # A path resumed near its end is shorter than its first step.
        self._largest = self.next if error is None else max(self.next, self._end - self._start)
        if largest is not None:
            self._largest = number(largest, "largest", above=0.0)
        self._rounding = ROUNDING * max(abs(self._start), abs(self._end))
        self._check()
        self._stops = self._inside(stops)

    def resume(self, time: float, size: float | None) -> None:
        """Go on from a time on the path, or beyond it: stops up to there are past.

        Args:
            time: Where the last accepted step ended.
            size: The size of the next step, as it was then; by default that of the first one.

        Raises:
            ContactInputError: If the time is before the start.
        """
        if time < self._start - self._rounding:
            raise ContactInputError(
                f"The path has gone to time {time:.10g} only, which is before its start, "
                f"{self._start:.10g}: make the steps up to there first."
            )
        self._stops = [t for t in self._stops if t > time + self._rounding]
        # Whoever begins where an earlier path ended takes the size of the first step.
        if size is not None and time > self._start + self._rounding:
            self.next = min(max(size, self.smallest), self._largest)

    def is_over(self, time: float) -> bool:
        """Tell whether a time is the end, up to rounding."""
        return time >= self._end - self._rounding

    def goal(self, time: float) -> float:
        """Return where the step from a time ends: at the next stop, if the step reaches it."""
        stop = next(t for t in self._stops if t > time)
        return stop if stop - time <= self.next * (1.0 + SLIVER) else time + self.next

    def is_smallest(self, step: float) -> bool:
        """Tell whether no smaller step is to be tried."""
        return step <= self.smallest * (1.0 + SLIVER)

    def cut(self, step: float, error: float | None = None) -> None:
        """Make the next step smaller than one that failed, or whose error was too large."""
        factor = CUT if error is None else self._allowed(error, CUT)
        self.next = max(step * factor, self.smallest)

    def adapt(
        self, step: float, iterations: Sequence[int], error: float | None, *, was_cut: bool
    ) -> None:
        """Choose the next step after a solved one: larger after an easy one that was not cut.

        Args:
            step: The solved step.
            iterations: Newton iterations of it, or of its halves.
            error: Its step-doubling error, if that controls the steps.
            was_cut: Whether a larger one failed before.
        """
        easy = not was_cut and max(iterations) <= self._easy
        factor = GROW if easy else 1.0
        if error is not None:
            factor = self._allowed(error, GROW_MOST if easy else 1.0)
        if step > self.next * (1.0 - SLIVER) or factor < 1.0:  # a stop may have cut it short
            self.next = min(max(step * factor, self.smallest), self._largest)

    def _allowed(self, error: float, most: float) -> float:
        """Return the factor that a step-doubling error, of second order in the step, allows."""
        assert self.tolerance is not None
        if error <= 0.0:
            return most
        return float(np.clip(SAFETY * np.sqrt(self.tolerance / error), SHRINK_MOST, most))

    def _check(self) -> None:
        """Refuse sizes and times that make no path; it may have no length if resumed at its end."""
        if self._start > self._end + self._rounding:
            raise ContactInputError(
                f"The path must go from start = {self._start} up to end, not down to {self._end}."
            )
        if not self.smallest <= self.next <= self._largest:
            raise ContactInputError(
                f"Steps need 0 < smallest <= step <= largest, not {self.smallest}, "
                f"{self.next}, {self._largest}."
            )

    def _inside(self, stops: Sequence[float]) -> list[float]:
        """Return the stops between start and end, in order, and the end."""
        if not isinstance(stops, list | tuple | np.ndarray):
            raise ContactInputError(f"stops = {shown(stops)} must be a sequence of numbers.")
        times = sorted(number(t, f"stops[{i}]") for i, t in enumerate(stops))
        if times and times[-1] > self._end + self._rounding:
            raise ContactInputError(
                f"stops = {shown(stops)} must not go beyond the end, {self._end}: {times[-1]} does."
            )
        inside: list[float] = []
        for t in [*times, self._end]:  # later times replace nearly equal ones, so the end is exact
            while inside and inside[-1] >= t - self._rounding:
                inside.pop()
            if t > self._start + self._rounding:
                inside.append(t)
        return inside


def doubling_error(
    comm: MPI.Intracomm, before: Tractions, whole: Tractions, half: Tractions, halves: Tractions
) -> float:
    """Compare the tractions of a whole step with those of two halves; collective.

    Args:
        comm: The ranks.
        before: Traction vectors of this rank's nodes at the start (Pa), one array a contact.
        whole: After the whole step.
        half: After one half.
        halves: After two.

    Returns:
        The longest difference over the longest traction, 0 where there is none.
    """
    difference = [a - b for a, b in zip(whole, halves, strict=True)]
    worst = np.array([_longest(difference), _longest([*before, *whole, *half, *halves])])
    comm.Allreduce(MPI.IN_PLACE, worst, MPI.MAX)
    error, scale = worst.tolist()
    return float(error / scale) if scale > 0.0 else 0.0


def _longest(vectors: Sequence[npt.NDArray[np.floating]]) -> float:
    """Return the length of the longest row of the arrays."""
    return max(
        (float(np.max(np.linalg.norm(v, axis=1), initial=0.0)) for v in vectors), default=0.0
    )
