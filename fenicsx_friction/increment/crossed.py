# SPDX-License-Identifier: MIT
"""Nodes that have gone through an obstacle within a step."""

import numpy as np

from ..certificate.nodal_state import OPEN
from ..surfaces.naming import named
from .system import ContactSystem


def crossed_nodes(system: ContactSystem) -> list[str]:
    """Name the nodes that have gone through an obstacle in the step; collective, on all ranks.

    Nodes that a closed contact holds are not tested.
    """
    lines = []
    for k, state in zip(system.contacts, system.nodal_states(), strict=True):
        closed = state.states() != OPEN
        missed = k.pairing.missed(closed)
        if number := system.comm.allreduce(int(np.sum(missed))):
            lines.append(
                f"{number} nodes of '{k.surface.name}' are open on average, but the obstacle is "
                "deep in the faces round them: it is smaller than they are; take a finer mesh, or "
                f"a displacement of degree 1.{named(k.surface, np.flatnonzero(missed))}"
            )
        crossed = k.pairing.crossed(closed)
        if number := system.comm.allreduce(int(np.sum(crossed))):
            lines.append(
                f"{number} nodes of '{k.surface.name}' went through the obstacle in this step "
                "without meeting it: take a smaller step, or (deformable obstacles) a larger "
                f"SearchPolicy.reach.{named(k.surface, np.flatnonzero(crossed))}"
            )
    return lines
