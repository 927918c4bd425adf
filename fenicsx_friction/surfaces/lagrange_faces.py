# SPDX-License-Identifier: MIT
"""The faces of a contact surface with all dofs of the displacement on them, on every rank."""

from __future__ import annotations

from functools import cached_property

import basix
import numpy as np
import numpy.typing as npt
import scipy
from dolfinx import fem

from ..base.errors import ContactInputError
from .elements import degree_on_facets
from .face_tables import FaceTables, normals_of
from .polynomials import Polynomials
from .surface import ContactSurface
from .surface_dofs import SurfaceDofs

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


class LagrangeFaces:
    """Faces of all ranks, with shape functions of any degree; collective.

    Where these are not linear, a face is cut into linear *patches*, as many along an edge as the
    degree: search and clipping see the patches.

    Args:
        surface: The surface.
        V: Space of the displacement.

    Attributes:
        d: Dimension of space.
        degree: Degree of the shape functions.
        rows: The dofs of all faces.
        dofs: Those of each face by their places there, in the order of the shape functions.
        nodes: Global contact nodes of each face.
        outward: 1 where the normal of a face's coordinates points out of the body, else -1.
        X: Reference coordinates (m) of the dofs.
        corners: Corners of the patches of a face in its coordinates, in turn: (patches, corners,
            d - 1).
        polynomials: The shape functions as sums of monomials.
    """

    def __init__(self, surface: ContactSurface, V: fem.FunctionSpace) -> None:
        cell, self.d = surface.submesh.basix_cell(), surface.mesh.geometry.dim
        self.degree = degree_on_facets(V)
        self._curved = surface.mesh.geometry.cmaps[0].degree > 1
        kind, variant = basix.ElementFamily.P, basix.LagrangeVariant.gll_warped
        self._element = basix.create_element(kind, cell, self.degree, variant)
        self._hats = basix.create_element(kind, cell, 1, variant)
        self.polynomials = Polynomials(self._element)
        points = np.asarray(self._element.points)
        tables = FaceTables(surface, V, (points, np.ones(len(points))))
        faces, order = tables.gathered(), np.argmax(tables.shapes, axis=2)
        at_points = np.take_along_axis(tables.shapes, order[:, None, :], axis=2)
        if not np.allclose(at_points, np.eye(len(points)), atol=1e-10):
            raise ContactInputError(
                f"The displacement, of {V.ufl_element()}, has no values at the points of a "
                f"Lagrange element of degree {self.degree} on the facets of '{surface.name}'; take "
                'fem.functionspace(mesh, ("Lagrange", k, (gdim,))).'
            )
        self.rows = SurfaceDofs(V, faces.dofs)
        dofs = np.take_along_axis(faces.dofs, order[faces.kind], axis=1)
        self.dofs, self.nodes = self.rows.places(dofs), faces.nodes
        self.outward = faces.outward
        self.X = self.rows.gather(V.tabulate_dof_coordinates()[:, : self.d].ravel())
        self.corners = _patches(cell, self.degree)

    def __len__(self) -> int:
        """Return the number of patches."""
        return len(self.dofs) * len(self.corners)

    @property
    def affine(self) -> bool:
        """Whether faces are flat, with constant tangents."""
        return self.degree == 1 and self.nodes.shape[1] == self.d

    @cached_property
    def areas(self) -> Array:
        """The areas of the faces (m²; m in 2D)."""
        kind = self._element.cell_type
        points, weights = basix.make_quadrature(kind, 2 * self.degree)
        tangents = np.einsum("pta,fad->fptd", self.slopes(np.asarray(points)), self.X[self.dofs])
        return np.linalg.norm(normals_of(tangents), axis=2) @ np.asarray(weights)

    @cached_property
    def signs(self) -> Array:
        """``outward`` of the face of each patch."""
        return np.repeat(self.outward, len(self.corners))

    def face_of(self, patch: Indices) -> Indices:
        """Return the faces of patches."""
        return patch // len(self.corners)

    @cached_property
    def centers(self) -> Array:
        """The centers of a face's patches in its coordinates."""
        return np.asarray(self.corners.mean(axis=1))

    def at_dofs(self, x: Array, face: Indices) -> Array:
        """Return values (of dofs, d) at the dofs of some faces: (faces, dofs, d)."""
        return np.take(x, np.take(self.dofs, face, axis=0), axis=0)  # faster than x[...]

    def shapes(self, xi: Array) -> Array:
        """Return the shape functions at points of faces: (points, dofs)."""
        return _tabulated(self._element, 0, xi)[0]

    def interpolation(self, face: Indices, shapes: Array) -> scipy.sparse.csr_array:
        """Return the matrix (points, dofs) of points on faces with these shape functions."""
        points, dofs = shapes.shape
        ends = np.arange(0, (points + 1) * dofs, dofs)
        entries = (shapes.ravel(), np.take(self.dofs, face, axis=0).ravel(), ends)
        return scipy.sparse.csr_array(entries, shape=(points, len(self.rows)))

    def slopes(self, xi: Array) -> Array:
        """Return their derivatives along the coordinates: (points, d - 1, dofs)."""
        return _tabulated(self._element, 1, xi)[1:].transpose(1, 0, 2)

    def table(self, xi: Array) -> Array:
        """Return shape functions, then their derivatives: (points, 1 + (d - 1), dofs)."""
        return np.ascontiguousarray(_tabulated(self._element, 1, xi).transpose(1, 0, 2))

    def hats(self, xi: Array) -> Array:
        """Return the shape functions of the vertices: (points, vertices)."""
        return _tabulated(self._hats, 0, xi)[0]

    def inside(self, xi: Array) -> npt.NDArray[np.bool_]:
        """Tell which points are inside their faces; what is not a number is not."""
        return np.asarray(np.all(self.hats(np.nan_to_num(xi, nan=9.0)) >= 0.0, axis=1))

    def corner_positions(self, x: Array) -> Array:
        """Return the corners of all patches, (patches, corners, d), from positions of the dofs."""
        corners, dim = self.corners.shape[1:]
        shapes = self.shapes(self.corners.reshape(-1, dim))
        found = np.einsum("ca,fad->fcd", shapes, x[self.dofs])
        return np.asarray(found.reshape(len(self), corners, self.d))

    @cached_property
    def center_slopes(self) -> Array:
        """The weights of the dofs in the tangents of a face's patches: (patches, d - 1, dofs).

        Patches of curved faces have tangents of their own. Those of straight faces share the ones
        between the vertices: at the end of a contact, where stresses are singular, the nodes
        between them make waves, and normals that follow these tilt friction.
        """
        if self._curved:
            return self.slopes(self.centers)
        middle = np.tile(self.centers.mean(axis=0), (len(self.centers), 1))
        slopes = np.zeros((len(middle), self.d - 1, self.dofs.shape[1]))
        hats = _tabulated(self._hats, 1, middle)[1:]
        slopes[:, :, : self.nodes.shape[1]] = hats.transpose(1, 0, 2)
        return slopes

    def tangents(self, x: Array) -> Array:
        """Return the tangents at the centers of all patches, (patches, d - 1, d)."""
        found = np.einsum("pta,fad->fptd", self.center_slopes, x[self.dofs])
        return np.asarray(found.reshape(len(self), self.d - 1, self.d))


def _tabulated(element: basix.finite_element.FiniteElement, order: int, xi: Array) -> Array:
    """Return shape functions and derivatives: (derivatives, points, dofs)."""
    if len(xi) == 0:  # Basix takes no empty arrays
        return np.zeros((1 + order * xi.shape[1], 0, element.dim))
    return np.asarray(element.tabulate(order, xi))[:, :, :, 0]


def _patches(cell: basix.CellType, degree: int) -> Array:
    """Cut a reference face into linear parts."""
    if cell == basix.CellType.interval:
        ends = np.linspace(0.0, 1.0, degree + 1)
        return np.stack([ends[:-1], ends[1:]], axis=1)[:, :, None]
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    steps = [np.array([i, j]) for j in range(degree) for i in range(degree)]
    if cell == basix.CellType.quadrilateral:
        return np.array([step + square for step in steps]) / degree
    up, down = square[[0, 1, 3]], square[[1, 2, 3]]
    parts = [step + up for step in steps if step.sum() < degree]
    parts += [step + down for step in steps if step.sum() < degree - 1]
    return np.array(parts) / degree
