# SPDX-License-Identifier: MIT
"""Sinking: how deep are points inside a body of faces, whichever of these they meet?

A point meets one face. It may slide along that face into a wall that it does not meet, because the
wall stands at right angles to the body there. Its gap does not tell this; the nearest face does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy

from ..surfaces.face_cells import (
    Array,
    blend,
    distances,
    normals,
    on_segments,
    project,
    shape_matrix,
)
from ..surfaces.faces import Faces
from .candidates import BLOCK, TIE, balls, flat

Indices = npt.NDArray[np.int64]


def depths_inside(faces: Faces, x: Array, directions: Array, ends: Array, facing: float) -> Array:
    """Return how deep (m) points are behind their nearest faces, zero in front.

    At an edge several faces are the nearest: that which looks most along the way to the point
    tells. Beyond an open edge there is no inside.

    Args:
        faces: The faces, where they are.
        x: The points (m).
        directions: Normals of the body's surface at the points.
        ends: Corners of the open edges of the faces (n, 1 or 2, d).
        facing: Cosine of the normals of face and body from which on a face does not count.
    """
    result = np.zeros(len(x))
    if len(x) == 0:  # most often
        return result
    center, radius = balls(faces.X[faces.faces])
    tree, largest = scipy.spatial.cKDTree(center), np.max(radius)
    for start in range(0, len(x), BLOCK):
        points = x[start : start + BLOCK]
        middle = tree.query(points)[0]
        i, f = flat(tree.query_ball_point(points, middle + largest))
        # A nearest face, or one as near, is no farther than the nearest middle of all.
        away = np.linalg.norm(points[i] - center[f], axis=1)
        near = away - radius[f] <= middle[i] + TIE * faces.size
        i, f = i[near], f[near]
        nearest, row, front = _nearest(faces, points, i, f)
        normal = _normal(faces, f[row])
        seen = np.sum(normal * directions[start : start + BLOCK], axis=1) < facing
        behind = np.flatnonzero((front < 0.0) & seen)
        behind = behind[~_at_edges(points[behind], nearest[behind] + TIE * faces.size, ends)]
        result[start + behind] = nearest[behind]
    return result


def _nearest(faces: Faces, x: Array, i: Indices, f: Indices) -> tuple[Array, Indices, Array]:
    """Return for each point the distance to the faces, the pair that tells the side, and how far.

    Args:
        faces: The faces.
        x: The points (m).
        i: Points, each with the faces that may be its nearest,
        f: these faces.
    """
    cell, corners = faces.cell, faces.X[faces.faces[f]]
    xi = project(cell, corners, x[i])
    away = distances(cell, corners, x[i], xi)
    nearest = np.full(len(x), np.inf)
    np.minimum.at(nearest, i, away)
    point = blend(shape_matrix(cell, cell.inside(xi)), corners)
    front = np.sum(_normal(faces, f) * (x[i] - point), axis=1)
    tied = away <= nearest[i] + TIE * faces.size
    order = np.lexsort((-abs(front), ~tied, i))
    row = order[np.searchsorted(i[order], np.arange(len(x)))]
    return nearest, row, front[row]


def _normal(faces: Faces, f: Indices) -> Array:
    """Return the normals in the middle of faces."""
    corners = faces.X[faces.faces[f]]
    return normals(faces.cell, corners, np.tile(faces.cell.center, (len(f), 1)))


def _at_edges(x: Array, radius: Array, ends: Array) -> npt.NDArray[np.bool_]:
    """Tell which points have one of the edges within a radius of their own."""
    result = np.zeros(len(x), dtype=bool)
    for k, point in enumerate(x):  # there are few
        away = np.linalg.norm(point - on_segments(ends[:, 0], ends[:, -1], point), axis=1)
        result[k] = np.min(away, initial=np.inf) <= radius[k]
    return result
