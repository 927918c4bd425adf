# SPDX-License-Identifier: MIT
"""Loads so faint beside motions that nothing would tell whether they are carried."""

import numpy as np

from ..certificate.scales import DIGITS
from .balance import Balance
from .forces import ForceScales


def worst_of_lost_loads(scales: ForceScales, balance: Balance, tolerance: float) -> float:
    """Return the largest ratio of rounding to load, of loads that rounding hides; collective.

    Where no force of a body is above the rounding that its given displacements cause, its forces
    need not balance. Without displacements there is no such rounding, and the loads are seen; but
    not those that follow displacements, nor beside initial stresses, which are larger.

    Args:
        scales: Measures the bodies.
        balance: Assembles the loads.
        tolerance: Relative tolerance.
    """
    now, bodies = scales.scales(), slice(scales.number)
    quiet = now.quiet(tolerance)[bodies]
    if not np.any(quiet):
        return 0.0
    loads = abs(balance.loads())
    loads[scales.held_rows[scales.held_rows < len(loads)]] = 0.0
    found = scales.largest(loads)
    rounding = np.maximum(scales.stiffest * now.length[bodies], now.noise[bodies])
    # Less than the tolerance of the forces before is nothing, as at the end of a cycle; so is what
    # finite strains round.
    nothing = np.maximum(tolerance * now.before[bodies], DIGITS * scales.stiffest * scales.extent)
    hidden = quiet & (found > nothing) & (found <= rounding)
    return float(np.max(rounding[hidden] / found[hidden], initial=0.0))
