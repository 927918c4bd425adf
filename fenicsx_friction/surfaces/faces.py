# SPDX-License-Identifier: MIT
"""Oriented faces: those of a contact surface, gathered on every rank, or any others."""

from __future__ import annotations

from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt
from dolfinx import fem, mesh

from ..base.collective import gather_rows
from ..base.errors import ContactInputError
from .face_cells import FACE_CELLS, Array, FaceCell, normals
from .surface import ContactSurface


class Faces:
    """Nodes and oriented faces at rest.

    Args:
        cell: Kind of the faces.
        X: Coordinates of the nodes (m).
        faces: Nodes of each face, in an order that makes the normal point outwards.

    Attributes:
        cell: As given.
        X: As given; reference coordinates, if the nodes move.
        faces: As given.
        priority: An order of the faces that does not depend on the partition; decides ties.
        sizes: Diameters of the faces (m).
        size: Their mean.
    """

    def __init__(self, cell: FaceCell, X: Array, faces: npt.NDArray[np.int64]) -> None:
        self.cell, self.X, self.faces = cell, X, faces
        corners = X[faces]
        self.priority = order_of_places(corners.mean(axis=1), X)
        self.sizes = np.linalg.norm(np.ptp(corners, axis=1), axis=1)
        self.size = float(np.mean(self.sizes))

    def positions(self, u: fem.Function | None = None) -> Array:
        """Return the positions of all nodes under a displacement (m): they are at rest."""
        return self.X

    def node_normals(self, x: Array) -> Array:
        """Return the averaged unit normals of the nodes at the positions ``x``."""
        result = self._summed_normals(x)
        return result / np.maximum(np.linalg.norm(result, axis=1, keepdims=True), 1e-300)

    def folds(self, x: Array) -> Array:
        """Return the angle between the faces round each node, zero where they are flat."""
        number = np.bincount(self.faces.ravel(), minlength=len(x))
        mean = np.linalg.norm(self._summed_normals(x), axis=1) / np.maximum(number, 1)
        return np.asarray(2.0 * np.arccos(np.minimum(mean, 1.0)))

    @cached_property
    def folds_at_rest(self) -> Array:
        """The same at the reference coordinates."""
        return self.folds(self.X)

    def _summed_normals(self, x: Array) -> Array:
        """Return the sums of the unit normals of the faces round the nodes."""
        corners = x[self.faces]
        center = np.tile(self.cell.center, (len(corners), 1))
        result = np.zeros_like(x)
        for column in self.faces.T:
            np.add.at(result, column, normals(self.cell, corners, center))
        return result

    def node_sizes(self) -> Array:
        """Return the smallest diameter (m) of the faces round each node."""
        result = np.full(len(self.X), np.inf)
        for column in self.faces.T:
            np.minimum.at(result, column, self.sizes)
        return result


def order_of_places(points: Array, X: Array, directions: Array | None = None) -> npt.NDArray:
    """Return the place of each point in an order that does not depend on the partition.

    Args:
        points: The points (m).
        X: The nodes of the surface, whose extent tells which digits count (m).
        directions: Unit vectors, which decide between points at one place.
    """
    keys = np.round((points - np.min(X, axis=0)) / np.max(np.ptp(X, axis=0)), 9)
    if directions is not None:
        keys = np.hstack([keys, np.round(directions, 6)])
    return np.argsort(np.lexsort(keys.T[::-1]))


class FaceSet(Faces):
    """Nodes and faces of a contact surface on all ranks, in the order of global node numbers.

    A surface is small beside its body. Every rank has the whole surface, so that search and
    kinematics are local, whichever ranks own the two bodies. Where there are nodes between the
    vertices, each part of a facet between nodes is a face.

    Args:
        surface: The surface.
        u: The displacement of its body.
    """

    def __init__(self, surface: ContactSurface, u: fem.Function) -> None:
        self._surface, self._u = surface, u
        self._dofs = surface.parent_dofs(u.function_space)[: surface.num_owned]
        d = surface.mesh.geometry.dim
        self._counts = np.array(surface.mesh.comm.allgather(surface.num_owned))
        X = self.gather(surface.x[:, :d])
        parts = surface.mesh.comm.allgather(_oriented_faces(surface))
        super().__init__(FACE_CELLS[surface.submesh.basix_cell().name], X, np.concatenate(parts))

    @property
    def own(self) -> slice:
        """The rows of this rank's nodes."""
        return slice(*self._surface.S.dofmap.index_map.local_range)

    def gather(self, rows: npt.NDArray) -> npt.NDArray:
        """Return the rows of the owned nodes of all ranks; collective."""
        return gather_rows(self._surface.mesh.comm, rows, self._counts)

    def gather_dofs(self, values: npt.NDArray) -> npt.NDArray:
        """Return the entries of an array over the displacement's dofs at all nodes; collective."""
        return self.gather(values.reshape(-1, self._surface.mesh.geometry.dim)[self._dofs])

    def positions(self, u: fem.Function | None = None) -> Array:
        """Return the positions of all nodes under a displacement (m), the current by default."""
        displacement = self._u if u is None else u
        return np.asarray(self.X + self.gather_dofs(displacement.x.array))


def check_surfaces(secondary: ContactSurface, primary: ContactSurface) -> None:
    """Raise unless two surfaces can meet: of one mesh, of degree 1, apart; collective.

    Raises:
        ContactInputError: On all ranks.
    """
    names = f"The primary surface '{primary.name}' and the secondary surface '{secondary.name}'"
    msh = secondary.mesh
    if primary.mesh is not msh:
        raise ContactInputError(
            f"The primary surface '{primary.name}' lies on another mesh than the secondary surface "
            f"'{secondary.name}': put both bodies into one mesh, which need not be connected."
        )
    for surface in (secondary, primary):
        if surface.degree > 1:
            raise ContactInputError(
                f"{names} need nodes at the vertices: contact surface '{surface.name}' has degree "
                f"= {surface.degree}, which only meets rigid obstacles. Leave degree = 1; mortar "
                "averages over the faces."
            )
    if number := facets_in_common(secondary, primary):
        raise ContactInputError(
            f"{names} have {number} facets in common: give each body's surface a tag of its own."
        )


def facets_in_common(one: ContactSurface, other: ContactSurface) -> int:
    """Return how many facets two surfaces of a mesh have in common, on all ranks; collective."""
    ours, theirs = (set(map(tuple, s.entities.reshape(-1, 2))) for s in (one, other))
    return int(one.mesh.comm.allreduce(len(ours & theirs)))


def surface_normals(surface: ContactSurface, u: fem.Function) -> Array:
    """Return the averaged outward unit normals at the owned nodes; collective."""
    faces = FaceSet(surface, u)
    return np.asarray(faces.node_normals(faces.positions(u))[faces.own])


def _oriented_faces(surface: ContactSurface) -> npt.NDArray[np.int64]:
    """Return the global nodes of this rank's faces, ordered for outward normals."""
    msh, tdim = surface.mesh, surface.mesh.topology.dim
    owned = surface.submesh.topology.index_map(tdim - 1).size_local
    cell = FACE_CELLS[surface.submesh.basix_cell().name]
    if owned == 0:
        return np.zeros((0, cell.nodes), dtype=np.int64)
    parts = _parts(surface)
    local = surface.S.dofmap.list[:owned, parts].reshape(-1, cell.nodes)
    corners = surface.S.tabulate_dof_coordinates()[local][..., : msh.geometry.dim]
    facets = surface.entity_map.sub_topology_to_topology(
        np.arange(owned, dtype=np.int32), inverse=False
    )
    msh.topology.create_connectivity(tdim - 1, tdim)
    facet_cells = msh.topology.connectivity(tdim - 1, tdim)
    cells = facet_cells.array[facet_cells.offsets[facets]]
    inside = mesh.compute_midpoints(msh, tdim, cells.astype(np.int32))[:, : msh.geometry.dim]
    inside = np.repeat(inside, len(parts), axis=0)
    normal = normals(cell, corners, np.tile(cell.center, (len(corners), 1)))
    inward = np.sum(normal * (corners.mean(axis=1) - inside), axis=1) < 0.0
    nodes = surface.S.dofmap.index_map.local_to_global(local.ravel().astype(np.int32))
    faces = nodes.reshape(local.shape)
    faces[inward] = faces[inward][:, cell.reverse]
    return faces


def _parts(surface: ContactSurface) -> npt.NDArray[np.int64]:
    """Return the places of the nodes of each linear part of a facet, in DOLFINx's order."""
    if surface.degree == 1:
        return np.arange(surface.S.dofmap.list.shape[1])[None]
    # On a facet of degree 2 a row of the lattice has three nodes.
    points = surface.S.ufl_element().basix_element.points
    lattice = np.lexsort(points.T).reshape([3] * points.shape[1])
    ends = [slice(0, 2), slice(1, 3)]
    return np.array([lattice[part].ravel() for part in product(ends, repeat=points.shape[1])])
