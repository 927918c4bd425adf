# SPDX-License-Identifier: MIT
"""Nodes that have gone through an obstacle within a step, or meet it in a way that is wrong."""

from functools import partial

import numpy as np

from ..certificate.nodal_state import OPEN
from ..surfaces.naming import named
from .system import ContactSystem

#: What is said of nodes that went through, and of nodes round which an obstacle is missed.
THROUGH = (
    "went through the obstacle in this step without meeting it: take a smaller step, or "
    "(deformable obstacles, rigid surfaces) a larger SearchPolicy.reach."
)
PIERCED = (
    "have faces that nodes of the obstacle went through in this step: it is smaller or sharper "
    "than they are; take a smaller step, a finer mesh there, or swap the two surfaces."
)
MISSED = (
    "are open, but the obstacle is deep in the faces round them: it is smaller than they are; "
    "take a finer mesh, or a displacement of degree 1."
)
SUNK = (
    "are deeper in the obstacle than a tenth of a face, beside the faces that they meet, as before "
    "a wall at right angles to them: give the side of the body that comes to it a contact of its "
    "own, or take a finer mesh there."
)
ASKEW = (
    "are at an edge that presses along the normals of its own faces, not of those that it stands "
    "on: more than 2 % of the force has a wrong direction. Take the flat body's surface as the "
    'secondary one, or method="node-to-face", or round the edge with several faces.'
)


def crossed_nodes(system: ContactSystem) -> list[str]:
    """Say of each contact which nodes make a solution wrong, and why; collective, on all ranks."""
    lines, held = [], np.zeros(len(system.u.x.array))
    held[system.constrained_dofs] = 1.0
    for k, state in zip(system.contacts, system.nodal_states(), strict=True):
        closed, pairing = state.states() != OPEN, k.pairing
        tests = (
            (partial(pairing.crossed, closed), THROUGH),
            (partial(pairing.missed, closed), MISSED),
            (pairing.sunk, SUNK),
            (partial(pairing.pierced, closed), PIERCED),
            (partial(pairing.askew, closed & ~state.ties, pairing.side.owned(held) > 0.5), ASKEW),
        )
        for test, what in tests:
            nodes = test()
            if number := system.comm.allreduce(int(np.sum(nodes))):
                where = named(k.surface, np.flatnonzero(nodes))
                lines.append(f"{number} nodes of '{k.surface.name}' {what}{where}")
                break
    return lines
