# SPDX-License-Identifier: MIT
"""What residuals are measured by: the forces and tractions of each group, and what rounding hides.

A step may hold bodies and contacts of very different stiffness. One scale for all would let the
soft ones be wrong, so that each body and each contact of a body is a group with a scale of its own.
The scales are forces, and not stiffness times displacement: a motion of everything changes nothing.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]
#: Rounding errors of a force, in units of the last digit of stiffness times displacement.
DIGITS = 16.0 * float(np.finfo(float).eps)
#: Rounding may take this multiple of the tolerance, and this fraction of a force, in its place;
#: forces of which it hides more are not resolved.
COARSER, COARSEST = 1e3, 1e-4
#: What a contact must carry to set a scale, as a fraction of the forces of its body.
FAINT = 1e-4


def coarsest(tolerance: float) -> float:
    """Return the relative accuracy that may take the place of a tolerance, where rounding does."""
    return min(COARSER * tolerance, COARSEST)


@dataclass(frozen=True)
class Scales:
    """Sizes of the groups, one entry a group, equal on all ranks.

    Attributes:
        largest: Largest force or traction of the present state.
        before: The same at the start of the step, new loads included; for contacts not less than
            ``FAINT`` of the forces of their body.
        hidden: What rounding hides at the present displacements.
        given: What rounding hides at displacements that are no result: those of the last step and
            the prescribed ones, of all bodies that meet.
        length: Rounding of these displacements (m).
        noise: Rounding errors of the residual, as far as they were looked for.
        lenient: Groups that may be as right as rounding permits, however faint they are.
    """

    largest: Array
    before: Array
    hidden: Array
    given: Array
    length: Array
    noise: Array
    lenient: npt.NDArray[np.bool_]

    def quiet(self, tolerance: float) -> npt.NDArray[np.bool_]:
        """Tell where nothing acts but what rounding and the tolerance leave of other forces."""
        nothing = np.maximum(np.maximum(self.given, self.noise), tolerance * self.before)
        return np.asarray((self.largest <= nothing) & ~self.lenient)

    def excess(
        self, residual: Array, distance: Array, tolerance: float, share: float = 1.0
    ) -> Array:
        """Return the residuals in units of what tolerance and rounding allow.

        Where nothing acts, a residual may be what the tolerance leaves of the forces before, or
        what the rounding of a displacement makes by the stiffness of its own node: the stiffness of
        other nodes is no excuse.

        Args:
            residual: Largest residual of each group (N or Pa).
            distance: Largest residual over the stiffness of its own node (m).
            tolerance: Relative tolerance.
            share: The part of what rounding hides that is allowed.
        """
        hidden = np.maximum(share * self.hidden, self.noise)
        most = np.where(self.lenient, np.inf, coarsest(tolerance) * self.largest)
        rounding = np.minimum(hidden, most)
        loud = _ratio(residual, np.maximum(tolerance * self.largest, rounding))
        before = _ratio(residual, tolerance * self.before)
        apart = np.minimum(_ratio(distance, share * self.length), _ratio(residual, self.noise))
        return np.where(self.quiet(tolerance), np.minimum(before, apart), loud)

    def relative(self, residual: Array, distance: Array, tolerance: float) -> Array:
        """Return the residuals over the forces; what rounding excuses counts as it is excused."""
        excused = self.quiet(tolerance) | self.lenient
        seen = tolerance * self.excess(residual, distance, tolerance)
        return np.where(excused, seen, _ratio(residual, self.largest))

    def resolution(self, residual: Array, tolerance: float) -> Array:
        """Return the relative accuracy that rounding permits, 0 where nothing acts.

        Noise counts where a residual needs it as an excuse.
        """
        loud = ~self.quiet(tolerance) & ~self.lenient
        needed = residual > np.maximum(tolerance * self.largest, self.hidden)
        hidden = np.where(needed, np.maximum(self.hidden, self.noise), self.hidden)
        ratio = np.zeros_like(self.largest)
        return np.divide(hidden, self.largest, out=ratio, where=loud & (self.largest > 0.0))


def _ratio(values: Array, scales: Array) -> Array:
    """Return ratios: 0 of nothing, infinite of something to nothing; what is no number stays."""
    ratio = np.where(values == 0.0, 0.0, np.where(np.isnan(values), np.nan, np.inf))
    return np.divide(values, scales, out=ratio, where=(scales > 0.0) & np.isfinite(scales))
