# SPDX-License-Identifier: MIT
"""Passages: which nodes have gone through a rigid obstacle on their way to where they are?

A node is open before and after it has passed right through a small obstacle within one step. Its
way is a straight line in the frame of the obstacle. It has passed if it dives into the obstacle
and the normals of entry and exit oppose each other: a node that rolls along cuts a corner only.
"""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from .motion import RigidMotion
from .side import Side

#: Points on a way. What is thinner than this part of it may be missed.
SAMPLES = 32
#: Nodes dive into an obstacle at gaps below this fraction of their facets' size.
DIVE = 1e-6

Array = npt.NDArray[np.floating]
Mask = npt.NDArray[np.bool_]


def ways(
    contact: Side, u: fem.Function, u_old: fem.Function, motion: RigidMotion | None
) -> tuple[Array, Array]:
    """Return start and end (m) of the local nodes' ways, beside the obstacle where it is now."""
    d = contact.surface.mesh.geometry.dim
    X = contact.surface.S.tabulate_dof_coordinates()[:, :d]
    old, new = (X + f.x.array.reshape(-1, d)[contact.parent_dofs] for f in (u_old, u))
    return (old if motion is None else motion.carried(old)), new


def through_ball(start: Array, end: Array, radius: float) -> Mask:
    """Tell which ways pass through a ball about the origin.

    The normals of entry and exit enclose more than a right angle on chords that come nearer to the
    center than ``radius / sqrt(2)``.
    """
    way = end - start
    length = np.maximum(np.sum(way * way, axis=1), np.finfo(float).tiny)
    t = np.clip(-np.sum(start * way, axis=1) / length, 0.0, 1.0)
    nearest = np.linalg.norm(start + t[:, None] * way, axis=1)
    return np.asarray(nearest < np.sqrt(0.5) * radius)


def through_anything(contact: Side, u: fem.Function, start: Array, end: Array, open_: Mask) -> Mask:
    """Tell which open nodes' ways pass through the contact's obstacle, by its gap; collective.

    Looked at are ways longer than the gaps at both ends (a shorter one meets nothing where gaps
    are distances), and those whose normals at the ends oppose each other. ``u`` is as before
    afterwards.
    """
    n, d = len(open_), start.shape[1]
    area = contact.surface.area.x.array[:n]
    dive = -DIVE * area ** (1.0 / (d - 1))
    values = u.x.array.reshape(-1, d)
    kept, end_u = values.copy(), values[contact.parent_dofs]

    def look(t: float) -> tuple[Array, Array]:
        """Return gaps and normals on the way."""
        values[contact.parent_dofs] = end_u + (1.0 - t) * (start - end)
        return contact.gap_and_friction()[0], contact.nodal_normal()

    try:
        return _sampled(look, np.linalg.norm(end - start, axis=1)[:n], dive, open_, contact)
    finally:
        values[:] = kept


def _sampled(
    look: Callable[[float], tuple[Array, Array]],
    length: Array,
    dive: Array,
    open_: Mask,
    contact: Side,
) -> Mask:
    """Follow the ways; collective."""
    (gap, before), (last_gap, last_normal) = look(0.0), look(1.0)
    turned = np.sum(before * last_normal, axis=1) < 0.0
    far = open_ & (turned | (length > gap + last_gap))
    passed = np.zeros_like(open_)
    if not contact.surface.mesh.comm.allreduce(bool(np.any(far)), MPI.LOR):
        return passed
    inside = gap < dive
    for t in np.linspace(0.0, 1.0, SAMPLES + 1)[1:]:
        gap, normal = look(t)
        was_inside, inside = inside, gap < dive
        passed |= was_inside & ~inside & (np.sum(before * normal, axis=1) < 0.0)
        before = np.where(inside[:, None], before, normal)
    return passed & far
