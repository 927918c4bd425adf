# SPDX-License-Identifier: MIT
"""Where a step may start: as far on as the last step went in its time."""

import numpy as np

from ..base.collective import largest_of_ranks
from ..equations.conditions import with_conditions
from . import snapshot
from .system import ContactSystem

#: Start there if the unbalanced forces are smaller than this part of those at the last state.
WORTH = 0.5


def extrapolate(system: ContactSystem) -> bool:
    """Move all unknowns on as the last step did, if this brings balance nearer; collective.

    It does along smooth paths; where loads turn round or a body snaps, the state stays as it is,
    and so does one that the user has put somewhere else than the last step ended.

    Returns:
        Whether the unknowns have been moved.
    """
    if not _is_last(system):
        return False
    start = snapshot.save(system.state)
    here = _unbalanced(system, start)
    dt, pairs = float(system.dt.value), zip(start, system.rates, strict=True)
    with np.errstate(all="ignore"):  # what is no number brings no balance
        there: snapshot.Snapshot = [a + dt * f.x.array for a, f in pairs]
        if _unbalanced(system, there) < WORTH * here:
            return True
    snapshot.restore(system.state, start)
    return False


def commit_rates(system: ContactSystem, start: snapshot.Snapshot) -> None:
    """Keep how fast the unknowns have changed in a step, before it is committed.

    Args:
        system: The system at the end of the step.
        start: The unknowns at its start.
    """
    for rate, f, values in zip(system.rates, system.state, start, strict=True):
        with np.errstate(over="ignore"):
            found = (f.x.array - values) / float(system.dt.value)
        rate.x.array[:] = np.where(np.isfinite(found), found, 0.0)  # for a tiny dt


def _is_last(system: ContactSystem) -> bool:
    """Tell whether the problem is where its last step ended, and that one went somewhere."""
    moved = abs(system.u.x.array - system.u_old.x.array)
    moved[system.constrained_dofs] = 0.0  # some set these themselves
    rate = max(np.max(abs(f.x.array), initial=0.0) for f in system.rates)
    by_user, rate = largest_of_ranks(system.comm, np.array([np.max(moved, initial=0.0), rate]))
    return bool(by_user == 0.0 and 0.0 < rate < np.inf)


def _unbalanced(system: ContactSystem, values: snapshot.Snapshot) -> float:
    """Put the unknowns somewhere, conditions fulfilled, and return the unbalanced forces (N)."""
    snapshot.restore(system.state, values)
    for u in system.unknowns:
        u.x.array[:] = with_conditions(u, system.bcs)
    return system.projection.unbalanced()
