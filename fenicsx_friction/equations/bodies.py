# SPDX-License-Identifier: MIT
"""The bodies of a mesh: its connected parts, and which may meet."""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
from dolfinx import fem

from ..certificate.groups import Labels, connected
from ..contact.contact import Contact


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


def link_bodies(
    contacts: Sequence[Contact],
    secondary: Sequence[Labels],
    V: fem.FunctionSpace,
    body: Labels,
    number: int,
) -> Labels:
    """Number the groups of bodies that may meet each other; collective.

    Args:
        contacts: The contacts.
        secondary: Body of each owned node of each contact.
        V: Space of the displacement.
        body: Body of each of its local (blocked) dofs.
        number: Number of bodies.

    Returns:
        The group of each body.
    """
    links = [np.column_stack([np.arange(number)] * 2)]
    for k, ours in zip(contacts, secondary, strict=True):
        if k.pairing.deformable:
            meets = np.unique(np.concatenate([ours, body[k.pairing.partners(V)]]))
            found = np.concatenate(V.mesh.comm.allgather(meets))
            links.append(np.column_stack([np.full_like(found, found[0]), found]))
    a, b = np.concatenate(links).T
    return connected(number, a, b)[1]
