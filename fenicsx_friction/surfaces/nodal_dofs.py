# SPDX-License-Identifier: MIT
"""Which spaces have values at the nodes of a contact surface, and by which dofs."""

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem

Dofs = npt.NDArray[np.int32]


def has_vertex_dofs(V: fem.FunctionSpace) -> bool:
    """Tell whether a space, not a part of one, has one (blocked) dof at each vertex: its value."""
    whole = len(V.component()) == 0
    at_vertex = len(V.dofmap.dof_layout.entity_dofs(0, 0)) == 1
    return whole and at_vertex and V.dofmap.index_map_bs == np.prod(V.value_shape, dtype=int)


def is_nodal(V: fem.FunctionSpace) -> bool:
    """Tell whether a space has dofs at the vertices only."""
    corners = len(basix.geometry(V.mesh.basix_cell()))
    return has_vertex_dofs(V) and V.dofmap.dof_layout.num_dofs == corners


def has_quadratic_dofs(V: fem.FunctionSpace, dim: int) -> bool:
    """Tell whether a space has its value as one dof at each vertex, and between the vertices.

    Args:
        V: The space.
        dim: Entities up to this dimension have a dof each.
    """
    layout, entities = V.dofmap.dof_layout, basix.topology(V.mesh.basix_cell())[1 : dim + 1]
    counts = [
        len(layout.entity_dofs(k, i))
        for k, group in enumerate(entities, 1)
        for i in range(len(group))
    ]
    scalar = V.ufl_element()
    scalar = scalar.sub_elements[0] if scalar.sub_elements else scalar
    values = getattr(scalar.basix_element, "interpolation_is_identity", False)
    return has_vertex_dofs(V) and values and all(count == 1 for count in counts)


def dofs_at(V: fem.FunctionSpace, cells: Dofs, vertices: Dofs) -> Dofs:
    """Return the (blocked) dofs on entities of cells that have one dof at most.

    Args:
        V: The space.
        cells: The cells.
        vertices: Local numbers of the vertices that each entity joins, one row a cell.
    """
    layout = V.dofmap.dof_layout
    entities = basix.topology(V.mesh.basix_cell())
    by_vertices = np.full(2 ** len(entities[0]), -1)
    for dim, group in enumerate(entities):
        for i, corners in enumerate(group):
            if found := layout.entity_dofs(dim, i):
                by_vertices[np.sum(1 << np.array(corners))] = found[0]
    return np.asarray(V.dofmap.list[cells, by_vertices[np.sum(1 << vertices, axis=1)]])
