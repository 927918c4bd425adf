# SPDX-License-Identifier: MIT
"""What the slip corrector of the paper needs of a contact beside its rows."""

import numpy as np

from ..base.collective import any_rank
from .contact import Contact

#: A node with slip rows this fraction outside the cone is at a false root.
FALSE_ROOT = 1e-6


def freeze_stick(contact: Contact, *, violated_only: bool = True) -> int:
    """Freeze the stick traction for the slip rows and choose the nodes that get them; collective.

    Args:
        contact: The contact.
        violated_only: Choose the nodes whose stick traction leaves the cone, or else all nodes
            in contact (without a stick traction eq. (12) would be 0/0).

    Returns:
        How many owned nodes were chosen.
    """
    n, state = contact.surface.num_owned, contact.present()
    traction = np.linalg.norm(state.c[:, 1:], axis=1)
    chosen = (traction > 0.0) & (state.c[:, 0] >= state.r * state.gap)
    if violated_only:
        chosen &= traction > state.limit
    contact.c_stick.x.array[:] = contact.c.x.array
    contact.slipping.x.array[:n] = chosen
    # The elastic displacement under the stick force: a slip length free of units.
    contact.slip_scale.x.array[:n] = np.where(chosen, traction / state.r, 1.0)
    contact.slipping.x.scatter_forward()
    contact.slip_scale.x.scatter_forward()
    return int(np.sum(chosen))


def has_false_root(contact: Contact) -> bool:
    """Tell whether a node with slip rows is outside the cone; collective.

    ``c_t |w| + mu c_n w = 0`` holds at ``w = 0`` for any traction.
    """
    n = contact.surface.num_owned
    traction = np.linalg.norm(contact.present().c[:, 1:], axis=1)
    slack = FALSE_ROOT * np.max(traction, initial=0.0)
    outside = traction > contact.limit_at_multiplier() * (1.0 + FALSE_ROOT) + slack
    found = np.any(outside & (contact.slipping.x.array[:n] > 0.5))
    return any_rank(contact.surface.mesh.comm, bool(found))
