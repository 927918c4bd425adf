# SPDX-License-Identifier: MIT
"""Quadrature points, shape functions and weights on the faces of a contact surface."""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem

from .surface import ContactSurface

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]
#: Points in the coordinates of a facet, and their weights.
Rule = tuple[Array, Array]


def gauss(surface: ContactSurface, degree: int) -> Rule:
    """Return a quadrature rule for the facets of a surface, exact to a degree."""
    points, weights = basix.make_quadrature(surface.submesh.basix_cell(), degree)
    return np.asarray(points), np.asarray(weights)


def lattice(surface: ContactSurface, degree: int) -> Rule:
    """Return the points of a Lagrange element on the facets of a surface, without weights."""
    kind = basix.LatticeType.equispaced
    points = np.asarray(basix.create_lattice(surface.submesh.basix_cell(), degree, kind, True))
    return points, np.ones(len(points))


@dataclass(frozen=True)
class Faces:
    """Faces of all ranks, one row a face.

    Attributes:
        nodes: Global contact nodes on it.
        dofs: Global (blocked) dofs of the displacement on it.
        kind: Its local number in its cell.
        weights: Of its points, with the element of area (m²; m in 2D).
        x: Reference coordinates of its points (m).
        outward: 1 where the normal of its coordinates points out of the body, else -1.
    """

    nodes: Indices
    dofs: Indices
    kind: Indices
    weights: Array
    x: Array
    outward: Array


class FaceTables:
    """Tables for each facet of a cell, and the faces of this rank.

    Args:
        surface: The contact surface.
        V: Space of the displacement.
        rule: Points in a facet, and their weights.

    Attributes:
        entities: (cell, local facet) of this rank's faces.
        all_points: The points of all facets, in the cell's coordinates.
        shapes: The displacement's shape functions: (facets, points, dofs on the facet).
        hats: The shape functions of the contact nodes: (facets, points, nodes of the facet).
    """

    def __init__(self, surface: ContactSurface, V: fem.FunctionSpace, rule: Rule) -> None:
        self._surface, self._V, msh = surface, V, surface.mesh
        cell, tdim = msh.basix_cell(), msh.topology.dim
        self.entities = surface.entities.reshape(-1, 2)
        on_facet, self._w = rule
        corners, self._vertices = np.asarray(basix.geometry(cell)), basix.topology(cell)[tdim - 1]
        layout, scalar = V.dofmap.dof_layout, V.ufl_element().sub_elements[0]
        self._closure = [
            np.array(layout.entity_closure_dofs(tdim - 1, i)) for i in range(len(self._vertices))
        ]
        at_vertex = np.array([layout.entity_dofs(0, i)[0] for i in range(len(corners))])
        linear = basix.ufl.element("Lagrange", cell, 1)
        shapes, hats = [], []
        self._points, self._axes = [], []
        middle = corners.mean(axis=0)
        self._points_out = np.array([corners[v].mean(axis=0) - middle for v in self._vertices])
        for vertices, dofs in zip(self._vertices, self._closure, strict=True):
            origin, *others = corners[vertices]
            axes = np.array(others[: tdim - 1]) - origin
            points = origin + on_facet @ axes
            self._points.append(points)
            self._axes.append(axes)
            shapes.append(np.asarray(scalar.tabulate(0, points))[0][:, dofs])
            hats.append(np.asarray(linear.tabulate(0, points))[0][:, vertices])
        self.shapes, self.hats = np.array(shapes), np.array(hats)
        self._at_nodes = at_vertex[np.array(self._vertices)]
        if surface.degree > 1:  # all dofs of the displacement are nodes
            self.hats, self._at_nodes = self.shapes, np.array(self._closure)
        self.all_points = np.concatenate(self._points)

    def gathered(self) -> Faces:
        """Return the faces of all ranks; collective."""
        cells, kind = self.entities[:, 0], self.entities[:, 1].astype(np.int64)
        x, weights, outward = self._geometry(cells, kind)
        own = (self._nodes(cells, kind), self._dofs(cells, kind), kind, weights, x, outward)
        parts = self._surface.mesh.comm.allgather(own)
        return Faces(*(np.concatenate(group) for group in zip(*parts, strict=True)))

    def _dofs(self, cells: npt.NDArray, kind: Indices) -> Indices:
        """Return the global (blocked) dofs on the faces."""
        dofmap, closure = self._V.dofmap, np.array(self._closure)
        local = dofmap.list[cells[:, None], closure[kind]]
        numbers = dofmap.index_map.local_to_global(local.ravel().astype(np.int32))
        return np.asarray(numbers.reshape(local.shape))

    def _nodes(self, cells: npt.NDArray, kind: Indices) -> Indices:
        """Return the global contact nodes on the faces."""
        S, V = self._surface.S, self._V
        local = V.dofmap.list[cells[:, None], self._at_nodes[kind]]
        index_map = V.dofmap.index_map
        node = np.full(index_map.size_local + index_map.num_ghosts, -1, dtype=np.int32)
        parents = self._surface.parent_dofs(V)
        node[parents] = np.arange(len(parents))
        numbers = S.dofmap.index_map.local_to_global(node[local].ravel())
        return np.asarray(numbers.reshape(local.shape))

    def _geometry(self, cells: npt.NDArray, kind: Indices) -> tuple[Array, Array, Array]:
        """Return places and weights of the points, and which way their normals point."""
        geometry = self._surface.mesh.geometry
        d, tdim = geometry.dim, self._surface.mesh.topology.dim
        domain = self._surface.mesh.ufl_domain()
        assert domain is not None
        element = domain.ufl_coordinate_element().sub_elements[0]
        tables = np.array([element.tabulate(1, points) for points in self._points])
        nodes = geometry.x[geometry.dofmaps[0][cells]][:, :, :d]
        x = np.einsum("fqk,fkd->fqd", tables[kind, 0], nodes)
        J = np.einsum("ftqk,fkd->fqdt", tables[kind, 1 : 1 + tdim], nodes)
        tangents = np.einsum("fqdt,fat->fqad", J, np.array(self._axes)[kind])
        normals = normals_of(tangents)
        out = self._points_out[kind]
        outward = np.sign(np.einsum("fd,fdt,ft->f", normals[:, 0], J[:, 0], out))
        return x, np.linalg.norm(normals, axis=2) * self._w, outward


def normals_of(tangents: Array) -> Array:
    """Return normals (..., d) of tangents (..., d - 1, d), with the element of area as length."""
    if tangents.shape[-1] == 2:
        return np.stack([tangents[..., 0, 1], -tangents[..., 0, 0]], axis=-1)
    return np.asarray(np.cross(tangents[..., 0, :], tangents[..., 1, :]))
