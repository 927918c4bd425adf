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
            the prescribed ones.
    """

    largest: Array
    before: Array
    hidden: Array
    given: Array

    def quiet(self, tolerance: float) -> npt.NDArray[np.bool_]:
        """Tell where nothing acts but what rounding and the tolerance leave of other forces."""
        return np.asarray(self.largest <= np.maximum(self.given, tolerance * self.before))

    def allowed(self, tolerance: float, share: float = 1.0) -> Array:
        """Return the residuals that a relative tolerance allows, and a share of what is hidden."""
        rounding = np.minimum(share * self.hidden, coarsest(tolerance) * self.largest)
        loud = np.maximum(tolerance * self.largest, rounding)
        quiet = np.maximum(tolerance * self.before, share * self.given)
        return np.asarray(np.where(self.quiet(tolerance), quiet, loud))

    def reference(self, tolerance: float) -> Array:
        """Return what residuals are told relative to."""
        quiet = self.allowed(tolerance) / tolerance
        return np.asarray(np.where(self.quiet(tolerance), quiet, self.largest))

    def resolution(self, tolerance: float) -> Array:
        """Return the relative accuracy that rounding permits, 0 where nothing acts."""
        loud = ~self.quiet(tolerance)
        ratio = np.zeros_like(self.largest)
        return np.divide(self.hidden, self.largest, out=ratio, where=loud)
