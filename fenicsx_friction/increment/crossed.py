# SPDX-License-Identifier: MIT
"""Nodes that have gone through an obstacle within a step."""

import numpy as np

from ..certificate.nodal_state import OPEN
from ..surfaces.naming import named
from .system import ContactSystem

#: What is said of nodes that went through, and of nodes round which an obstacle is missed.
THROUGH = (
    "went through the obstacle in this step without meeting it: take a smaller step, or "
    "(deformable obstacles, rigid surfaces) a larger SearchPolicy.reach."
)
MISSED = (
    "are open, but the obstacle is deep in the faces round them: it is smaller than they are; "
    "take a finer mesh, or a displacement of degree 1."
)


def crossed_nodes(system: ContactSystem) -> list[str]:
    """Name the nodes that have gone through an obstacle in the step; collective, on all ranks.

    Nodes that a closed contact holds are not tested.
    """
    lines = []
    for k, state in zip(system.contacts, system.nodal_states(), strict=True):
        closed = state.states() != OPEN
        found = ((k.pairing.missed(closed), MISSED), (k.pairing.crossed(closed), THROUGH))
        for nodes, what in found:
            if number := system.comm.allreduce(int(np.sum(nodes))):
                where = named(k.surface, np.flatnonzero(nodes))
                lines.append(f"{number} nodes of '{k.surface.name}' {what}{where}")
    return lines
