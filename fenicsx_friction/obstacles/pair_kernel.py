# SPDX-License-Identifier: MIT
"""The contact element in UFL: kinematics of a node against a face, compiled by FFCx.

One element is a cell of a mesh of points. Its dofs are the current positions of the node, of the
nodes of the face that it meets, and of the nodes of its old face: the face that it met at the last
accepted step. The element returns, with their exact derivatives by all dofs::

    gap, slip (d - 1), normal (d)[, first tangent (3, only in 3D)], shape functions there

The slip leads from the material point that the node met at the last accepted step, where that is
now, to the node. It vanishes under a common rigid motion and does not see the edges between faces:
an offset of the node is measured along the normal of the face that it was measured from.
"""

from dataclasses import dataclass

from mpi4py import MPI

import ufl
from ufl.core.expr import Expr

from ..surfaces.face_cells import Array, FaceCell, newton_step, weighted
from ..surfaces.nodal_kernel import variable
from ..surfaces.points import Points
from .kinematics import entries, slices


@dataclass(frozen=True)
class PairGeometry:
    """The inputs of the contact element, one row a pair.

    Attributes:
        z: Positions (m) of the node, the face's nodes and the old face's nodes (n, 1 + 2 k, d).
        xi: Reference coordinates of the projection.
        old_xi: Reference coordinates on the old face of the last step's contact point.
        offset: Distance (m) from the face at which the gap is zero.
        hint: Vector whose tangential part is the first tangent (3D).
    """

    z: Array
    xi: Array
    old_xi: Array
    offset: Array
    hint: Array


class PairKernel:
    """Evaluates the contact element; collective when it is made.

    Args:
        comm: Ranks that compile together.
        cell: Kind of face.
        gdim: Dimension of space.
        num_pairs: Number of elements of this rank.
    """

    def __init__(self, comm: MPI.Intracomm, cell: FaceCell, gdim: int, num_pairs: int) -> None:
        self._cell, self._d, self._points = cell, gdim, Points(num_pairs)
        vector = lambda size: self._points.function((size,))  # noqa: E731
        self._z = vector(gdim * (1 + 2 * cell.nodes))
        self._xi, self._old_xi, self._hint = vector(cell.dim), vector(cell.dim), vector(gdim)
        self._offset = vector(1)
        self.size = slices(gdim)[-1][0]  # all but the position
        z = variable(self._z, 0)
        values = self._element(z)
        self._values = self._points.expression(values, comm)
        self._derivatives = self._points.expression(ufl.diff(values, z), comm)

    def values(self, geometry: PairGeometry) -> Array:
        """Return gap, slip, normal[, tangent] and shape functions, one row a pair."""
        self._set(geometry)
        return self._values()

    def derivatives(self, geometry: PairGeometry) -> Array:
        """Return their derivatives by the positions ``z``, flattened: (n, values, z)."""
        self._set(geometry)
        return self._derivatives()

    def _element(self, z: Expr) -> Expr:
        """Return the values of one element in UFL."""
        cell, d = self._cell, self._d
        points = [
            ufl.as_vector([z[d * i + k] for k in range(d)]) for i in range(1 + 2 * cell.nodes)
        ]
        x, face, old_face = points[0], points[1 : 1 + cell.nodes], points[1 + cell.nodes :]
        xi = newton_step(cell, [self._xi[k] for k in range(cell.dim)], face, x, ufl.dot)
        shapes, normal = cell.shapes(xi), self._normal(xi, face)
        gap = ufl.dot(normal, x - weighted(shapes, face)) - self._offset[0]
        old_xi = [self._old_xi[k] for k in range(cell.dim)]
        raised = self._offset[0] * self._normal(old_xi, old_face)
        way = x - weighted(cell.shapes(old_xi), old_face) - raised
        return ufl.as_vector([*entries(gap, way, normal, self._hint), *shapes])

    def _normal(self, xi: list[Expr], face: list[Expr]) -> Expr:
        """Return the unit normal of a face."""
        tangents = [weighted(slopes, face) for slopes in self._cell.slopes(xi)]
        if self._d == 2:
            normal = ufl.as_vector([tangents[0][1], -tangents[0][0]])
        else:
            normal = ufl.cross(*tangents)
        return normal / ufl.sqrt(ufl.dot(normal, normal))

    def _set(self, geometry: PairGeometry) -> None:
        """Fill the Functions."""
        if self._points.number:
            self._z.x.array[:] = geometry.z.ravel()
            self._xi.x.array[:] = geometry.xi.ravel()
            self._old_xi.x.array[:] = geometry.old_xi.ravel()
            self._offset.x.array[:] = geometry.offset
            self._hint.x.array[:] = geometry.hint.ravel()
