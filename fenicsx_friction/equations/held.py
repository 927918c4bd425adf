# SPDX-License-Identifier: MIT
"""Whether contact or springs hold the free components of a rigid body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.collective import any_rank
from ..base.errors import ContactInputError
from ..contact.contact import Contact
from ..obstacles.rigid_body import RigidBody
from .loose import without_springs

#: A node within this fraction of the size of its facets touches.
NEAR = 1e-6


def check_held(body: RigidBody, contacts: Sequence[Contact]) -> None:
    """Raise if a body is free, without springs, and touches nothing; collective.

    Args:
        body: The body.
        contacts: All contacts.

    Raises:
        ContactInputError: Names the components that nothing holds.
    """
    every = np.array(body.mesh.comm.allgather(body.settings()))
    if not np.all(np.isfinite(every)):
        raise ContactInputError(
            f"Rigid body '{body.name}': a force, moment, given value or spring is not finite."
        )
    if np.any(every != every[0]):
        raise ContactInputError(
            f"Rigid body '{body.name}': loads, given values, springs or free components differ "
            "between ranks; set the same on all."
        )
    if not np.all(body.spring.value >= 0.0):
        raise ContactInputError(f"Rigid body '{body.name}': a spring is negative.")
    for k in contacts:
        if k.pairing.body is body and k.surface.axisymmetric and set(body.free) - {"y"}:
            raise ContactInputError(
                f"Rigid body '{body.name}' is free in {', '.join(body.free)}, but the surface "
                f"'{k.surface.name}' is axisymmetric: it can only move along the axis, in y."
            )
    loose, touching = without_springs(body), False
    for k in contacts:
        if k.pairing.body is body:
            near = k.pairing.gaps() <= NEAR * k.pairing.side.facet_size()
            touching |= bool(np.any(near | (k.multipliers()[:, 0] > 0.0)))
    if not any_rank(body.mesh.comm, touching) and np.any(loose):
        names = [name for name, free in zip(body.names, loose, strict=True) if free]
        raise ContactInputError(
            f"Rigid body '{body.name}' touches nothing, so that nothing holds its free components "
            f"{', '.join(names)}. Bring it into contact first, with given values (body.free = (), "
            "body.given), or give it springs."
        )
