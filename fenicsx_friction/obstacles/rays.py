# SPDX-License-Identifier: MIT
"""Rays: where a line from a point of one surface meets a face of another."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..surfaces.face_tables import normals_of
from ..surfaces.lagrange_faces import LagrangeFaces
from .clipping import cross

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]

#: Newton iterations, and the step in the face's coordinates after which the error, its square, is
#: rounding.
MAX_IT, TOLERANCE = 25, 1e-8


def cast(
    faces: LagrangeFaces,
    x: Array,
    face: Indices,
    start: Array,
    along: Array,
    eta: Array | None = None,
) -> tuple[Array, Array]:
    """Find where lines meet faces, which extend beyond their edges.

    Args:
        faces: The faces.
        x: Positions of their dofs (m).
        face: The face of each line.
        start: Points of the lines (m).
        along: Their unit directions.
        eta: Where to begin.

    Returns:
        Places on the faces; and how far before them the points are, against the direction (m). Not
        a number where the search fails.
    """
    corners = faces.at_dofs(x, face)
    gap: Array = np.zeros(len(face))
    place = np.tile(faces.centers.mean(axis=0), (len(face), 1)) if eta is None else eta.copy()
    left = np.arange(len(face))
    failed, before = np.zeros(len(face), dtype=bool), np.zeros(len(face))
    with np.errstate(all="ignore"):
        for _ in range(MAX_IT):
            rows = left if len(left) < len(face) else slice(None)  # most often: no copies
            at = place[rows]
            around = faces.table(at) @ corners[rows]  # foot, then tangents; faster than einsum
            way = start[rows] - around[:, 0]
            step, gap[rows] = split(around[:, 1:], along[rows], way)
            place[rows] = at + (step if faces.affine else np.clip(step, -1.0, 1.0))
            moved = np.maximum(abs(step[:, 0]), abs(step[:, -1]))
            if faces.affine:
                moved *= 0.0  # one step is exact
            # Steps fall with their squares: the next one is known from two.
            done = (moved < TOLERANCE) | (moved**3 < (before[rows] * TOLERANCE) ** 2)
            failed[rows], before[rows] = ~done, np.minimum(moved, 1.0)  # as far as it went
            left = left[~(np.isnan(moved) | done)]
            if not len(left):
                break
    place[failed] = np.nan
    return place, np.where(failed, np.nan, gap)


def split(tangents: Array, along: Array, way: Array) -> tuple[Array, Array]:
    """Split vectors into parts along tangents (points, d - 1, d) and along a direction."""
    first, second = tangents[:, 0], tangents[:, -1]
    if tangents.shape[2] == 2:
        volume = cross(first, along)
        return (cross(way, along) / volume)[:, None], cross(first, way) / volume
    normal, across = np.cross(first, second), np.cross(way, along)
    parts = (-_dot(second, across), _dot(first, across), _dot(normal, way))
    *step, gap = (part / _dot(normal, along) for part in parts)
    return np.stack(step, axis=1), gap


def _dot(a: Array, b: Array) -> Array:
    """Return products of vectors."""
    return np.asarray(np.einsum("pd,pd->p", a, b))


def duals(tangents: Array, along: Array) -> Array:
    """Return the dual vectors of tangents and a direction: (points, d, d)."""
    normal = normals_of(tangents)
    volume = np.sum(normal * along, axis=1, keepdims=True)
    of_along = normal / volume
    if tangents.shape[2] == 2:
        across = np.column_stack([along[:, 1], -along[:, 0]])
        first = across / np.sum(across * tangents[:, 0], axis=1, keepdims=True)
        return np.stack([first, of_along], axis=1)
    first, second = np.cross(tangents[:, 1], along), np.cross(along, tangents[:, 0])
    return np.stack([first / volume, second / volume, of_along], axis=1)
