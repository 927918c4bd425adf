# SPDX-License-Identifier: MIT
"""Which bodies of a mesh may meet."""

from collections.abc import Sequence

import numpy as np
from dolfinx import fem

from ..base.groups import Labels, connected
from ..contact.contact import Contact


def link_bodies(
    contacts: Sequence[Contact],
    secondary: Sequence[Labels],
    V: fem.FunctionSpace,
    body: Labels,
    number: int,
) -> Labels:
    """Number the groups of bodies that may meet each other; collective.

    Args:
        contacts: The contacts.
        secondary: Body of each owned node of each contact.
        V: Space of the displacement.
        body: Body of each of its local (blocked) dofs.
        number: Number of bodies.

    Returns:
        The group of each body.
    """
    links = [np.column_stack([np.arange(number)] * 2)]
    for k, ours in zip(contacts, secondary, strict=True):
        if k.pairing.deformable:
            meets = np.unique(np.concatenate([ours, body[k.pairing.partners(V)]]))
            found = np.concatenate(V.mesh.comm.allgather(meets))
            links.append(np.column_stack([np.full_like(found, found[0]), found]))
    a, b = np.concatenate(links).T
    return connected(number, a, b)[1]
