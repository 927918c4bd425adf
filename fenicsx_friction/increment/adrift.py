# SPDX-License-Identifier: MIT
"""Bodies that a step has moved where nothing holds them.

Where neither conditions, springs nor contact resist a motion, each position is as good as another,
and what a singular matrix gives is arbitrary. A body that has stayed there is as it should be, and
a deformable one that has gone about as far as it deforms, as if it were held at some point.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ..equations.floating import NOTHING
from ..equations.loose import Array, LooseMotion, of_floating, of_rigid
from ..equations.resistance import Resistance
from .snapshot import Snapshot
from .system import ContactSystem

#: What is said of them.
ADRIFT = (
    "where neither conditions, springs nor contact hold it at the end of the step: any position "
    "there is as good as this one."
)
#: What to do.
CURES = (
    "Prescribe the motion of a rigid body before it leaves (body.free, body.given), or give it "
    "springs.",
    "Hold a deformable body at a point or on a plane of symmetry, or by friction.",
)


def bodies_adrift(system: ContactSystem, start: Snapshot) -> list[str]:
    """Say which bodies have moved, and where to, although nothing holds them; collective.

    Args:
        system: The system, at a solution.
        start: The unknowns at the start of the step.
    """
    if not (system.bodies or system.floating.bodies):
        return []  # most models
    # Who has stayed holds the others, where they cannot move without it.
    every = list(_motions(system, start))
    went = [m for m in every if not abs(m.moved) <= m.spared]
    if not went:
        return []
    states, law = system.nodal_states(), system.projection.law
    found = Resistance(system.state, system.contacts, states, system.terms, law)
    adrift = _adrift(went, found.of(went, every, system.floating, system.stiffness.assemble))
    lines = []
    for owner in dict.fromkeys(m.owner for m in adrift):
        ways = [m for m in adrift if m.owner == owner]
        moved = ", ".join(f"{m.name} by {m.moved * m.unit:.3g}" for m in ways)
        lines.append(f"{owner} has moved in {moved}, {ADRIFT} {CURES[ways[0].deformable]}")
    return lines


def _motions(system: ContactSystem, start: Snapshot) -> Iterator[LooseMotion]:
    """Yield all motions that neither conditions, given values nor springs hold; collective."""
    first = len(system.unknowns) - len(system.bodies)
    for i, body in enumerate(system.bodies, start=first):
        yield from of_rigid(body, system.state, i, start[i])
    if (floating := system.floating).bodies:
        linear = system.stiffness.linear
        yield from of_floating(floating, system.state, start[0], system.contacts, undeformed=linear)


def _adrift(motions: Sequence[LooseMotion], resistance: Array) -> list[LooseMotion]:
    """Return those that have gone too far in directions that nothing resists.

    Args:
        motions: The motions.
        resistance: What resists them, relative, one column each.
    """
    arms = np.max(abs(resistance), axis=0)  # long ones, if the center is far away
    resists = arms > NOTHING * max(1.0, float(np.max(arms)))
    arms[~resists] = 1.0
    _, sizes, directions = np.linalg.svd(resistance * resists / arms)
    nothing = directions[sizes <= NOTHING * max(1.0, float(np.max(sizes)))]
    moved, spared = np.transpose([(m.moved, m.spared) for m in motions])
    drift = abs(nothing.T @ (nothing @ (arms * moved))) / arms
    least = spared * max(1.0, float(np.max(drift)))  # beside a huge one all are rounding
    return [m for m, a, b in zip(motions, drift, least, strict=True) if not a <= b]
