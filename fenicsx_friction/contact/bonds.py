# SPDX-License-Identifier: MIT
"""Tied surfaces: nodes of a contact that neither open nor slide, until they are released."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from ..base.errors import ContactInputError
from ..base.validators import instance, number
from .contact import Contact

Array = npt.NDArray[np.floating]


def tie(contact: Contact, within: float) -> int:
    """Bond the nodes of a contact that touch, from the next step on; collective.

    They carry any traction, tension too, by the multipliers of the contact. Steps that carry them
    are certified: no gap, no slip. What separates them now, up to ``within``, is closed in the next
    step; take ``close_gaps=`` of a ``DeformableObstacle`` to leave gaps of the mesh as they are.

    Args:
        contact: A contact of a problem.
        within: Largest gap or overlap (m) of nodes that touch.

    Returns:
        The number of bonded nodes, of all ranks.

    Raises:
        ContactInputError: If the contact has no problem yet, its nodes cannot be tied, or no node
            touches.
    """
    _check(contact)
    if not contact.pairing.bondable:
        raise ContactInputError(
            f"tie: '{contact.surface.name}' meets itself, and its nodes change their roles. Take "
            "two surfaces with a DeformableObstacle for what is to be tied."
        )
    number(within, "within (m)", at_least=0.0)
    pairing, n = contact.pairing, contact.surface.num_owned
    near = abs(pairing.gaps()) <= within
    near &= pairing.side.nodal(contact.free)[:, 0] > 0.5
    bonded = contact.bonded.x.array
    bonded[:n] = np.maximum(bonded[:n], near)
    contact.bonded.x.scatter_forward()
    total = int(contact.surface.mesh.comm.allreduce(np.count_nonzero(bonded[:n] > 0.5), MPI.SUM))
    if not total:
        raise ContactInputError(
            f"tie: no node of '{contact.surface.name}' is within {within:g} m of what it may meet."
        )
    return total


def release(contact: Contact) -> None:
    """Release all bonds of a contact, from the next step on: its nodes may open and slide.

    Nodes that were pulled start the step with no traction.
    """
    _check(contact)
    c = contact.c.x.array.reshape(len(contact.bonded.x.array), contact.pairing.side.d)
    c[(contact.bonded.x.array > 0.5) & (c[:, 0] < 0.0)] = 0.0
    contact.bonded.x.array[:] = 0.0


def at_bonds(contact: Contact, values: Array) -> Array:
    """Return values at the bonded nodes of this rank, zero elsewhere."""
    return np.where(contact.bonded.x.array[: contact.surface.num_owned] > 0.5, values, 0.0)


def _check(contact: Contact) -> None:
    """Raise unless this is a contact of a problem."""
    instance(contact, Contact, "contact", "a Contact of a problem")
    if not hasattr(contact, "pairing"):
        raise ContactInputError(
            f"Contact '{contact.surface.name}' has no problem yet: make the "
            "FrictionalContactProblem first, then tie its contact."
        )
