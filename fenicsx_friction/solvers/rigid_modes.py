# SPDX-License-Identifier: MIT
"""Rigid-body modes: what multigrid must know of elasticity."""

from petsc4py import PETSc

import numpy as np
from dolfinx import fem


def rigid_modes(V: fem.FunctionSpace) -> PETSc.NullSpace:
    """Return the rigid-body modes of a displacement with nodal values, orthonormal; collective.

    They are those of the reference configuration. Bodies that share no node need no modes of
    their own: aggregates lie inside one body, and there the modes of all are those of the body.
    """
    d, n, comm = V.mesh.geometry.dim, V.dofmap.index_map.size_local, V.mesh.comm
    x = V.tabulate_dof_coordinates()[:n, :d]
    centre = comm.allreduce(x.sum(axis=0)) / comm.allreduce(n)  # far from it, digits are lost
    size = np.sqrt(comm.allreduce(float(np.sum((x - centre) ** 2))) / comm.allreduce(n))
    places = PETSc.Vec().createWithArray(((x - centre) / size).ravel(), bsize=d, comm=comm)
    modes = PETSc.NullSpace().createRigidBody(places)
    places.destroy()
    return modes
