# SPDX-License-Identifier: MIT
"""Quadrature points on the faces round each contact node, with the weights of the node's average.

A node's test function is the hat of its vertex, or its own shape function on a surface of degree 2.
The average of a quantity over its faces is the sum
over their points, with weights that add up to one. Every rank knows the faces round its own nodes,
whichever rank has them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy
import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_type
from ufl.core.expr import Expr
from ufl.domain import extract_domains

from ..base.collective import gather_rows
from ..base.compilation import compiled
from ..base.errors import ContactInputError
from .elements import is_global
from .face_tables import FaceTables, Rule
from .rings import circumferences
from .surface import ContactSurface
from .surface_dofs import SurfaceDofs

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


class FacePoints:
    """The points on the faces round the owned nodes of a surface; collective.

    A *corner* is a face at one of its contact nodes. Each corner has the points of its face; so a
    point counts once for each node of its face.

    Args:
        surface: The contact surface.
        V: Space of the displacement, continuous Lagrange of any degree.
        rule: Points in a facet, and their weights.
        by_node: Whether fields of the surface have at all points of a node its own value; else they
            are not known there.

    Attributes:
        name, mesh, submesh: Those of the surface.
        x: Reference coordinates of the points (m).
        node: The owned node of each corner.
        around: All nodes of its face, by their global numbers.
        share: Weight of each point in the average of its corner's node: (corners, points).
        area: What the weights were divided by: the integral of each test function (m²; m in 2D).
        shapes: Shape functions of the displacement at the points: (corners, points, dofs).
        stencil: The displacement's dofs round each node, by their place in the order of
            :meth:`gather`, its own first, -1 for none: (nodes, dofs).
        place: Where the dofs of each corner's face are in the stencil: (corners, dofs).
    """

    def __init__(
        self, surface: ContactSurface, V: fem.FunctionSpace, rule: Rule, *, by_node: bool = True
    ) -> None:
        self.name, self.mesh, self.submesh = surface.name, surface.mesh, surface.submesh
        self._surface, self._V, self._comm = surface, V, surface.mesh.comm
        self._by_node = by_node
        self._tables = tables = FaceTables(surface, V, rule)
        faces = tables.gathered()
        first, last = surface.S.dofmap.index_map.local_range
        self._face, corner = np.nonzero((faces.nodes >= first) & (faces.nodes < last))
        order = np.lexsort((self._face, faces.nodes[self._face, corner]))
        self._face, corner = self._face[order], corner[order]
        self.node = faces.nodes[self._face, corner] - first
        self.around = faces.nodes[self._face]
        kind = faces.kind[self._face]
        self.shapes = tables.shapes[kind]
        weights = tables.hats[kind, :, corner] * faces.weights[self._face]
        if surface.axisymmetric:
            weights *= circumferences(faces.x[self._face])
        self.area = np.bincount(self.node, weights.sum(axis=1), minlength=surface.num_owned)
        self.share = weights / self.area[self.node][:, None]
        d = self.mesh.geometry.dim
        self.x = faces.x[self._face].reshape(-1, d)
        self._given: dict[fem.Function, Array] = {}
        self._number_dofs(faces.dofs)

    def _number_dofs(self, dofs: Indices) -> None:
        """Number the displacement's dofs of the surface, and those round each node."""
        self._dofs = SurfaceDofs(self._V, dofs)
        self._corner_dofs = self._dofs.places(dofs[self._face])
        n, (corners, k) = self._surface.num_owned, self._corner_dofs.shape
        own = self._dofs.places_of_local(self._surface.parent_dofs(self._V)[:n])
        node = np.repeat(self.node, k)
        # The node's own dof first, then the others by their number.
        later = (self._corner_dofs != own[self.node][:, None]).ravel()
        keys = np.column_stack([node, later, self._corner_dofs.ravel()])
        unique, inverse = np.unique(keys, axis=0, return_inverse=True)
        starts = np.searchsorted(unique[:, 0], np.arange(n))
        place = np.arange(len(unique)) - starts[unique[:, 0]]
        width = self._comm.allreduce(int(place.max(initial=-1)) + 1, MPI.MAX)  # as on all ranks
        self.stencil = np.full((n, width), -1)
        self.stencil[unique[:, 0], place] = unique[:, 2]
        self.place = place[inverse.ravel()].reshape(corners, k)

    # -- as sites --------------------------------------------------------------------------------

    @property
    def num_owned(self) -> int:
        """Number of points of this rank."""
        return len(self.x)

    @property
    def owned_dofs(self) -> npt.NDArray[np.int32]:
        """The displacement's (blocked) dofs on the surface that this rank owns."""
        return self._dofs.owned

    @cached_property
    def node_of_point(self) -> Indices:
        """The owned node of each point."""
        return np.repeat(self.node, self.share.shape[1])

    def give(self, f: fem.Function, rows: Array) -> None:
        """Let a Function stand for rows of its own, one a point, which are read when needed."""
        self._given[f] = rows

    def reader(self, f: fem.Function) -> Callable[[], Array] | None:
        """Return what reads a displacement at the points, or a node's vector at all of its own."""
        V = f.function_space
        if f in self._given:
            return lambda: self._given[f]
        if is_global(V):
            return lambda: np.tile(f.x.array, (self.num_owned, 1))
        if V == self._V:
            return lambda: self.interpolate(self.gather_all(f.x.array))
        if self._by_node and V.mesh is self.submesh and self._surface.has_values_of(V):
            n, bs, nodes = self._surface.num_owned, V.dofmap.index_map_bs, self.node_of_point
            return lambda: f.x.array.reshape(-1, bs)[:n][nodes]
        return None

    def evaluator(self, expression: Expr) -> Callable[[], Array]:
        """Return what evaluates an expression over the body's mesh at the points; collective."""
        foreign = self.submesh.ufl_domain() in extract_domains(expression)
        if foreign or extract_type(expression, ufl.FacetNormal):
            raise ContactInputError(
                f"Contact surface '{self.name}': a gap contains {expression}, which is not known "
                "at points between the nodes, where a displacement of degree 2 or more meets the "
                "obstacle; take a Function on the mesh of u."
            )
        tables, comm, face = self._tables, self._comm, self._face
        made = compiled(fem.Expression, comm)(expression, tables.all_points)
        size = int(np.prod(expression.ufl_shape, dtype=int))

        def evaluate() -> Array:
            """Evaluate on this rank's faces, and take those round the nodes."""
            cells, kind = tables.entities.T
            # In the cells: DOLFINx turns the points of facets with their vertices.
            values = np.asarray(made.eval(self.mesh, cells))
            of_facets = values.reshape(len(cells), *tables.shapes.shape[:2], size)
            rows = of_facets[np.arange(len(cells)), kind]
            counts = np.array(comm.allgather(len(rows)))
            return gather_rows(comm, rows, counts)[face].reshape(len(self.x), size)

        return evaluate

    # -- averages --------------------------------------------------------------------------------

    def gather_all(self, values: npt.NDArray) -> npt.NDArray:
        """Return the entries of an array over the displacement's dofs at the whole surface."""
        return self._dofs.gather(values)

    def gather(self, values: npt.NDArray, missing: float = 0.0) -> npt.NDArray:
        """Return the entries at the stencils: (nodes, dofs, d); collective."""
        around = self.gather_all(values)[self.stencil]
        around[self.stencil < 0] = missing
        return around

    def interpolate(self, rows: Array) -> Array:
        """Return the values at the points of what :meth:`gather_all` has returned."""
        values = np.einsum("cqa,cad->cqd", self.shapes, rows[self._corner_dofs])
        return np.asarray(values.reshape(len(self.x), rows.shape[1]))

    def average(self, values: Array) -> Array:
        """Return the averages of the nodes, from one row a point."""
        rows = values.reshape(*self.share.shape, values.shape[1])
        return np.asarray(self._sum @ np.einsum("cq,cqv->cv", self.share, rows))

    def spread(self, values: Array) -> Array:
        """Return the averages of values times the shape functions: (nodes, dofs, values)."""
        rows = values.reshape(*self.share.shape, values.shape[1])
        corners = np.einsum("cq,cqv,cqa->cav", self.share, rows, self.shapes)
        n, m = self.stencil.shape
        found = self._scatter @ corners.reshape(-1, corners.shape[2])
        return np.asarray(found.reshape(n, m, values.shape[1]))

    def spread_twice(self, values: Array) -> Array:
        """Return the averages times two shape functions each: (nodes, dofs, dofs, values)."""
        rows, (n, m) = values.reshape(*self.share.shape, values.shape[1]), self.stencil.shape
        result = np.zeros((n, m, m, rows.shape[2]))
        for a in range(self.place.shape[1]):
            first = self.share * self.shapes[:, :, a]
            for b in range(self.place.shape[1]):
                corner = np.einsum("cq,cqv->cv", first * self.shapes[:, :, b], rows)
                np.add.at(result, (self.node, self.place[:, a], self.place[:, b]), corner)
        return result

    @cached_property
    def _sum(self) -> scipy.sparse.csr_array:
        """Adds corners to nodes."""
        corners = len(self.node)
        entries = (np.ones(corners), (self.node, np.arange(corners)))
        return scipy.sparse.csr_array(entries, shape=(len(self.stencil), corners))

    @cached_property
    def _scatter(self) -> scipy.sparse.csr_array:
        """Adds the dofs of corners to those of stencils."""
        n, m = self.stencil.shape
        rows = (self.node[:, None] * m + self.place).ravel()
        entries = (np.ones(len(rows)), (rows, np.arange(len(rows))))
        return scipy.sparse.csr_array(entries, shape=(n * m, len(rows)))
