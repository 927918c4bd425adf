# SPDX-License-Identifier: MIT
"""When Newton's method stops: a convergence test made for contact."""

from typing import Protocol

from petsc4py import PETSc

import numpy as np

#: A relative residual below this that no step makes smaller counts as rounding.
ROUNDING = 1e-8
#: A residual that returns to this relative accuracy within 15 iterations is a cycle.
CYCLE = 1e-6
#: Full Newton steps without a smaller residual that count as a cycle, or the square root of the
#: number of nodes across a contact if that is more: on fine meshes, slip fronts move a few nodes a
#: step.
STALLED = 8
#: Where iterations are cheap, so many full Newton steps up to more than so many times the smallest
#: residual count as a cycle, too. (Bodies that buckle find their way after such jumps.)
JUMPS, WILD = 2, 10.0


class Measure(Protocol):
    """Measures residuals."""

    @property
    def nodes_across(self) -> float:
        """Number of nodes across the contacts."""

    def excess(self, rows: np.ndarray, tolerance: float) -> float:
        """Return the largest residual in units of what a relative tolerance allows."""

    def find_noise(self) -> None:
        """Measure the rounding of the residual."""


class Progress:
    """Follows one solve and judges its iterates.

    Args:
        measure: Measures residuals.
        tolerance: All residuals are to be this small, relative to their scales.
        cheap: Whether iterations cost little beside an elastic solve.

    Attributes:
        tolerance: As given.
        history: 2-norms of the residual (N), one an iteration and the initial one.
        cycled: Whether the iterates go round.
        excess: The present residual over what the tolerance allows.
    """

    def __init__(self, measure: Measure, tolerance: float, *, cheap: bool = False) -> None:
        self._measure, self.tolerance, self._cheap = measure, tolerance, cheap
        self._noisy = False
        self.history: list[float] = []
        self.cycled = False
        self.excess = 1.0

    def judge(self, snes: PETSc.SNES, it: int, norm: float) -> PETSc.SNES.ConvergedReason:
        """Stop at the tolerance, at rounding, at NaN, at the last iteration and in a cycle."""
        reason, max_it = PETSc.SNES.ConvergedReason, snes.getTolerances()[3]
        self.history.append(norm)
        if not np.isfinite(norm):
            return reason.DIVERGED_FNORM_NAN
        rows = snes.getFunction()[0].array_r
        self.excess = self._measure.excess(rows, self.tolerance)
        if self.excess <= 1.0:
            return reason.CONVERGED_FNORM_ABS
        if it > 0 and norm >= 0.5 * self.history[-2] and self._is_rounding(rows):
            return reason.CONVERGED_SNORM_RELATIVE
        patience = max(STALLED, int(self._measure.nodes_across**0.5))
        recent, before = self.history[-patience:], self.history[:-patience]
        self.cycled = any(abs(norm - old) <= CYCLE * norm for old in self.history[-16:-2])
        # A line search may decrease the residual slowly; full steps should not.
        full_steps = snes.getLineSearch().getType() == PETSc.SNESLineSearch.Type.BASIC
        self.cycled |= full_steps and len(before) > 2 and min(recent) > 0.9 * min(before)
        self.cycled |= full_steps and self._cheap and self._wild()
        if self.cycled or it >= max_it:
            return reason.DIVERGED_MAX_IT
        return reason.ITERATING

    def _wild(self) -> bool:
        """Tell whether the residual has jumped again and again."""
        smallest, rises = np.minimum.accumulate(self.history), np.diff(self.history) > 0.0
        return bool(np.sum(rises & (self.history > WILD * smallest)[1:]) >= JUMPS)

    def _is_rounding(self, rows: np.ndarray) -> bool:
        """Tell whether a residual that no step makes smaller is rounding; collective."""
        loose = max(ROUNDING, self.tolerance)
        # What a tolerance allows grows no faster than the tolerance: this saves the measurement.
        if self.excess * self.tolerance <= loose and self._measure.excess(rows, loose) <= 1.0:
            return True
        if self._noisy:  # already measured in this solve
            return False
        self._noisy = True
        self._measure.find_noise()
        return self._measure.excess(rows, self.tolerance) <= 1.0
