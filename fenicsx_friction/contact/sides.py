# SPDX-License-Identifier: MIT
"""Checks that an obstacle looks at the surface, which starts in front of it, and is met once."""

import warnings
from collections.abc import Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from ..base.errors import ContactInputError
from ..obstacles.rigid_pairing import RigidPairing
from ..obstacles.two_bodies import TwoBodies
from ..surfaces.faces import facets_in_common
from ..surfaces.naming import named
from .contact import Contact

#: Nodes are at the obstacle at gaps below this fraction of their facets' size.
TOUCH = 1e-8
#: Cosine from which two normals clearly point the same way; those at right angles may still turn.
ALONG = 0.1

CURE = (
    "Reverse the normal of a plane, take inside=False for a body outside, flip=True for a "
    "RigidSurface, or tag the other side of the body."
)


def check_sides(contact: Contact) -> None:
    """Warn of an obstacle that looks away from the surface, or refuse it; collective.

    Args:
        contact: The contact, after ``bind``.

    Raises:
        ContactInputError: If it looks away from the surface everywhere, and nodes are at it or
            behind it; or if all nodes are behind it, and it looks away from some of them.
    """
    view = contact.pairing.view(contact.pairing.side.u)
    n, d = contact.surface.num_owned, contact.surface.mesh.geometry.dim
    touch = TOUCH * contact.surface.size.x.array[:n] ** (1.0 / (d - 1))
    at, wrong = view.gap <= touch, view.cosine > ALONG
    comm = contact.surface.mesh.comm
    total, facing, bad, behind = comm.allreduce(
        np.array(
            [n, np.sum(view.cosine < 0.0), np.sum(at & wrong), np.sum(view.gap < -touch)], dtype=int
        )
    )
    message = None
    if facing == 0:
        message = (
            f"the obstacle's normal opposes the surface's outward normal at none of the {total} "
            f"nodes; {bad} of them are at the obstacle or behind it."
        )
    elif behind == total and bad > 0:
        message = (
            f"all {total} nodes are behind the obstacle, at {bad} of them its normal points the "
            "same way as the surface's outward normal."
        )
    if message is not None:
        nodes = named(contact.surface, np.flatnonzero(at & wrong), view.gap)
        message = f"Contact '{contact.surface.name}': {message}{nodes} {CURE}"
        if bad > 0:
            raise ContactInputError(message)
        warnings.warn(message, stacklevel=3)
    _warn_of_penetration(contact, view.lost)


def _warn_of_penetration(contact: Contact, lost: npt.NDArray[np.floating]) -> None:
    """Warn of nodes that start too deep in the obstacle to meet it; collective."""
    nodes = np.flatnonzero(lost > 0.0)
    if number := contact.surface.mesh.comm.allreduce(len(nodes)):
        warnings.warn(
            f"Contact '{contact.surface.name}': {number} nodes start deeper behind a face that "
            "looks at them than SearchPolicy.reach and count as open: enlarge reach, use "
            f"close_initial_gaps, or check the tags.{named(contact.surface, nodes, -lost)}",
            stacklevel=4,
        )


def _same_obstacle(a: RigidPairing, b: RigidPairing) -> bool:
    """Tell whether rigid obstacles look the same at all common nodes; collective."""
    one, two = (p.side.parent_dofs[: p.side.surface.num_owned] for p in (a, b))
    _, i, j = np.intersect1d(one, two, return_indices=True)
    surface = a.side.surface
    sizes = surface.size.x.array[i] ** (1.0 / (surface.mesh.geometry.dim - 1))
    met = a.meeting()[i] | b.meeting()[j]
    same = abs(a.gaps()[i] - b.gaps()[j]) <= TOUCH * sizes
    same &= np.sum(a.normals()[i] * b.normals()[j], axis=1) > 1.0 - TOUCH
    number, alike = surface.mesh.comm.allreduce(np.array([np.sum(met), np.sum(met & same)]))
    return bool(0 < number == alike)


def check_met_once(contacts: Sequence[Contact]) -> None:
    """Raise where faces meet the same obstacle in two contacts; collective.

    Args:
        contacts: The contacts, after ``bind``.

    Raises:
        ContactInputError: If each condition would be there twice, from whichever side.
    """
    rigid = [p for k in contacts if isinstance(p := k.pairing, RigidPairing)]
    for p, q in combinations(rigid, 2):
        one, two = p.side.surface, q.side.surface
        if not (facets_in_common(one, two) and _same_obstacle(p, q)):
            continue
        message = (
            f"Contacts '{one.name}' and '{two.name}' have faces in common that meet the same rigid "
            "obstacle: nobody could tell which of them carries what."
        )
        if p.obstacle.motion is q.obstacle.motion:
            raise ContactInputError(
                f"{message} Keep one of them, or leave these faces out of a surface."
            )
        warnings.warn(f"{message} Move one of the two away at first.", stacklevel=3)
    pairs = [(k.surface, p.primary) for k in contacts if isinstance(p := k.pairing, TwoBodies)]
    for (a, b), (c, d) in combinations(pairs, 2):
        if any(
            facets_in_common(*p) and facets_in_common(*q)
            for p, q in (((a, c), (b, d)), ((a, d), (b, c)))
        ):
            raise ContactInputError(
                f"Contacts '{a.name}' and '{c.name}' have faces of the same two surfaces meet each "
                "other: whatever presses there would be counted twice. Keep one of them, or leave "
                "these faces out of a surface."
            )
