# SPDX-License-Identifier: MIT
"""The rounding errors of a residual, measured.

A stress at finite strain is a difference of numbers of the size of the stiffness. So a small stress
has the same rounding error as a large one. How large it is depends on how the residual is written.
Its second difference over a very small step shows it: this consists of rounding only.
"""

from collections.abc import Callable, Sequence

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..surfaces.cells import extreme_sizes

Array = npt.NDArray[np.floating]
#: Strain of the step, and its fraction of further unknowns: large enough to change many digits of a
#: deformation gradient, small enough to meet hardly any kink.
PERTURBATION = 1e-12


def rounding_errors(
    unknowns: Sequence[fem.Function], residuals: Callable[[], list[Array]]
) -> list[Array]:
    """Return the rounding errors of residuals at the present state; collective.

    Args:
        unknowns: The unknowns of the bulk, displacement first; their values are put back.
        residuals: Assembles the rows of the owned dofs, one array an equation.
    """
    comm = unknowns[0].function_space.mesh.comm
    kept = [f.x.array.copy() for f in unknowns]
    lengths = [extreme_sizes(unknowns[0].function_space.mesh)[0]]
    lengths += [comm.allreduce(float(np.max(abs(a), initial=0.0)), MPI.MAX) for a in kept[1:]]
    generator, steps = np.random.default_rng(comm.rank), []
    for f, length in zip(unknowns, lengths, strict=True):
        step = fem.Function(f.function_space)
        step.x.array[:] = PERTURBATION * length * generator.uniform(-0.5, 0.5, len(f.x.array))
        step.x.scatter_forward()
        steps.append(step)
    try:
        found = []
        for way in (-1.0, 0.0, 1.0):
            for f, values, step in zip(unknowns, kept, steps, strict=True):
                f.x.array[:] = values + way * step.x.array
            found.append(residuals())
    finally:
        for f, values in zip(unknowns, kept, strict=True):
            f.x.array[:] = values
    return [abs(a - 2.0 * b + c) for a, b, c in zip(*found, strict=True)]
