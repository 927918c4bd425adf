# SPDX-License-Identifier: MIT
"""Surfaces made of triangles, or of segments in 2D: merged nodes, and what is wrong with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from ..base.groups import connected
from .face_cells import Array

Indices = npt.NDArray[np.int64]

#: Points nearer to each other than this fraction of the surface's extent are one: the digits of
#: single precision, which binary STL files have.
SAME = 1e-6


@dataclass(frozen=True)
class Soundness:
    """What was found in a surface of triangles (segments in 2D).

    Attributes:
        faces: Number of triangles that are left.
        degenerate: Triangles without an area, which were removed.
        double: Triangles that were there before, which were removed.
        open_edges: Edges with one triangle only (end points of one segment): the surface is open.
        branches: Edges where more than two triangles meet.
        flipped: Triangles that are oriented against most of those connected with them.
        parts: Number of connected parts.
    """

    faces: int
    degenerate: int
    double: int
    open_edges: int
    branches: int
    flipped: int
    parts: int

    def __str__(self) -> str:
        """Return all counts in a line."""
        return (
            f"{self.faces} faces in {self.parts} parts, {self.open_edges} open edges, "
            f"{self.branches} edges of more than two faces, {self.flipped} flipped, "
            f"{self.degenerate} degenerate and {self.double} double faces (removed)"
        )


def cut_quadrilaterals(points: Array, quadrilaterals: Indices) -> Indices:
    """Return the two triangles of each quadrilateral, nodes in a circle, by its short diagonal."""
    a, b, c, d = quadrilaterals.T
    first = np.linalg.norm(points[a] - points[c], axis=1)
    short = (first <= np.linalg.norm(points[b] - points[d], axis=1))[:, None, None]
    one = np.stack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)], axis=1)
    other = np.stack([np.stack([a, b, d], 1), np.stack([b, c, d], 1)], axis=1)
    return np.asarray(np.where(short, one, other).reshape(-1, 3))


def cleaned(
    points: Array, faces: Indices, *, orient: bool = False
) -> tuple[Array, Indices, Soundness]:
    """Merge points, remove faces without an area and faces that are there twice, count the rest.

    Args:
        points: Coordinates, one row a point.
        faces: Points of each triangle, or segment in 2D.
        orient: Turn flipped faces as most of those connected with them.

    Returns:
        Points, faces, and what was found.
    """
    used, faces = np.unique(faces, return_inverse=True)
    X, faces = _merged(points[used], faces.reshape(-1, points.shape[1]))
    sound = ~_degenerate(X, faces)
    kept = faces[sound]
    _, first = np.unique(np.sort(kept, axis=1), axis=0, return_index=True)
    single = kept[np.sort(first)]
    used, single = np.unique(single, return_inverse=True)
    single = single.reshape(-1, points.shape[1])
    number, pairs, agree = _edges(single)
    against, parts = _flipped(len(single), pairs, agree)
    if orient:
        single[against] = single[against][:, ::-1]
    found = Soundness(
        faces=len(single),
        degenerate=int(np.sum(~sound)),
        double=len(kept) - len(single),
        open_edges=int(np.sum(number == 1)),
        branches=int(np.sum(number > 2)),
        flipped=int(np.sum(against)),
        parts=parts,
    )
    return X[used], single, found


def _merged(points: Array, faces: Indices) -> tuple[Array, Indices]:
    """Make one of points at the same place."""
    extent = float(np.max(np.ptp(points, axis=0), initial=0.0))
    pairs = scipy.spatial.cKDTree(points).query_pairs(SAME * extent, output_type="ndarray")
    _, group = connected(len(points), *pairs.T)
    _, first, inverse = np.unique(group, return_index=True, return_inverse=True)
    return points[first], inverse[faces]


def _degenerate(X: Array, faces: Indices) -> npt.NDArray[np.bool_]:
    """Tell which faces have no area: no height above their longest edge."""
    corners = X[faces]
    if faces.shape[1] == 2:
        return np.asarray(faces[:, 0] == faces[:, 1])
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    longest = np.max(np.linalg.norm(np.stack([a, b, a - b]), axis=2), axis=0)
    area = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(area <= SAME * longest**2)


def _edges(faces: Indices) -> tuple[Indices, Indices, npt.NDArray[np.bool_]]:
    """Return the number of faces of each edge, pairs across an edge, and which of these agree."""
    n, size = faces.shape
    edge = edges(faces)[1].T.ravel()
    if size == 2:  # a segment starts at its first end point and goes to its second
        sign = np.repeat([1, -1], n)
    else:
        sign = np.where(faces < np.roll(faces, -1, axis=1), 1, -1).T.ravel()
    number = np.bincount(edge)
    order = np.argsort(edge, kind="stable")
    order = order[number[edge[order]] == 2].reshape(-1, 2)
    return number, (order % n), sign[order[:, 0]] != sign[order[:, 1]]


def edges(faces: Indices) -> tuple[Indices, Indices]:
    """Return the nodes of all edges (2D: end points), and the edges of each face, a row each."""
    size = faces.shape[1]
    columns = [[0], [1]] if size == 2 else [[0, 1], [1, 2], [2, 0]]
    sides = np.sort(np.concatenate([faces[:, column] for column in columns]), axis=1)
    found, of_face = np.unique(sides, axis=0, return_inverse=True)
    return found, of_face.reshape(size, len(faces)).T


def _flipped(
    n: int, pairs: Indices, agree: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.bool_], int]:
    """Tell which faces are oriented against most of their part, and count the parts.

    Two layers of faces, as they are and turned: neighbours that agree are joined within each layer,
    others across. In a part of either layer all are oriented alike.
    """
    a, b = pairs.T
    turned = np.where(agree, 0, n)
    both = np.concatenate([[a, b + turned], [a + n, b + n - turned]], axis=1)
    (parts, part), (_, alike) = connected(n, a, b), connected(2 * n, *both)
    plain = alike[:n]
    # The layer part that holds most faces of a part as they are wins; the first one of two equals.
    count = np.bincount(plain, minlength=2 * n)
    rows = np.lexsort((plain, -count[plain], part))
    winner = plain[rows[np.searchsorted(part[rows], np.arange(parts))]]
    return np.asarray(plain != winner[part]), int(parts)
