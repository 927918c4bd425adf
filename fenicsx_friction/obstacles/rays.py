# SPDX-License-Identifier: MIT
"""Rays: where a line from a point of one surface meets a face of another."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..surfaces.face_tables import normals_of
from ..surfaces.lagrange_faces import LagrangeFaces

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]

#: Newton iterations; their tolerance in the face's coordinates; and from which last step on they
#: have failed.
MAX_IT, TOLERANCE, FAILED = 25, 1e-14, 1e-9


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
    corners = x[faces.dofs[face]]
    gap: Array = np.zeros(len(face))
    place = np.tile(faces.centers.mean(axis=0), (len(face), 1)) if eta is None else eta.copy()
    left = np.arange(len(face))
    moved = np.zeros(len(face))
    with np.errstate(all="ignore"):
        for _ in range(MAX_IT):
            at, around = place[left], corners[left]
            tangents = np.einsum("pta,pad->ptd", faces.slopes(at), around)
            way = start[left] - np.einsum("pa,pad->pd", faces.shapes(at), around)
            step, gap[left] = split(tangents, along[left], way)
            place[left] = at + (step if faces.affine else np.clip(step, -1.0, 1.0))
            moved[left] = 0.0 * step[:, 0] if faces.affine else np.max(abs(step), axis=1)
            left = left[moved[left] >= TOLERANCE]
            if not len(left):
                break
    found = moved <= FAILED
    place[~found] = np.nan
    return place, np.where(found, gap, np.nan)


def split(tangents: Array, along: Array, way: Array) -> tuple[Array, Array]:
    """Split vectors into parts along tangents and along a direction."""
    parts = duals(tangents, along)
    found = np.einsum("pkd,pd->pk", parts, way)
    return found[:, :-1], found[:, -1]


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
