# SPDX-License-Identifier: MIT
"""The rounding errors of a residual, found by trying it out.

A stress of finite strain is the difference of numbers of the size of the stiffness, so that small
ones round as large ones would. What a residual hides depends on how it is written: it is seen from
its second difference, which is nothing but rounding when the difference is small.
"""

from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem

Array = npt.NDArray[np.floating]
#: Strain of the difference: many digits of a deformation gradient, next to nothing to a kink.
STRAIN = 1e-12


def rounding_errors(u: fem.Function, forces: Callable[[], Array]) -> Array:
    """Return the rounding errors of nodal forces at the present displacement; collective.

    Args:
        u: The displacement; as it was afterwards.
        forces: Assembles the forces (N) of the owned dofs.
    """
    msh = u.function_space.mesh
    cells = np.arange(msh.topology.index_map(msh.topology.dim).size_local, dtype=np.int32)
    sizes = msh.h(msh.topology.dim, cells)
    size = msh.comm.allreduce(float(np.min(sizes, initial=np.inf)), MPI.MIN)
    kept = u.x.array.copy()
    generator = np.random.default_rng(msh.comm.rank)
    step = fem.Function(u.function_space)
    step.x.array[:] = STRAIN * size * generator.uniform(-0.5, 0.5, len(kept))
    step.x.scatter_forward()
    try:
        found = []
        for way in (-1.0, 0.0, 1.0):
            u.x.array[:] = kept + way * step.x.array
            found.append(forces())
    finally:
        u.x.array[:] = kept
    return abs(found[0] - 2.0 * found[1] + found[2])
