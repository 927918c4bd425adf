# SPDX-License-Identifier: MIT
"""Events: when nodes go through the planes of faces within their edges, and which way."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..surfaces.face_cells import Array
from .ways import Indices, Mask, Way, area_vectors, sign_changes

#: A node may enter a face up to this fraction beyond its edges ...
ENTER = 0.005
#: ... and leave it up to this one: a path that leaves near an edge must find one of its faces.
LEAVE = 0.1
#: Rounding of places in simplices.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Events:
    """Nodes go through the planes of simplices inside their edges, one row an event.

    Attributes:
        row: The pair of node and simplex.
        time: When, from 0 to 1.
        entering: From the front to the back, not back.
        looks: The face looks at the node.
        normal: Its normal then.
        depth: How far behind the face the node ends (m).
        aside: How far it moves along the face afterwards (m).
    """

    row: Indices
    time: Array
    entering: Mask
    looks: Mask
    normal: Array
    depth: Array
    aside: Array

    def take(self, kept: Mask) -> Events:
        """Return some events."""
        return Events(*(getattr(self, f.name)[kept] for f in fields(self)))


def find_events(
    way: Way, start: Mask, depth: Array, aslant: float = 0.0, *, at_rest: bool = False
) -> Events:
    """Find all events of pairs of nodes and simplices.

    Args:
        way: The pairs.
        start: Simplices that nodes had in front of them at the beginning.
        depth: From where on a node is behind its simplex (m).
        aslant: Cosine of the normals up to which nodes enter simplices; they come out on the near
            side where it is less than minus this.
        at_rest: The simplices do not move: who is beyond one of their edges at both ends of the way
            was so all the time.
    """
    levels = [depth * np.linalg.norm(area_vectors(way.at(t)[1]), axis=1) for t in (0.0, 1.0)]
    degree = way.corners[0].shape[1]
    times = np.linspace(0.0, 1.0, degree + 1)
    values = np.stack([way.volume(t) for t in times])
    values += np.outer(1.0 - times, levels[0]) + np.outer(times, levels[1])
    polynomials = np.linalg.solve(np.vander(times, increasing=True), values)
    rows, time, entering = sign_changes(polynomials)
    behind = np.flatnonzero(start & (values[0] < 0.0))
    rows = np.concatenate([behind, rows])
    time = np.concatenate([np.zeros(len(behind)), time])
    entering = np.concatenate([np.ones(len(behind), dtype=bool), entering])

    met = way.take(rows)
    place, normal = met.place(time)
    x, corners = met.at(1.0)
    size = np.linalg.norm(area_vectors(corners), axis=1) ** (1.0 / (degree - 1))
    # Behind the fold of two faces that look at each other neither is entered within its edges.
    beyond = np.maximum(ENTER, depth[rows] / np.maximum(size, depth[rows]))
    inside = np.min(place, axis=1) >= -np.where(entering, beyond, LEAVE)
    end, last = met.place(1.0)
    if at_rest:
        first, _ = met.place(0.0)
        beside = (np.maximum(first, end) < ROUNDING) & (np.minimum(first, end) < -ROUNDING)
        inside &= ~(entering & np.any(beside, axis=1))
    moved = x - np.einsum("nk,nkd->nd", place, corners)
    behind_by = -np.sum(moved * last, axis=1)
    aside = np.linalg.norm(moved + behind_by[:, None] * last, axis=1)
    enters, looks = (met.looks(time, normal, facing) for facing in (aslant, -aslant))
    kept = inside & (enters | ~entering)
    columns = (rows, time, entering, looks, normal, behind_by, aside)
    return Events(*(column[kept] for column in columns))


def ends_behind(way: Way, depth: Array) -> Mask:
    """Tell which nodes end behind a simplex that looks at them, inside its edges."""
    place, normal = way.place(1.0)
    x, corners = way.at(1.0)
    behind = np.sum(normal * (x - corners[:, 0]), axis=1) < -depth
    return np.asarray(behind & (np.min(place, axis=1) >= -ENTER) & way.looks(1.0, normal))
