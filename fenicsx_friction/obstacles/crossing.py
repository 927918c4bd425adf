# SPDX-License-Identifier: MIT
"""Crossings: which nodes have gone through another surface within a step?

Within a step nodes and faces move on straight lines, as seen from the moving faces. Their mean
rigid motion is subtracted first, so that a common motion, however large, crosses nothing. A node
crosses a face where it is behind it by some depth. This excludes nodes that slide along the face,
rounding, and the warp of quadrilaterals, which are cut into triangles. Beside faces that hold it at
the end, a node may be deeper: between nodes, two surfaces meet on average only.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy
from dolfinx import fem

from ..surfaces.face_cells import Array
from ..surfaces.faces import Faces
from .candidates import BLOCK, flat
from .crossing_events import LEAVE, Events, ends_behind, find_events
from .ways import Indices, Mask, Way, simplices

#: From where on a node is behind a face (m): of each face, of each node. The smaller one counts.
Depths = tuple[Array, Array]

#: A node is behind a face from this fraction of the smaller face on, plus what the face is warped.
DEPTH = 1e-3
#: The same for faces that hold the node, and those beside them.
HELD_DEPTH = 0.5
#: Cosine of the normals of entry and exit from which the exit is on the far side.
FAR_SIDE = -0.1


@dataclass(frozen=True)
class Trail:
    """Where the nodes of a surface are at the beginning and at the end of a step.

    Attributes:
        surface: The surface.
        x: Their positions (m).
        normals: Their averaged normals.
    """

    surface: Faces
    x: tuple[Array, Array]
    normals: tuple[Array, Array]

    @classmethod
    def of(
        cls, surface: Faces, ends: tuple[fem.Function, fem.Function], offset: Array | None = None
    ) -> Trail:
        """Return the trail of all nodes between two displacements; collective.

        With offsets (m), the nodes are moved outwards by these: where gaps count from.
        """
        x, y = (surface.positions(u) for u in ends)
        n, m = (surface.node_normals(z) for z in (x, y))
        if offset is not None:
            x, y = x + offset[:, None] * n, y + offset[:, None] * m
        return cls(surface, (x, y), (n, m))

    def seen_by(
        self, nodes: Trail, own: slice, part: float | Array, doubt: float, held_depths: Depths
    ) -> Motion:
        """Return how some nodes move before the faces of this surface.

        Args:
            nodes: The trail of the nodes' surface.
            own: These nodes.
            part: From which part of the smaller face on a node is behind a face, for all nodes or
                for each.
            doubt: How far (m) a node may be behind besides.
            held_depths: See :class:`Motion`.
        """
        sizes = self.surface.sizes, nodes.surface.node_sizes()[own]
        return Motion(
            face_x=self.x,
            x=(nodes.x[0][own], nodes.x[1][own]),
            directions=(nodes.normals[0][own], nodes.normals[1][own]),
            depths=(float(np.max(part, initial=0.0)) * sizes[0] + doubt, part * sizes[1] + doubt),
            held_depths=held_depths,
        )


@dataclass(frozen=True)
class Motion:
    """How nodes and faces move in a step: positions at the beginning and at the end.

    Attributes:
        face_x: Nodes of the faces (m).
        x: Nodes that meet them (m).
        directions: Their averaged normals.
        depths: From where on a node is behind a face.
        held_depths: The same for faces that hold the node; as for others by default.
        aslant: Cosine of the normals up to which nodes enter faces.
        at_rest: The faces do not move, and who passes beside them has not entered them.
    """

    face_x: tuple[Array, Array]
    x: tuple[Array, Array]
    directions: tuple[Array, Array]
    depths: Depths
    held_depths: Depths | None = None
    aslant: float = 0.0
    at_rest: bool = False


def find_crossed(
    faces: Faces, motion: Motion, started: Indices, met: scipy.sparse.csr_array | None = None
) -> Indices:
    """Return the face that each node has gone behind, or through with the body, in a step, or -1.

    A node enters a face that looks at it. If its last event is then an exit through a face on the
    near side or on a flank, it has cut a corner, which is allowed. A node beyond the edge of the
    surface has gone over the edge if it moved more along the face than behind it.

    Args:
        faces: The faces.
        motion: Positions in the step.
        started: Face of each node at the beginning, or -1. A node that is behind it already counts
            as just entering.
        met: Which nodes (rows) are held by which faces at the end.
    """
    motion = _seen_from_faces(motion)
    crossed = np.full(len(started), -1, dtype=np.int64)
    warp, number = _warp(faces, motion) / 8.0, len(faces.faces)
    held = np.zeros(0, dtype=np.int64) if met is None else _keys(met)  # sorted
    for i, f in _candidates(faces, motion):
        triangles = [simplices(faces.cell, face_x[faces.faces[f]]) for face_x in motion.face_x]
        parts, d = triangles[0].shape[1:3]
        first, last = (t.reshape(-1, d, d) for t in triangles)
        by_held = _among(held, i * number + f)
        of_face, of_node = (
            np.where(by_held, deep[j], depth[j])
            for depth, deep, j in zip(
                motion.depths, motion.held_depths or motion.depths, (f, i), strict=True
            )
        )
        depth = np.minimum(of_face, of_node) + warp
        node, face, start, depth = (np.repeat(a, parts) for a in (i, f, f == started[i], depth))
        (x, y), (n, m) = ([end[node] for end in ends] for ends in (motion.x, motion.directions))
        way = Way((x, y - x), (first, last - first), (n, m - n))
        events = find_events(way, start, depth, motion.aslant, at_rest=motion.at_rest)
        covers = ends_behind(way, depth)
        nodes, rows = _verdict(events, node, covers, len(crossed))
        crossed[nodes] = face[rows]
    return crossed


def _keys(met: scipy.sparse.csr_array) -> Indices:
    """Return the pairs of nodes and faces of a matrix as numbers, sorted."""
    pairs = met.tocoo()
    return np.sort(pairs.row.astype(np.int64) * met.shape[1] + pairs.col)


def _among(sorted_keys: Indices, keys: Indices) -> Mask:
    """Tell which keys are among others, in a time that hardly grows with their number."""
    place = np.searchsorted(sorted_keys, keys)
    inside = place < len(sorted_keys)
    result = np.zeros(len(keys), dtype=bool)
    result[inside] = sorted_keys[place[inside]] == keys[inside]
    return result


def _seen_from_faces(motion: Motion) -> Motion:
    """Subtract the mean rigid motion of the faces from the positions at the end."""
    old, new = motion.face_x
    c, d = old.mean(axis=0), new.mean(axis=0)
    U, _, Vt = np.linalg.svd((old - c).T @ (new - d))
    sign = np.ones(len(c))
    sign[-1] = np.sign(np.linalg.det(U @ Vt))
    back = Vt.T @ (sign[:, None] * U.T)
    return replace(
        motion,
        face_x=(old, (new - d) @ back + c),
        x=(motion.x[0], (motion.x[1] - d) @ back + c),
        directions=(motion.directions[0], motion.directions[1] @ back),
    )


def _warp(faces: Faces, motion: Motion) -> float:
    """Return the largest warp (m) of a face; its triangles are an eighth of it away from it."""
    twist = faces.cell.twist()
    if twist is None:
        return 0.0
    corners = np.concatenate([x[faces.faces] for x in motion.face_x])
    lengths = np.linalg.norm(np.einsum("i,nid->nd", np.array(twist), corners), axis=1)
    return float(np.max(lengths, initial=0.0))


def _candidates(faces: Faces, motion: Motion) -> Iterator[tuple[Indices, Indices]]:
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
    tree = scipy.spatial.cKDTree(middle)
    nodes = np.arange(len(motion.x[0]))
    for start in range(0, len(nodes), BLOCK):
        block = nodes[start : start + BLOCK]
        x = (motion.x[0][block] + motion.x[1][block]) / 2.0
        half = np.linalg.norm(motion.x[1][block] - motion.x[0][block], axis=1) / 2.0
        near = tree.query_ball_point(x, half + np.max(size))
        k, f = flat(near)
        meet = np.linalg.norm(x[k] - middle[f], axis=1) <= half[k] + size[f]
        if np.any(meet):
            yield block[k[meet]], f[meet]


def _verdict(events: Events, node: Indices, covers: Mask, number: int) -> tuple[Indices, Indices]:
    """Judge each node by its last entry and its last event.

    Args:
        events: Events of pairs of nodes and simplices.
        node: The node of each pair.
        covers: Pairs whose node ends behind the simplex.
        number: Number of nodes.

    Returns:
        Nodes that have crossed, and the pairs at which they entered.
    """
    entry, last = (np.full(number, -1, dtype=np.int64) for _ in range(2))
    order = np.argsort(events.time, kind="stable")
    entries = order[events.entering[order]]
    of_event = node[events.row]
    entry[of_event[entries]] = entries  # the last assignment stays
    last[of_event[order]] = order
    entered = np.flatnonzero(entry >= 0)
    first, final = entry[entered], last[entered]
    away = np.sum(events.normal[first] * events.normal[final], axis=1) < FAR_SIDE
    through = ~events.entering[final] & ~events.looks[final] & away
    covered = np.zeros(number, dtype=bool)
    covered[node[covers]] = True
    over_the_edge = ~covered[entered] & (events.aside[first] > events.depth[first])
    crossed = np.where(events.entering[final], ~over_the_edge, through)
    return entered[crossed], events.row[first[crossed]]
