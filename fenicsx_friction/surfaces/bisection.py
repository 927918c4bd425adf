# SPDX-License-Identifier: MIT
"""Faces cut into smaller ones on the same planes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .face_cells import Array

#: Faces are not cut into many more than this.
MOST = 50_000

Indices = npt.NDArray[np.int64]


def cut(X: Array, faces: Indices, size: float) -> tuple[Array, Indices, Indices]:
    """Halve the longest edges of triangles (segments in 2D) until none is longer than a size.

    Files from CAD have long slivers; a search wants faces of about one size. Parts are on the
    plane of their face, up to rounding. Each triangle is cut at its own longest edge; neighbours
    need not share nodes.

    Args:
        X: Nodes (m).
        faces: Nodes of each face.
        size: Largest edge (m); larger where there would be too many faces.

    Returns:
        Nodes and faces, and for each face the one that it is a part of.
    """
    corners, parent = X[faces], np.arange(len(faces))
    while len(corners) < MOST:
        k = corners.shape[1]
        ends = [(i, (i + 1) % k) for i in range(k if k > 2 else 1)]
        lengths = np.stack([np.linalg.norm(corners[:, i] - corners[:, j], axis=1) for i, j in ends])
        longest = np.argmax(lengths, axis=0)
        long = np.max(lengths, axis=0) > size
        if not np.any(long):
            break
        i, j = np.array(ends)[longest[long]].T
        one, other = corners[long], corners[long]
        rows = np.arange(len(one))
        middle = 0.5 * (one[rows, i] + one[rows, j])
        one[rows, j], other[rows, i] = middle, middle
        corners = np.concatenate([corners[~long], one, other])
        parent = np.concatenate([parent[~long], parent[long], parent[long]])
    nodes, inverse = np.unique(corners.reshape(-1, corners.shape[2]), axis=0, return_inverse=True)
    return nodes, inverse.reshape(corners.shape[:2]), parent
