# SPDX-License-Identifier: MIT
"""Rigid bodies that a step has moved where nothing holds them."""

from ..equations.held import adrift
from .snapshot import Snapshot
from .system import ContactSystem

#: What is said of them.
ADRIFT = (
    "where neither contact nor springs hold it at the end of the step: any position there is as "
    "good as this one. Prescribe its motion before it leaves (body.free, body.given), or give it "
    "springs."
)


def bodies_adrift(system: ContactSystem, start: Snapshot) -> list[str]:
    """Say which bodies have moved, and where to, although nothing holds them; collective.

    Args:
        system: The system, at a solution.
        start: The unknowns at the start of the step.
    """
    if not system.bodies:
        return []  # most models: their nodal values need not be found once more
    lines, states, end = [], system.nodal_states(), len(system.unknowns)
    for body, before in zip(system.bodies, start[end - len(system.bodies) : end], strict=True):
        if names := adrift(body, system.contacts, states, before):
            way = body.q.x.array - before
            moved = ", ".join(f"{name} by {way[body.names.index(name)]:.3g}" for name in names)
            lines.append(f"rigid body '{body.name}' has moved in {moved}, {ADRIFT}")
    return lines
