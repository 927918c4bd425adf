# SPDX-License-Identifier: MIT
"""Which spaces have values at the nodes of a contact surface, and by which dofs."""

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem, mesh

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
    if not has_vertex_dofs(V):
        return False
    scalar = V.ufl_element()
    scalar = scalar.sub_elements[0] if scalar.sub_elements else scalar
    layout, entities = V.dofmap.dof_layout, basix.topology(V.mesh.basix_cell())
    one_each = all(
        len(layout.entity_dofs(k, i)) == 1
        for k in range(1, dim + 1)
        for i in range(len(entities[k]))
    )
    return one_each and getattr(scalar.basix_element, "interpolation_is_identity", False)


def dofs_on_facets(
    V: fem.FunctionSpace,
    S: fem.FunctionSpace,
    facet_map: mesh.EntityMap,
    vertex_map: mesh.EntityMap,
) -> Dofs:
    """Return the (blocked) dofs of a space where another one has its dofs on facets.

    Args:
        V: Space of a mesh, with one dof on each entity where ``S`` has one.
        S: Space of a submesh of facets, of degree 1 or 2.
        facet_map: Relates the facets to those of the mesh.
        vertex_map: Relates their vertices to those of the mesh.

    Returns:
        One row a local facet, in the order of the dofs of ``S``.
    """
    topology, tdim = V.mesh.topology, V.mesh.topology.dim
    topology.create_connectivity(tdim - 1, tdim)
    topology.create_connectivity(tdim, 0)
    (number, size), entities = S.dofmap.list.shape, basix.topology(S.mesh.basix_cell())
    facets = facet_map.sub_topology_to_topology(np.arange(number, dtype=np.int32), inverse=False)
    around = topology.connectivity(tdim - 1, tdim)
    cells = around.array[around.offsets[facets]]
    corners = topology.connectivity(tdim, 0).array
    corners = corners.reshape(-1, len(basix.geometry(V.mesh.basix_cell())))[cells]
    theirs = S.mesh.topology.connectivity(tdim - 1, 0).array[: number * len(entities[0])]
    vertices = vertex_map.sub_topology_to_topology(theirs, inverse=False)
    vertices = vertices.reshape(number, len(entities[0]))
    local = np.argmax(corners[:, None] == vertices[:, :, None], axis=2)
    dofs = np.empty((number, size), dtype=np.int32)
    for dim, group in enumerate(entities):
        for i, joined in enumerate(group):
            for dof in S.dofmap.dof_layout.entity_dofs(dim, i):
                dofs[:, dof] = _dofs_at(V, cells, local[:, joined])
    return dofs


def _dofs_at(V: fem.FunctionSpace, cells: Dofs, vertices: Dofs) -> Dofs:
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
