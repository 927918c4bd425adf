# SPDX-License-Identifier: MIT
"""Newton's method for a bulk that is not linear: contact is solved exactly in each iteration.

On the boundary, the forces of such a bulk hold to first order about the state at which it was
condensed. It is condensed again at the solution, until the equations of the whole are balanced.
"""

import numpy as np

from ..solvers.report import SubstepReport
from . import snapshot
from .correctors import Attempt, newton_tolerance, polish
from .system import ContactSystem

#: Linearisations after the first, and how often the way to a solution is halved.
MOST_LINEARISATIONS, MOST_HALVINGS = 25, 6
#: Reason of a bulk without balance.
NOT_BALANCED = "NOT_BALANCED"
#: A residual that grows by more than this makes the way shorter.
GROWTH = 10.0


def rebalance(system: ContactSystem, attempt: Attempt) -> list[SubstepReport]:
    """Balance the whole, starting from a solution on the boundary; collective.

    The unknowns inside the bulk are found, too.

    Returns:
        The reports; the last one tells of no convergence if the bulk found no balance.
    """
    reports: list[SubstepReport] = []
    if not system.solvers.approximate:
        return reports
    size = np.inf
    for _ in range(MOST_LINEARISATIONS):
        system.solvers.recover()
        size = _shortened(system, GROWTH * size)
        if not np.isfinite(size):
            break
        if _balanced(system):
            return reports
        if system.solvers.condense() is None:
            break
        reports.append(polish(system, attempt))
        if not reports[-1].converged:
            return reports
    failed = SubstepReport("bulk", 0.0, 0.0, 0, False, NOT_BALANCED, (), solver="condensed")
    return [*reports, failed]


def _shortened(system: ContactSystem, most: float) -> float:
    """Go only a part of the way from the last linearisation if the residual is too large.

    Returns:
        The 2-norm of the residual (N).
    """
    start, end = system.solvers.linearised_at(), snapshot.save(system.unknowns)
    size, part = _size(system), 1.0
    while not (np.isfinite(size) and size <= most) and part > 0.5**MOST_HALVINGS:
        part /= 2.0
        between: snapshot.Snapshot = [a + part * (b - a) for a, b in zip(start, end, strict=True)]
        snapshot.restore(system.unknowns, between)
        size = _size(system)
    return size


def _size(system: ContactSystem) -> float:
    """Return the 2-norm of the residual of the whole (N), infinite if it is no number."""
    with system.solvers.use(condensed=False):
        size = system.projection.unbalanced()
    return size if np.isfinite(size) else np.inf


def _balanced(system: ContactSystem) -> bool:
    """Tell whether the whole is solved."""
    with system.solvers.use(condensed=False):
        return system.projection.is_solved(newton_tolerance(system))
