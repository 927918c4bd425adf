# SPDX-License-Identifier: MIT
"""Ways: nodes and faces, cut into simplices, that move on straight lines from time 0 to 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..surfaces.face_cells import Array, FaceCell

Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
#: Halvings of an interval down to rounding.
HALVINGS = 53


def simplices(cell: FaceCell, corners: Array) -> Array:
    """Cut faces (n, nodes, d) into simplices (n, parts, d, d) of the same orientation."""
    if cell.nodes == corners.shape[2]:
        return corners[:, None]
    center = corners.mean(axis=1)
    return np.stack(
        [np.stack([corners[:, a], corners[:, b], center], axis=1) for a, b in cell.edges], axis=1
    )


@dataclass(frozen=True)
class Way:
    """Straight ways of nodes and simplices, one row a pair of them.

    Attributes:
        x: Start and way of the node (m).
        corners: Start and way of the simplex's corners (m).
        direction: Averaged normal of the node at the start, and its change.
    """

    x: tuple[Array, Array]
    corners: tuple[Array, Array]
    direction: tuple[Array, Array]

    def take(self, rows: npt.NDArray) -> Way:
        """Return some rows."""
        pairs = ((a[rows], b[rows]) for a, b in (self.x, self.corners, self.direction))
        x, corners, direction = pairs
        return Way(x, corners, direction)

    def at(self, time: npt.ArrayLike) -> tuple[Array, Array]:
        """Return nodes and corners at a time, one for all or for each row."""
        t = np.broadcast_to(time, len(self.x[0]))
        return (
            self.x[0] + t[:, None] * self.x[1],
            self.corners[0] + t[:, None, None] * self.corners[1],
        )

    def volume(self, time: npt.ArrayLike) -> Array:
        """Return distance in front of the simplex times its size: a polynomial in time."""
        x, corners = self.at(time)
        return np.asarray(np.sum(area_vectors(corners) * (x - corners[:, 0]), axis=1))

    def place(self, time: npt.ArrayLike) -> tuple[Array, Array]:
        """Return barycentric coordinates of the projection, and the unit normal."""
        x, corners = self.at(time)
        area = area_vectors(corners)
        size = np.maximum(np.sum(area * area, axis=1, keepdims=True), np.finfo(float).tiny)
        flat = x - np.sum(area * (x - corners[:, 0]), axis=1, keepdims=True) / size * area
        d = corners.shape[1]
        parts = []
        for k in range(d):
            replaced = corners.copy()
            replaced[:, k] = flat
            parts.append(np.sum(area_vectors(replaced) * area, axis=1) / size[:, 0])
        return np.stack(parts, axis=1), area / np.sqrt(size)

    def looks(self, time: npt.ArrayLike, normal: Array, facing: float = 0.0) -> Mask:
        """Tell whether simplices with this normal look at their nodes, up to this cosine."""
        t = np.broadcast_to(time, len(normal))
        direction = self.direction[0] + t[:, None] * self.direction[1]
        return np.asarray(np.sum(normal * direction, axis=1) < facing)


def area_vectors(corners: Array) -> Array:
    """Return normals with the length of the edge, or twice the area of the triangle."""
    edge = corners[:, 1] - corners[:, 0]
    if corners.shape[1] == 2:
        return np.column_stack([edge[:, 1], -edge[:, 0]])
    return np.asarray(np.cross(edge, corners[:, 2] - corners[:, 0]))


def sign_changes(polynomials: Array) -> tuple[Indices, Array, Mask]:
    """Return the sign changes in [0, 1] of polynomials (degree + 1, n) of degree 2 or 3.

    Returns:
        The polynomial, where, and whether it becomes negative there.
    """
    derivative = polynomials[1:] * np.arange(1, len(polynomials))[:, None]
    with np.errstate(all="ignore"):
        if len(derivative) == 2:
            turns = [-derivative[0] / derivative[1]]
        else:
            c, b, a = derivative
            q = -(b + np.copysign(np.sqrt(b * b - 4.0 * a * c), b)) / 2.0
            turns = [q / a, c / q]
    inner = np.sort([np.clip(np.nan_to_num(t, nan=0.0), 0.0, 1.0) for t in turns], axis=0)
    ends = np.vstack([np.zeros_like(inner[:1]), inner, np.ones_like(inner[:1])])
    positive = _value(polynomials, ends) >= 0.0
    piece, row = np.nonzero(positive[1:] != positive[:-1])
    low, high = ends[piece, row], ends[piece + 1, row]
    before, one = positive[piece, row], polynomials[:, row]
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        same = (_value(one, middle) >= 0.0) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return row, high, before


def _value(polynomials: Array, t: Array) -> Array:
    """Evaluate polynomials."""
    result = np.zeros_like(t)
    for coefficient in polynomials[::-1]:
        result = result * t + coefficient
    return result
