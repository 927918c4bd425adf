# SPDX-License-Identifier: MIT
"""Puts the nodes of one surface on the faces of another, before the first step."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem, mesh
from dolfinx.la import InsertMode

from ..base.errors import ContactInputError
from ..surfaces.face_cells import blend, shape_matrix
from ..surfaces.faces import FaceSet, check_surfaces
from ..surfaces.surface import ContactSurface
from .search import SearchPolicy, check_positive, find_pairs


def close_initial_gaps(
    msh: mesh.Mesh, facet_tags: mesh.MeshTags, secondary: int, primary: int, reach: float
) -> float:
    """Move the nodes of the secondary surface onto the faces of the primary one; collective.

    Faces of curved surfaces that touch overlap or leave gaps. Without this, the first step would
    press the overlaps apart. This function moves the nodes of the mesh, without strain. Call it
    before you make contact surfaces and forms.

    Args:
        msh: The mesh of both bodies, of linear cells; its geometry is changed.
        facet_tags: Facet tags.
        secondary: Tag of the surface whose nodes are moved.
        primary: Tag of the surface onto which they are moved.
        reach: Nodes with a larger gap or overlap (m) stay where they are.

    Returns:
        The longest way of a node (m).

    Raises:
        ContactInputError: If the mesh is not of linear cells, a tag marks no facet, both mark the
            same, or ``reach`` is no length.
    """
    check_positive(reach, "reach", "the largest gap or overlap (m) that is closed")
    if not isinstance(msh, mesh.Mesh):
        raise ContactInputError(f"msh = {msh!r} must be a dolfinx.mesh.Mesh.")
    d = msh.geometry.dim
    V = fem.functionspace(msh, ("Lagrange", 1, (d,)))
    u = fem.Function(V)
    surface = ContactSurface(msh, facet_tags, secondary, name="secondary")
    other = ContactSurface(msh, facet_tags, primary, name="primary")
    check_surfaces(surface, other)
    way = _ways(FaceSet(surface, u), FaceSet(other, u), reach)
    dofs = surface.parent_dofs(V)
    everywhere = surface.S.dofmap.index_map.local_to_global(np.arange(len(dofs), dtype=np.int32))
    u.x.array.reshape(-1, d)[dofs] = way[everywhere]
    # A rank may have a moved node but not the facets of the surface there.
    moved = fem.Function(V)
    moved.x.array.reshape(-1, d)[dofs] = 1.0
    _spread(u, moved)
    geometry = np.empty(len(u.x.array) // d, dtype=np.int32)
    geometry[V.dofmap.list.ravel()] = msh.geometry.dofmaps[0].ravel()
    msh.geometry.x[geometry, :d] += u.x.array.reshape(-1, d)
    longest = float(np.max(np.linalg.norm(way, axis=1), initial=0.0))
    return float(msh.comm.allreduce(longest, MPI.MAX))


def _ways(nodes: FaceSet, faces: FaceSet, reach: float) -> npt.NDArray[np.floating]:
    """Return the ways of the nodes of all ranks onto the faces (m), 0 beyond reach; collective."""
    x, own = nodes.X[nodes.own], nodes.own
    pairs = find_pairs(
        faces,
        faces.X,
        x,
        nodes.node_normals(nodes.X)[own],
        SearchPolicy(reach=reach),
        np.zeros(len(x), dtype=bool),
    )
    # Into the faces: nodes on a symmetry plane stay on it.
    xi = faces.cell.inside(pairs.xi)
    there = blend(shape_matrix(faces.cell, xi), faces.X[faces.faces[pairs.face]])
    return nodes.gather(np.where(pairs.paired[:, None], there - x, 0.0))


def _spread(values: fem.Function, known: fem.Function) -> None:
    """Give all ranks the values that some ranks have, as the mean of these."""
    for f in (values, known):
        f.x.scatter_reverse(InsertMode.add)
        f.x.scatter_forward()
    values.x.array[:] /= np.maximum(known.x.array, 1.0)
