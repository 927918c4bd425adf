# SPDX-License-Identifier: MIT
"""Bodies that a step has moved where nothing holds them.

Where neither conditions, springs nor contact resist a motion, each position is as good as another,
and what a singular matrix gives is arbitrary. A body that has stayed there is as it should be, and
one that has gone about as far as bodies deform: a deformable one as if it were held at some point,
a rigid one as if it still touched what it has left.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ..equations.floating import NOTHING
from ..equations.loose import (
    MOVED,
    Array,
    LooseMotion,
    Moves,
    name_of,
    of_floating,
    of_rigid,
    without_springs,
)
from .grip import Grip
from .resistance import Resistance
from .snapshot import Snapshot
from .system import ContactSystem

#: What is said of them.
ADRIFT = (
    "where neither conditions, springs nor contact hold it at the end of the step: any position "
    "there is as good as this one."
)
#: Who has been stretched by more in a step, relative to the size of the mesh, is beyond all bounds.
BURST = 1e3
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
    floating, linear = system.floating, system.stiffness.linear
    free = any(np.any(without_springs(body)) for body in system.bodies)
    whose = range(floating.number) if free or not linear else floating.bodies
    moves = {b: floating.moved(b, start[0], undeformed=linear) for b in whose}
    burst = [] if linear else _burst(system, moves)
    if burst or not (free or floating.bodies):
        return burst  # none, in most models
    # Who has stayed holds the others, where they cannot move without it.
    every = list(_motions(system, start, moves))
    went = [m for m in every if not abs(m.moved) <= m.spared]
    if not went:
        return []
    resistance = Resistance(system)
    adrift = _adrift(went, resistance.of(went, every), resistance.grip(went))
    lines = []
    for owner in dict.fromkeys(m.owner for m in adrift):
        ways = [m for m in adrift if m.owner == owner]
        moved = ", ".join(f"{m.name} by {m.moved * m.unit:.3g}" for m in ways)
        lines.append(f"{owner} has moved in {moved}, {ADRIFT} {CURES[ways[0].deformable]}")
    return lines


def _burst(system: ContactSystem, moves: Moves) -> list[str]:
    """Say which bodies have been stretched without bounds; collective.

    Where an energy grows less than the stretch, as ``J^(-2/3) tr C`` does, forces vanish there, and
    nothing balances nothing.
    """
    lines = []
    for body, (gone, stretched) in moves.items():
        rounding = MOVED * float(np.max(abs(gone)))  # of what has flown
        if not stretched <= max(BURST, rounding):
            owner = name_of(system.floating.surfaces_of(body, system.contacts))
            lines.append(
                f"{owner} has been stretched by {stretched:.3g} times the size of the mesh in one "
                "step: its material resists no more there. Take smaller steps, or hold it."
            )
    return lines


def _motions(system: ContactSystem, start: Snapshot, moves: Moves) -> Iterator[LooseMotion]:
    """Yield all motions that neither conditions, given values nor springs hold; collective."""
    first = len(system.unknowns) - len(system.bodies)
    deformed = max((rest for _, rest in moves.values()), default=0.0)
    for i, body in enumerate(system.bodies, start=first):
        yield from of_rigid(body, system.state, i, start[i], deformed)
    linear = system.stiffness.linear
    yield from of_floating(system.floating, system.state, moves, system.contacts, undeformed=linear)


def _adrift(motions: Sequence[LooseMotion], resistance: Array, grip: Grip) -> list[LooseMotion]:
    """Return those that have gone too far in directions that nothing resists; collective.

    Args:
        motions: The motions.
        resistance: What resists them, relative, one column each.
        grip: How friction holds them.
    """
    arms = np.max(abs(resistance), axis=0)  # long ones, if the center is far away
    resists = arms > NOTHING
    arms[~resists] = 1.0
    _, sizes, directions = np.linalg.svd(resistance * resists / arms)
    nothing = directions[sizes <= NOTHING * max(1.0, float(np.max(sizes)))]
    nothing = np.linalg.qr((grip.slipping(nothing / arms) * arms).T)[0].T  # orthonormal again
    moved, spared = np.transpose([(m.moved, m.spared) for m in motions])
    drift = abs(nothing.T @ (nothing @ (arms * moved))) / arms
    least = np.maximum(spared, MOVED * float(np.max(drift)))  # beside a huge one all are rounding
    return [m for m, a, b in zip(motions, drift, least, strict=True) if not a <= b]
