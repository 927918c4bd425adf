# SPDX-License-Identifier: MIT
"""The bodies of a mesh: its connected parts; largest values over parts."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Array = npt.NDArray[np.floating]
Labels = npt.NDArray[np.int64]


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


def connected(n: int, a: Labels, b: Labels) -> tuple[int, Labels]:
    """Return the number of connected parts of a graph, and the part of each vertex."""
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(n, n))
    number, part = connected_components(graph.tocsr(), directed=False)
    return int(number), part.astype(np.int64)


class Groups:
    """Takes the largest value of each group of entries.

    Args:
        labels: Group of each entry, or -1 for entries that do not count.
        number: Number of groups.
    """

    def __init__(self, labels: Labels, number: int) -> None:
        self._number = number
        self._entries = np.argsort(labels, kind="stable")
        self._entries = self._entries[labels[self._entries] >= 0]
        ordered = labels[self._entries]
        self._starts = np.flatnonzero(np.diff(ordered, prepend=-1))
        self._groups = ordered[self._starts]

    def largest(self, values: Array) -> Array:
        """Return the largest of the (non-negative) values of each group, 0 where it is empty."""
        result = np.zeros(self._number)
        if len(self._starts):
            result[self._groups] = np.maximum.reduceat(values[self._entries], self._starts)
        return result
