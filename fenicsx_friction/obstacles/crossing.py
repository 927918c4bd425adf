# SPDX-License-Identifier: MIT
"""Crossings: which nodes have gone through the other surface within a step?

Within a step nodes and faces move on straight lines, as seen from the moving primary surface. Its
mean rigid motion is subtracted first, so that a common motion, however large, crosses nothing.
A node crosses a face where it is behind it by ``depth``. This excludes nodes that slide along the
face, rounding, and the warp of quadrilaterals, which are cut into triangles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from scipy.spatial import cKDTree

from ..surfaces.face_cells import Array
from ..surfaces.faces import Faces, FaceSet
from .search import flat
from .ways import Indices, Mask, Way, area_vectors, sign_changes, simplices

#: A node is behind a face from this fraction of the mean face on, plus what the face is warped.
DEPTH = 1e-3
#: A node may enter a face up to this fraction beyond its edges ...
ENTER = 0.005
#: ... and leave it up to this one: a path that leaves near an edge must find one of its faces.
LEAVE = 0.1
#: Cosine of the normals of entry and exit from which the exit is on the far side.
FAR_SIDE = -0.1
#: Nodes that are tested together.
BLOCK = 512


@dataclass(frozen=True)
class Motion:
    """Positions at the beginning and at the end of a step.

    Attributes:
        face_x: Nodes of the faces (m), beginning and end.
        x: Nodes that meet them (m).
        directions: Their averaged normals.
    """

    face_x: tuple[Array, Array]
    x: tuple[Array, Array]
    directions: tuple[Array, Array]

    @classmethod
    def between(
        cls,
        faces: Faces,
        nodes: FaceSet,
        ends: tuple[fem.Function, fem.Function],
        offset: Array,
    ) -> Motion:
        """Return the motion of faces and owned nodes between two displacements; collective.

        The nodes are moved outwards by their offsets (m): where gaps count from.
        """
        positions = [nodes.positions(u) for u in ends]
        first, second = (nodes.node_normals(x)[nodes.own] for x in positions)
        x, y = (x[nodes.own] for x in positions)
        return cls(
            face_x=(faces.positions(ends[0]), faces.positions(ends[1])),
            x=(x + offset[:, None] * first, y + offset[:, None] * second),
            directions=(first, second),
        )


@dataclass(frozen=True)
class _Events:
    """Crossings of the planes of triangles inside their edges, one row an event.

    Attributes:
        node: The node.
        time: When, from 0 to 1.
        entering: From the front to the back, not back.
        looks: The face looks at the node.
        normal: Its normal then.
        depth: How far behind the face the node ends (m).
        aside: How far it moves along the face after the event (m).
    """

    node: Indices
    time: Array
    entering: Mask
    looks: Mask
    normal: Array
    depth: Array
    aside: Array


def find_crossed(
    faces: Faces, motion: Motion, watched: Mask, started: Indices, depth: float = DEPTH
) -> Mask:
    """Tell which nodes have gone behind a face, or through a body, within the step.

    A node enters a face that looks at it. If its last event is then an exit through a face on the
    near side or on a flank, it has cut a corner, which is allowed. A node beyond the edge of the
    surface has gone over the edge if it moved more along the face than behind it.

    Args:
        faces: The faces.
        motion: Positions in the step.
        watched: Nodes to be tested.
        started: Face of each node at the beginning, or -1. A node that is behind it already counts
            as just entering.
        depth: From where on a node is behind a face, as a fraction of the mean face.
    """
    motion = _seen_from_faces(motion)
    crossed = np.zeros(len(watched), dtype=bool)
    behind = depth * faces.size + _warp(faces, motion) / 8.0
    for i, f in _candidates(faces, motion, watched):
        triangles = [simplices(faces.cell, face_x[faces.faces[f]]) for face_x in motion.face_x]
        parts, d = triangles[0].shape[1:3]
        node, start = np.repeat(i, parts), np.repeat(f == started[i], parts)
        first, last = (t.reshape(-1, d, d) for t in triangles)
        (x, y), (n, m) = ([end[node] for end in ends] for ends in (motion.x, motion.directions))
        way = Way((x, y - x), (first, last - first), (n, m - n))
        events = _events(way, node, start, behind)
        crossed |= _verdict(events, way, node, behind, len(watched))
    return crossed


def _seen_from_faces(motion: Motion) -> Motion:
    """Subtract the mean rigid motion of the faces from the positions at the end."""
    old, new = motion.face_x
    c, d = old.mean(axis=0), new.mean(axis=0)
    U, _, Vt = np.linalg.svd((old - c).T @ (new - d))
    sign = np.ones(len(c))
    sign[-1] = np.sign(np.linalg.det(U @ Vt))
    back = Vt.T @ (sign[:, None] * U.T)
    return Motion(
        (old, (new - d) @ back + c),
        (motion.x[0], (motion.x[1] - d) @ back + c),
        (motion.directions[0], motion.directions[1] @ back),
    )


def _warp(faces: Faces, motion: Motion) -> float:
    """Return the largest warp (m) of a face; its triangles are an eighth of it away from it."""
    twist = faces.cell.twist()
    if twist is None:
        return 0.0
    corners = np.concatenate([x[faces.faces] for x in motion.face_x])
    lengths = np.linalg.norm(np.einsum("i,nid->nd", np.array(twist), corners), axis=1)
    return float(np.max(lengths, initial=0.0))


def _candidates(faces: Faces, motion: Motion, watched: Mask) -> Iterator[tuple[Indices, Indices]]:
    """Yield nodes and faces that may meet, from balls about the middles of their ways."""
    corners = [x[faces.faces] for x in motion.face_x]
    centers = [c.mean(axis=1) for c in corners]
    radius = np.max(
        [
            np.max(np.linalg.norm(c - m[:, None], axis=2), axis=1)
            for c, m in zip(corners, centers, strict=True)
        ],
        axis=0,
    )
    size = radius * (1.0 + LEAVE) + np.linalg.norm(centers[1] - centers[0], axis=1) / 2.0
    middle = (centers[0] + centers[1]) / 2.0
    tree = cKDTree(middle)
    nodes = np.flatnonzero(watched)
    for start in range(0, len(nodes), BLOCK):
        block = nodes[start : start + BLOCK]
        x = (motion.x[0][block] + motion.x[1][block]) / 2.0
        half = np.linalg.norm(motion.x[1][block] - motion.x[0][block], axis=1) / 2.0
        near = tree.query_ball_point(x, half + np.max(size))
        k, f = flat(near)
        meet = np.linalg.norm(x[k] - middle[f], axis=1) <= half[k] + size[f]
        if np.any(meet):
            yield block[k[meet]], f[meet]


def _events(way: Way, node: Indices, start: Mask, depth: float) -> _Events:
    """Find all events; ``start`` marks the simplices that nodes had in front at the beginning."""
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
    beyond = np.maximum(ENTER, depth / np.maximum(size, depth))
    inside = np.min(place, axis=1) >= -np.where(entering, beyond, LEAVE)
    _, last = met.place(1.0)
    moved = x - np.einsum("nk,nkd->nd", place, corners)
    behind_by = -np.sum(moved * last, axis=1)
    aside = np.linalg.norm(moved + behind_by[:, None] * last, axis=1)
    looks = met.looks(time, normal)
    kept = inside & (looks | ~entering)
    columns = (node[rows], time, entering, looks, normal, behind_by, aside)
    return _Events(*(column[kept] for column in columns))


def _verdict(events: _Events, way: Way, node: Indices, depth: float, number: int) -> Mask:
    """Judge each node by its last entry and its last event."""
    entry, last = (np.full(number, -1, dtype=np.int64) for _ in range(2))
    order = np.argsort(events.time, kind="stable")
    entries = order[events.entering[order]]
    entry[events.node[entries]] = entries  # the last assignment stays
    last[events.node[order]] = order
    entered = np.flatnonzero(entry >= 0)
    first, final = entry[entered], last[entered]
    away = np.sum(events.normal[first] * events.normal[final], axis=1) < FAR_SIDE
    through = ~events.entering[final] & ~events.looks[final] & away
    covered = np.zeros(number, dtype=bool)
    covered[node[_is_behind(way, depth)]] = True
    over_the_edge = ~covered[entered] & (events.aside[first] > events.depth[first])
    crossed = np.zeros(number, dtype=bool)
    crossed[entered] = np.where(events.entering[final], ~over_the_edge, through)
    return crossed


def _is_behind(way: Way, depth: float) -> Mask:
    """Tell which nodes end behind a simplex that looks at them, inside its edges."""
    place, normal = way.place(1.0)
    x, corners = way.at(1.0)
    behind = np.sum(normal * (x - corners[:, 0]), axis=1) < -depth
    return np.asarray(behind & (np.min(place, axis=1) >= -ENTER) & way.looks(1.0, normal))
