# SPDX-License-Identifier: MIT
"""The bodies of a mesh: its connected parts, and where points are in them."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem, geometry, mesh

from ..base.groups import Labels, connected


def number_bodies(V: fem.FunctionSpace) -> tuple[int, Labels]:
    """Number the bodies of a mesh, which share no vertex; collective.

    Args:
        V: A space of the mesh, continuous or not.

    Returns:
        How many there are, and the body of each local (blocked) dof of the space. Only the order of
        the bodies depends on the number of ranks.
    """
    comm, vertices = V.mesh.comm, fem.functionspace(V.mesh, ("Lagrange", 1))
    index_map, cells = vertices.dofmap.index_map, vertices.dofmap.list
    n = index_map.size_local + index_map.num_ghosts
    first = np.repeat(cells[:, 0], cells.shape[1] - 1)
    number, part = connected(n, first, cells[:, 1:].ravel())
    part = part + comm.scan(number) - number  # unique among all ranks
    owner = fem.Function(vertices, dtype=np.float64)
    owner.x.array[:] = part
    owner.x.scatter_forward()
    theirs = np.rint(owner.x.array).astype(np.int64)
    joints = np.concatenate(comm.allgather(np.unique(np.column_stack([part, theirs]), axis=0)))
    total = comm.allreduce(number, MPI.SUM)
    bodies, body = connected(total, joints[:, 0], joints[:, 1])
    dofs = V.dofmap.index_map
    result = np.zeros(dofs.size_local + dofs.num_ghosts, dtype=np.int64)
    result[V.dofmap.list] = body[part][cells[:, :1]]
    return bodies, result


def cells_at(
    msh: mesh.Mesh, points: npt.NDArray[np.floating]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int32]]:
    """Return points, by number, and the cells of this rank in which they are, in pairs."""
    x = np.zeros((len(points), 3))
    x[:, : points.shape[1]] = points
    tree = geometry.bb_tree(msh, msh.topology.dim)
    near = geometry.compute_collisions_points(tree, x)
    found = geometry.compute_colliding_cells(msh, near, x)
    return np.repeat(np.arange(len(x)), np.diff(found.offsets)), found.array
