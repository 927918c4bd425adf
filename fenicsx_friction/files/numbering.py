# SPDX-License-Identifier: MIT
"""Orders of dofs that do not depend on the partition: by input numbers of their mesh entities."""

import hashlib
from typing import Any

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem, mesh

from ..base.errors import CheckpointError

Array = npt.NDArray[Any]


class Numbering:
    """The dofs of a space in an order that does not depend on the partition; collective.

    Args:
        V: The space.

    Attributes:
        size: Number of dofs (rank 0).
        fingerprint: Number of dofs and SHA-256 of their keys (rank 0).

    Raises:
        CheckpointError: If the element has dofs whose order depends on the partition.
    """

    def __init__(self, V: fem.FunctionSpace) -> None:
        _check_element(V)
        self._comm = V.mesh.comm
        parts = self._comm.gather(_keys(V))
        self._ends, self._order, self.fingerprint = np.zeros(0, int), np.zeros(0, int), ""
        self.size = 0
        if parts is not None:
            keys = np.concatenate(parts)
            self._ends = np.cumsum([len(part) for part in parts])
            self._order = np.lexsort(keys.T[::-1])
            self.size = len(keys)
            self.fingerprint = f"{len(keys)}, SHA-256 {_sha256(keys[self._order])}"

    def gather(self, rows: Array) -> Array:
        """Return the rows of all ranks in this order on rank 0, the given ones on the others."""
        parts = self._comm.gather(rows)
        return rows if parts is None else np.concatenate(parts)[self._order]

    def scatter(self, values: Array | None) -> Array:
        """Return this rank's rows of what rank 0 has in this order."""
        parts = None
        if values is not None:
            rows = np.empty_like(values)
            rows[self._order] = values
            parts = np.split(rows, self._ends[:-1])
        return np.asarray(self._comm.scatter(parts))


def _keys(V: fem.FunctionSpace) -> npt.NDArray[np.int64]:
    """Return a key of each owned dof from the numbers that the mesh was made with.

    A key is the dimension of the dof's entity, the place on the entity and the numbers of the
    entity's vertices. They are sorted, except in the interior of a cell: there the cell's own order
    distinguishes cells with permuted vertices.
    """
    msh, layout, dofs = V.mesh, V.dofmap.dof_layout, V.dofmap.list
    entities = basix.topology(msh.basix_cell())
    vertices = msh.geometry.dofmaps[0][:, : len(entities[0])]
    numbers = msh.geometry.input_global_indices[vertices]
    places = [
        (dim, corners, place, dof)
        for dim, group in enumerate(entities)
        for entity, corners in enumerate(group)
        for place, dof in enumerate(layout.entity_dofs(dim, entity))
    ]
    width = max(len(corners) for _, corners, _, _ in places)
    index_map = V.dofmap.index_map
    shape = (index_map.size_local + index_map.num_ghosts, 2 + width)
    keys = np.full(shape, -1, dtype=np.int64)
    for dim, corners, place, dof in places:
        name = numbers[:, corners]
        if dim < msh.topology.dim:
            name = np.sort(name, axis=1)
        keys[dofs[:, dof], :2] = dim, place
        keys[dofs[:, dof], 2 : 2 + len(corners)] = name
    return keys[: index_map.size_local]


def _check_element(V: fem.FunctionSpace) -> None:
    """Refuse elements with several dofs on an edge or face, whose order depends on the partition.

    Lagrange elements up to degree 2 pass, discontinuous ones of any degree.
    """
    leaves = [V.ufl_element()]
    while any(e.sub_elements for e in leaves):
        leaves = [s for e in leaves for s in (e.sub_elements or [e])]
    for e in leaves:
        between = [n for dim in e.num_entity_dofs[1 : V.mesh.topology.dim] for n in dim]
        if max(between, default=0) > 1 or V.element.needs_dof_transformations:
            raise CheckpointError(
                f"A checkpoint cannot hold the element {e!r}: dofs on its edges or faces are "
                "ordered by the partition. Use a Lagrange element of degree 1 or 2, or a "
                "discontinuous one."
            )


def mesh_table(msh: mesh.Mesh) -> tuple[Array, str]:
    """Return on rank 0 the nodes by input number, and a fingerprint of the cells."""
    comm, geometry, topology = msh.comm, msh.geometry, msh.topology
    owned = geometry.index_map().size_local
    numbers, cells = geometry.input_global_indices, topology.index_map(topology.dim).size_local
    nodes = comm.gather((numbers[:owned], geometry.x[:owned, : geometry.dim]))
    tables = comm.gather(numbers[geometry.dofmaps[0][:cells]])
    if nodes is None or tables is None:
        return np.zeros((0, geometry.dim)), ""
    order = np.argsort(np.concatenate([number for number, _ in nodes]))
    rows = np.concatenate(tables)
    digest = _sha256(rows[np.lexsort(rows.T[::-1])])
    return np.concatenate([x for _, x in nodes])[order], f"{len(rows)} cells, SHA-256 {digest}"


def _sha256(keys: npt.NDArray[np.integer]) -> str:
    """Return the SHA-256 of integers, the same on any machine."""
    return hashlib.sha256(np.ascontiguousarray(keys, dtype="<i8").tobytes()).hexdigest()[:16]
