# SPDX-License-Identifier: MIT
"""How exactly an iterative solver solves the linear systems of Newton's method.

Far from the solution, an exact step is a waste: Eisenstat and Walker's second choice (SIAM J. Sci.
Comput. 17:16-32, 1996). At the end, no step needs to reach more than the tolerance.

PETSc has the same as ``snes_ksp_ew``, but for one nonlinear solver of a linear one; here the
substeps share theirs.
"""

from collections.abc import Sequence

#: Accuracy of the first step, the worst accuracy, and the best.
FIRST, WORST, BEST = 1e-2, 0.1, 1e-10
#: The accuracy is ``GAMMA`` times the last reduction of the residual to the power ``ALPHA``.
GAMMA, ALPHA = 0.9, 1.618
#: The last step aims at this fraction of the tolerance.
AIM = 0.1


def accuracy(history: Sequence[float], last: float, excess: float) -> float:
    """Return the relative tolerance of the next linear solve.

    Args:
        history: Norms of the nonlinear residual, the present one last.
        last: Relative tolerance of the linear solve before.
        excess: The present residual over what is allowed.
    """
    if len(history) < 2:
        found = FIRST
    else:
        found = GAMMA * (history[-1] / history[-2]) ** ALPHA
        if (before := GAMMA * last**ALPHA) > WORST:
            found = max(found, before)
    return float(min(max(found, AIM / max(excess, 1.0), BEST), WORST))
