# SPDX-License-Identifier: MIT
"""Which nodes carry more than rounding."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..certificate.nodal_state import OPEN, NodalState
from .system import ContactSystem


def carrying(system: ContactSystem, states: Sequence[NodalState]) -> list[npt.NDArray[np.bool_]]:
    """Tell which owned nodes of each contact carry more than nothing; collective.

    Nothing is rounding, and what the tolerance leaves of the tractions before.

    Args:
        system: The system.
        states: Nodal values of the contacts on this rank.
    """
    scales, number = system.scales, system.scales.number
    nothing = scales.scales().nothing(system.settings.tolerance)[number:]
    return [
        np.linalg.norm(s.c, axis=1) > nothing[i * number :][body]
        for i, (s, body) in enumerate(zip(states, scales.node_bodies, strict=True))
    ]


def forget_rounding(system: ContactSystem) -> None:
    """Set multipliers of open nodes to zero where a contact carries nothing on a body; collective.

    Left over, they would be all that the contact carries in a next step under the same loads, and
    nothing would be small beside them.
    """
    scales, number = system.scales, system.scales.number
    quiet = scales.scales().quiet(system.settings.tolerance)[number:]
    if not np.any(quiet):
        return
    states = system.nodal_states()
    for i, (k, s, body) in enumerate(zip(system.contacts, states, scales.node_bodies, strict=True)):
        c = k.pairing.side.nodal(k.c)
        c[quiet[i * number :][body] & (s.states() == OPEN)] = 0.0
        k.c.x.scatter_forward()
