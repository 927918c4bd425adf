# SPDX-License-Identifier: MIT
"""What residuals are compared with: forces and tractions of each group, and their rounding errors.

A step may hold bodies and contacts of very different stiffness. One scale for all would let the
soft ones be wrong. Therefore each body, and each contact of a body, is a group with its own scale.
The scales are forces, not stiffness times displacement: a motion of everything changes nothing.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]
#: Rounding errors of a force, in units of the last digit of stiffness times displacement.
DIGITS = 16.0 * float(np.finfo(float).eps)
#: Rounding may replace the tolerance up to this multiple of it, and up to this fraction of a force.
#: A force with more rounding is not resolved.
COARSER, COARSEST = 1e3, 1e-4
#: Tractions below this fraction of the forces of their body (over area) do not set a scale.
FAINT = 1e-4
#: Newton stops where a residual is this share of its estimated rounding error.
SHARE = 0.25


def coarsest(tolerance: float) -> float:
    """Return the largest relative rounding error that may replace a tolerance."""
    return min(COARSER * tolerance, COARSEST)


@dataclass(frozen=True)
class Scales:
    """Sizes of the groups, one entry a group, equal on all ranks.

    Attributes:
        largest: Largest force or traction of the present state.
        before: The same at the start of the step, new loads included; for contacts not less than
            ``FAINT`` of the forces of their body.
        hidden: Estimated rounding error of forces at the present displacements.
        given: The same at displacements that are given, not solved for: those of the last step and
            the prescribed ones, of all bodies that meet.
        length: Rounding of the given displacements (m).
        noise: Measured rounding errors of the residual; zero before they are measured.
        lenient: Groups whose rounding errors always pass, however faint their forces are.
    """

    largest: Array
    before: Array
    hidden: Array
    given: Array
    length: Array
    noise: Array
    lenient: npt.NDArray[np.bool_]

    def nothing(self, tolerance: float) -> Array:
        """Return what is below rounding, or below the tolerance times the forces before."""
        rounding = np.maximum(self.given, self.noise)
        return np.asarray(np.maximum(rounding, tolerance * self.before))

    def quiet(self, tolerance: float) -> npt.NDArray[np.bool_]:
        """Tell where forces are below this."""
        return np.asarray((self.largest <= self.nothing(tolerance)) & ~self.lenient)

    def allowed(self, tolerance: float, share: float = 1.0) -> Array:
        """Return what residuals may be where forces are not quiet (N or Pa); see :meth:`excess`."""
        hidden = np.maximum(share * self.hidden, self.noise)
        most = np.where(self.lenient, np.inf, coarsest(tolerance) * self.largest)
        return np.asarray(np.maximum(tolerance * self.largest, np.minimum(hidden, most)))

    def excess(
        self, residual: Array, distance: Array, tolerance: float, share: float = 1.0
    ) -> Array:
        """Return the residuals in units of what tolerance and rounding allow.

        In a quiet group, a residual may reach the tolerance times the forces before, or the
        rounding of a displacement times the stiffness of its own node. The stiffness of other nodes
        does not count.

        Args:
            residual: Largest residual of each group (N or Pa).
            distance: Largest residual over the stiffness of its own node (m).
            tolerance: Relative tolerance.
            share: The allowed part of the estimated rounding errors.
        """
        loud = _ratio(residual, self.allowed(tolerance, share))
        before = _ratio(residual, tolerance * self.before)
        apart = np.minimum(_ratio(distance, share * self.length), _ratio(residual, self.noise))
        return np.where(self.quiet(tolerance), np.minimum(before, apart), loud)

    def relative(self, residual: Array, distance: Array, tolerance: float) -> Array:
        """Return residuals over forces; for quiet and lenient groups, excess times tolerance."""
        excused = self.quiet(tolerance) | self.lenient
        seen = tolerance * self.excess(residual, distance, tolerance)
        return np.where(excused, seen, _ratio(residual, self.largest))

    def resolution(self, residual: Array, tolerance: float) -> Array:
        """Return the relative accuracy that rounding permits, 0 where nothing acts.

        Noise counts only where a residual is beyond tolerance and estimated rounding.
        """
        loud = ~self.quiet(tolerance) & ~self.lenient
        needed = residual > np.maximum(tolerance * self.largest, self.hidden)
        hidden = np.where(needed, np.maximum(self.hidden, self.noise), self.hidden)
        ratio = np.zeros_like(self.largest)
        return np.divide(hidden, self.largest, out=ratio, where=loud & (self.largest > 0.0))


def _ratio(values: Array, scales: Array) -> Array:
    """Return ratios: 0 / 0 is 0, others over 0 are infinite, NaN stays."""
    ratio = np.where(values == 0.0, 0.0, np.where(np.isnan(values), np.nan, np.inf))
    return np.divide(values, scales, out=ratio, where=(scales > 0.0) & np.isfinite(scales))


def joined(parts: Iterable[Scales]) -> Scales:
    """Put groups together."""
    parts = list(parts)
    return Scales(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Scales)))
