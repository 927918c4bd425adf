# SPDX-License-Identifier: MIT
"""Normals of faces and frames that are carried to them, with derivatives."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..surfaces.face_tables import normals_of

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


def unit_normals(tangents: Array, sign: Array, weights: Array) -> tuple[Array, Array]:
    """Return unit normals, and their derivatives by the positions of the dofs.

    Args:
        tangents: Tangents, (n, d - 1, d).
        sign: 1 or -1, the side to which the normals point.
        weights: Of the dofs in the tangents, (n, d - 1, dofs).

    Returns:
        Normals (n, d), and derivatives (n, d, dofs, d).
    """
    normal, d = sign[:, None] * normals_of(tangents), tangents.shape[2]
    length = np.linalg.norm(normal, axis=1)
    normal /= length[:, None]
    unit, slopes = np.eye(d), np.zeros((len(normal), d, d - 1, d))
    for e in range(d):
        for k in range(d - 1):
            moved = np.zeros_like(tangents) if d == 2 else tangents.copy()
            moved[:, k] = unit[e]
            slopes[:, :, k, e] = normals_of(moved)
    across = np.eye(d) - normal[:, :, None] * normal[:, None, :]
    slopes = np.einsum("nij,njke->nike", across, slopes) * (sign / length)[:, None, None, None]
    return normal, np.einsum("nike,nka->niae", slopes, weights)


def along_planes(vectors: Array, normals: Array) -> Array:
    """Return the unit vectors along the tangential parts of vectors, zero where there is none."""
    tangential = vectors - np.sum(vectors * normals, axis=1, keepdims=True) * normals
    length = np.linalg.norm(tangential, axis=1, keepdims=True)
    return np.asarray(tangential / np.where(length > 0.0, length, 1.0))


def carried_frames(normal: Array, axis: Array, hint: Array) -> tuple[Array, Array]:
    """Return frames of normals, and their derivatives by these.

    In 3D the frame of each axis, whose first tangent is along the tangential part of a hint, is
    carried to the normal by the smallest rotation, see
    :func:`~fenicsx_friction.obstacles.kinematics.carried`.

    Returns:
        Frames (n, d, d), and derivatives (n, d, d, d).
    """
    d, unit = normal.shape[1], np.eye(normal.shape[1])
    slopes = np.zeros((len(normal), d, d, d))
    slopes[:, 0] = unit
    if d == 2:
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
        slopes[:, 1] = turn
        return np.stack([normal, normal @ turn.T], axis=1), slopes
    first = along_planes(hint, axis)
    both = 1.0 + np.sum(axis * normal, axis=1, keepdims=True)
    both = np.where(both > 1e-9, both, 1.0)  # opposite: there is no such rotation
    share, middle = np.sum(normal * first, axis=1, keepdims=True) / both, axis + normal
    tangent = first - share * middle
    of_share = first / both - share / both * axis
    slopes[:, 1] = -np.einsum("ni,nj->nij", middle, of_share) - share[:, :, None] * unit
    for j in range(d):
        slopes[:, 2, :, j] = np.cross(unit[j], tangent) + np.cross(normal, slopes[:, 1, :, j])
    return np.stack([normal, tangent, np.cross(normal, tangent)], axis=1), slopes
