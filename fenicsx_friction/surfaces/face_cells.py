# SPDX-License-Identifier: MIT
"""Linear faces: shape functions, written once for UFL and for NumPy, and closest points."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]
#: Newton iterations of the projection, and its tolerance in reference coordinates.
MAX_IT, TOLERANCE = 25, 1e-14
#: A projection whose last step was longer has not been found.
CONVERGED = 1e-9


class FaceCell(ABC):
    """A face with its nodes in the order of DOLFINx; all functions take numbers, arrays or UFL.

    Attributes:
        nodes: Number of nodes.
        dim: Number of reference coordinates.
        edges: Local nodes of the edges; in 2D of the end points.
        reverse: Order of the nodes that turns the normal round.
        center: Reference coordinates of the center.
    """

    nodes: int
    dim: int
    edges: tuple[tuple[int, ...], ...]
    reverse: tuple[int, ...]
    center: tuple[float, ...]

    @abstractmethod
    def shapes(self, xi: Sequence[Any]) -> list[Any]:
        """Return the shape functions."""

    @abstractmethod
    def slopes(self, xi: Sequence[Any]) -> list[list[Any]]:
        """Return the derivatives of the shape functions along each reference coordinate."""

    def overhang(self, xi: Array) -> Array:
        """Return how far points are outside, in reference lengths, zero inside; one row a point."""
        return np.maximum(np.max(np.maximum(-xi, xi - 1.0), axis=1), 0.0)

    def inside(self, xi: Array) -> Array:
        """Return points moved into the face from where they overhang, along its coordinates."""
        return np.clip(xi, 0.0, 1.0)

    def twist(self) -> list[float] | None:
        """Return the mixed second derivatives of the shape functions, if there are any."""
        return None


class Interval(FaceCell):
    """An edge in 2D."""

    nodes, dim, edges, reverse, center = 2, 1, ((0,), (1,)), (1, 0), (0.5,)

    def shapes(self, xi: Sequence[Any]) -> list[Any]:
        """Return the shape functions."""
        return [1.0 - xi[0], xi[0]]

    def slopes(self, xi: Sequence[Any]) -> list[list[Any]]:
        """Return the derivatives of the shape functions."""
        return [[-1.0 + 0.0 * xi[0], 1.0 + 0.0 * xi[0]]]


class Triangle(FaceCell):
    """A triangle."""

    nodes, dim, edges, reverse = 3, 2, ((0, 1), (1, 2), (2, 0)), (0, 2, 1)
    center = (1.0 / 3.0, 1.0 / 3.0)

    def shapes(self, xi: Sequence[Any]) -> list[Any]:
        """Return the shape functions."""
        return [1.0 - xi[0] - xi[1], xi[0], xi[1]]

    def slopes(self, xi: Sequence[Any]) -> list[list[Any]]:
        """Return the derivatives of the shape functions."""
        zero = 0.0 * xi[0]
        return [[zero - 1.0, zero + 1.0, zero], [zero - 1.0, zero, zero + 1.0]]

    def overhang(self, xi: Array) -> Array:
        """Return how far points are outside."""
        outside = np.column_stack([-xi, xi.sum(axis=1) - 1.0])
        return np.maximum(np.max(outside, axis=1), 0.0)

    def inside(self, xi: Array) -> Array:
        """Return points moved into the triangle."""
        positive = np.maximum(xi, 0.0)
        return np.asarray(positive / np.maximum(positive.sum(axis=1, keepdims=True), 1.0))


class Quadrilateral(FaceCell):
    """A bilinear quadrilateral."""

    nodes, dim, edges, reverse = 4, 2, ((0, 1), (1, 3), (3, 2), (2, 0)), (0, 2, 1, 3)
    center = (0.5, 0.5)

    def shapes(self, xi: Sequence[Any]) -> list[Any]:
        """Return the shape functions."""
        a, b = xi[0], xi[1]
        return [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b]

    def slopes(self, xi: Sequence[Any]) -> list[list[Any]]:
        """Return the derivatives of the shape functions."""
        a, b = xi[0], xi[1]
        return [[b - 1.0, 1.0 - b, -b, b], [a - 1.0, -a, 1.0 - a, a]]

    def twist(self) -> list[float]:
        """Return the mixed second derivatives of the shape functions."""
        return [1.0, -1.0, -1.0, 1.0]


FACE_CELLS: dict[str, FaceCell] = {
    "interval": Interval(),
    "triangle": Triangle(),
    "quadrilateral": Quadrilateral(),
}


def weighted(weights: Sequence[Any], points: Sequence[Any]) -> Any:
    """Return the weighted sum of points."""
    first, *others = (w * p for w, p in zip(weights, points, strict=True))
    return sum(others, first)


def newton_step(cell: FaceCell, xi: Sequence[Any], face: Any, x: Any, dot: Any) -> list[Any]:
    """Return ``xi`` after one Newton step towards the orthogonal projection of ``x``.

    From the projection itself the step is zero, but its derivative with respect to ``x`` and
    ``face`` is the exact derivative of the projection, on bilinear faces too. UFL gets it this way.

    Args:
        cell: Kind of face.
        xi: Reference coordinates.
        face: Nodes of the face.
        x: The point.
        dot: Scalar product.
    """
    to_point = x - weighted(cell.shapes(xi), face)
    tangents = [weighted(slopes, face) for slopes in cell.slopes(xi)]
    residual = [dot(t, to_point) for t in tangents]
    if cell.dim == 1:
        return [xi[0] + residual[0] / dot(tangents[0], tangents[0])]
    a, b, c = (dot(tangents[i], tangents[k]) for i, k in ((0, 0), (0, 1), (1, 1)))
    twist = cell.twist()
    if twist is not None:
        b = b - dot(weighted(twist, face), to_point)
    det = a * c - b * b
    return [
        xi[0] + (c * residual[0] - b * residual[1]) / det,
        xi[1] + (a * residual[1] - b * residual[0]) / det,
    ]


def blend(weights: Array, face: Array) -> Array:
    """Return the points of ``face`` (n, nodes, d) with the ``weights`` (n, nodes)."""
    return np.asarray(np.einsum("ni,nid->nd", weights, face))


def _dot(a: Array, b: Array) -> Array:
    """Return the scalar products of columns."""
    return np.asarray(np.sum(a * b, axis=0))


def project(cell: FaceCell, face: Array, x: Array, start: Array | None = None) -> Array:
    """Return the reference coordinates of the orthogonal projections on the extended faces.

    Args:
        cell: Kind of face.
        face: Nodes of the faces (n, nodes, d).
        x: The points (n, d).
        start: Reference coordinates to start from; the center by default.

    Returns:
        Reference coordinates (n, dim); NaN where Newton's method does not converge.
    """
    xi = np.tile(cell.center, (len(x), 1)) if start is None else start.copy()
    nodes = [face[:, i].T for i in range(cell.nodes)]
    with np.errstate(all="ignore"):
        if cell.twist() is None:  # one step is exact on flat faces
            return np.stack(newton_step(cell, list(xi.T), nodes, x.T, _dot), axis=1)
        moved, going = np.full(len(x), np.inf), np.arange(len(x))
        for _ in range(MAX_IT):  # each row as long as it moves
            row, corners = xi[going], [node[:, going] for node in nodes]
            new = np.stack(newton_step(cell, list(row.T), corners, x[going].T, _dot), axis=1)
            xi[going] = row + np.clip(new - row, -1.0, 1.0)
            moved[going] = np.max(abs(xi[going] - row), axis=1, initial=0.0)
            going = going[moved[going] >= TOLERANCE]
            if len(going) == 0:
                break
        xi[~(moved <= CONVERGED)] = np.nan
    return xi


def shape_matrix(cell: FaceCell, xi: Array) -> Array:
    """Return the shape functions (n, nodes) at reference coordinates (n, dim)."""
    return np.stack([s * np.ones(len(xi)) for s in cell.shapes(list(xi.T))], axis=1)


def normals(cell: FaceCell, face: Array, xi: Array) -> Array:
    """Return the unit normals of faces (n, nodes, d) at reference coordinates (n, dim)."""
    tangents = [
        blend(np.stack([s * np.ones(len(xi)) for s in slopes], axis=1), face)
        for slopes in cell.slopes(list(xi.T))
    ]
    if cell.dim == 1:
        normal = np.column_stack([tangents[0][:, 1], -tangents[0][:, 0]])
    else:
        normal = np.cross(tangents[0], tangents[1])
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def distances(cell: FaceCell, face: Array, x: Array, xi: Array) -> Array:
    """Return the distances of points from faces; ``xi`` are their projections (extended)."""
    inside = cell.overhang(xi) <= 0.0
    best = np.where(inside, np.linalg.norm(x - blend(shape_matrix(cell, xi), face), axis=1), np.inf)
    return np.minimum(best, np.linalg.norm(x - on_edges(cell, face, x), axis=1))


def on_segments(a: Array, b: Array, x: Array) -> Array:
    """Return the nearest points on the segments from ``a`` to ``b``, which may be single points."""
    along = b - a
    length = np.maximum(np.sum(along * along, axis=1), np.finfo(float).tiny)
    s = np.clip(np.sum((x - a) * along, axis=1) / length, 0.0, 1.0)
    return np.asarray(a + s[:, None] * along)


def on_edges(cell: FaceCell, face: Array, x: Array) -> Array:
    """Return the nearest points on the edges of faces."""
    best, result = np.full(len(x), np.inf), x.copy()
    for edge in cell.edges:
        point = on_segments(face[:, edge[0]], face[:, edge[-1]], x)
        away = np.linalg.norm(x - point, axis=1)
        nearer = away < best
        best[nearer], result[nearer] = away[nearer], point[nearer]
    return result
