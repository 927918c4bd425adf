# SPDX-License-Identifier: MIT
"""Passages: which nodes have gone through a rigid obstacle within a step?

A node that passes through a small obstacle within one step is open before and after it. Its way is
a straight line in the frame of the obstacle. It has passed through if it dives into the obstacle
and the normals of entry and exit oppose each other. A node that only cuts a corner has not.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from ..base.collective import any_rank
from .kinematics import Array
from .motion import Motion
from .pairing import Mask
from .side import Side

#: Points on a way. An obstacle thinner than the way over this number may be missed.
SAMPLES = 32
#: Nodes dive into an obstacle at gaps below this fraction of their facets' size.
DIVE = 1e-6


class Travelling(Protocol):
    """Nodes, or points beside them, that are on their way through a step."""

    side: Side

    def look(self, start: Array, end: Array) -> Callable[[float], tuple[Array, Array]]:
        """Return what finds gaps and normals on ways, changing the displacement."""

    def sizes(self) -> Array:
        """Return the sizes (m) of the facets where the obstacle is met, one a point."""

    def outward(self) -> Array | None:
        """Return the body's outward normals where open points may be inside the obstacle."""


def ways(side: Side, motion: Motion | None) -> tuple[Array, Array]:
    """Return start and end (m) of the local nodes' ways, beside the obstacle where it is now."""
    X = side.surface.S.tabulate_dof_coordinates()[:, : side.d]
    old, new = (X + f.x.array.reshape(-1, side.d)[side.parent_dofs] for f in (side.u_old, side.u))
    return (old if motion is None else motion.carried(old)), new


def through_ball(start: Array, end: Array, radius: float) -> Mask:
    """Tell which ways pass through a ball about the origin.

    On a chord nearer to the center than ``radius / sqrt(2)``, the normals of entry and exit enclose
    more than a right angle.
    """
    way = end - start
    length = np.maximum(np.sum(way * way, axis=1), np.finfo(float).tiny)
    t = np.clip(-np.sum(start * way, axis=1) / length, 0.0, 1.0)
    nearest = np.linalg.norm(start + t[:, None] * way, axis=1)
    return np.asarray(nearest < np.sqrt(0.5) * radius)


def through_anything(
    side: Side,
    look: Callable[[float], tuple[Array, Array]],
    length: Array,
    size: Array,
    open_: Mask,
    outward: Array | None = None,
) -> Mask:
    """Tell which open points' ways pass through the obstacle, by its gap; collective.

    It tests ways longer than the gaps at both ends together (a shorter way meets nothing where gaps
    are distances), and ways whose normals at the ends oppose each other. It puts the displacement
    back.

    Args:
        side: The side.
        look: Returns gaps (m) and normals on the ways, from 0 to 1, and changes the displacement.
        length: Of the ways (m).
        size: Of the facets round the points (m).
        open_: Points to be tested.
        outward: Outward normals of the body. Points that start inside the obstacle came in against
            them, in an earlier step; without, they came in where they are.
    """
    kept = side.u.x.array.copy()
    try:
        return _sampled(side, look, length, size, open_, outward)
    finally:
        side.u.x.array[:] = kept


def _sampled(
    side: Side,
    look: Callable[[float], tuple[Array, Array]],
    length: Array,
    size: Array,
    open_: Mask,
    outward: Array | None,
) -> Mask:
    """Follow the ways; collective."""
    dive = -DIVE * size
    (gap, before), (last_gap, last_normal) = look(0.0), look(1.0)
    if outward is not None:
        before = np.where((gap < dive)[:, None], -outward, before)
    turned = np.sum(before * last_normal, axis=1) < 0.0
    far = open_ & (turned | (length > gap + last_gap))
    passed = np.zeros_like(open_)
    if not any_rank(side.surface.mesh.comm, bool(np.any(far))):
        return passed
    inside = gap < dive
    for t in np.linspace(0.0, 1.0, SAMPLES + 1)[1:]:
        gap, normal = look(t)
        was_inside, inside = inside, gap < dive
        passed |= was_inside & ~inside & (np.sum(before * normal, axis=1) < 0.0)
        before = np.where(inside[:, None], before, normal)
    return passed & far
