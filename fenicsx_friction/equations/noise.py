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
#: So many times larger are errors whose effect is measured: this must not drown in rounding.
MAGNIFIED = 1e6


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


def caused_by(unknown: fem.Function, errors: Array, residual: Callable[[], Array]) -> Array:
    """Return the changes of a residual that errors of an unknown cause, of any sign; collective.

    Args:
        unknown: Its values are put back.
        errors: Sizes of the errors at the owned dofs.
        residual: Assembles the residual at the owned dofs.
    """
    generator = np.random.default_rng(unknown.function_space.mesh.comm.rank)
    before, kept = residual(), unknown.x.array.copy()
    try:
        signs = generator.choice([-1.0, 1.0], len(errors))
        unknown.x.array[: len(errors)] += MAGNIFIED * errors * signs
        unknown.x.scatter_forward()
        return abs(residual() - before) / MAGNIFIED
    finally:
        unknown.x.array[:] = kept
