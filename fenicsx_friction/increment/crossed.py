# SPDX-License-Identifier: MIT
"""Nodes that have gone through an obstacle within a step."""

import numpy as np

from ..certificate.nodal_state import OPEN
from ..surfaces.naming import named
from .system import ContactSystem

#: What is said of nodes that went through, and of nodes round which an obstacle is missed.
THROUGH = (
    "went through the obstacle in this step without meeting it: take a smaller step, or "
    "(deformable obstacles) a larger SearchPolicy.reach."
)
PIERCED = (
    "have faces that nodes of the obstacle went through in this step: it is smaller or sharper "
    "than they are; take a smaller step, a finer mesh there, or swap the two surfaces."
)
MISSED = (
    "are open, but the obstacle is deep in the faces round them: it is smaller than they are; "
    "take a finer mesh, or a displacement of degree 1."
)


def crossed_nodes(system: ContactSystem) -> list[str]:
    """Say of each contact which nodes have gone through in the step; collective, on all ranks."""
    lines = []
    for k, state in zip(system.contacts, system.nodal_states(), strict=True):
        closed, pairing = state.states() != OPEN, k.pairing
        tests = (pairing.crossed, THROUGH), (pairing.missed, MISSED), (pairing.pierced, PIERCED)
        for test, what in tests:
            nodes = test(closed)
            if number := system.comm.allreduce(int(np.sum(nodes))):
                where = named(k.surface, np.flatnonzero(nodes))
                lines.append(f"{number} nodes of '{k.surface.name}' {what}{where}")
                break
    return lines
