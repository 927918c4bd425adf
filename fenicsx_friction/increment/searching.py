# SPDX-License-Identifier: MIT
"""Looking again for what the nodes meet."""

from collections.abc import Sequence

from ..contact.contact import Contact
from ..obstacles.against_faces import AgainstFaces


def search(contacts: Sequence[Contact]) -> bool:
    """Look again for what the nodes meet; tell whether that has changed; collective.

    Who has nothing before it any more carries nothing. A pressure that was left there would keep
    the node closed, by a gap that depends on nothing: a row of zeros.
    """
    changed = [k.pairing.search() for k in contacts]
    for k in (k for k, other in zip(contacts, changed, strict=True) if other):
        if isinstance(k.pairing, AgainstFaces):
            k.pairing.side.nodal(k.c)[~k.pairing.meeting()] = 0.0
            k.c.x.scatter_forward()
    return any(changed)
