# SPDX-License-Identifier: MIT
"""Derivatives of the residuals beside their central differences, block by block, off the kinks."""

from typing import NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from ..increment import snapshot
from ..problem import FrictionalContactProblem
from ..solvers.substep import Substep

Array = npt.NDArray[np.floating]

#: Differences that halving the step changes by more than this, relative, meet a kink.
KINK = 3e-7
#: A derivative that changes by more than this within the step, relative, jumps.
JUMP = 1e-3


class BlockDifference(NamedTuple):
    """What a comparison says of one block; see ``BlockCheck``."""

    block: str
    error: float
    rows: int
    kinks: int
    where: str


def compare(
    problem: FrictionalContactProblem,
    substep: Substep,
    free: list[npt.NDArray[np.bool_]],
    direction: list[Array],
    step: float,
) -> list[BlockDifference]:
    """Compare the derivative along the direction with central differences, block by block."""
    here = snapshot.save(problem.state)

    def move(t: float) -> None:
        """Go ``t`` along the direction."""
        for f, values, d in zip(problem.state, here, direction, strict=True):
            f.x.array[:] = values + t * d

    def residual(t: float) -> list[Array]:
        """Assemble the residual there, without boundary conditions."""
        move(t)
        with problem.terms.still():
            contact = [values.ravel() for values in problem.terms.residuals(substep.law)]
        return [*problem.balance.rows(), *contact]

    def derivative(t: float) -> list[Array]:
        """Return the Jacobian there times the direction."""
        move(t)
        return _derivative(problem, substep, direction)

    ends = [residual(t) for t in (step, -step, step / 2.0, -step / 2.0, 0.0)]
    sides = [derivative(t) for t in (step, -step)]
    found = []
    for i, exact in enumerate(derivative(0.0)):
        forth, back, near, behind, middle = (end[i] for end in ends)
        difference, halved = (forth - back) / (2.0 * step), (near - behind) / step
        # Of a smooth row the second differences go with the square of the step.
        curvature = (forth + back - 2.0 * middle) - 4.0 * (near + behind - 2.0 * middle)
        change = np.maximum(abs(difference - halved), abs(curvature) / step)
        jump = np.maximum(abs(sides[0][i] - exact), abs(sides[1][i] - exact))
        change = np.maximum(change, KINK / JUMP * jump)
        found.append(_worst(problem, i, exact, difference, change, free[i][: len(exact)]))
    return found


def _derivative(
    problem: FrictionalContactProblem, substep: Substep, direction: list[Array]
) -> list[Array]:
    """Return the Jacobian times the direction, one array of owned rows a block, not scaled."""
    matrix = substep.jacobian()
    maps = [(f.function_space.dofmap.index_map, f.function_space.dofmap) for f in problem.state]
    sizes = [index_map.size_local * dofmap.index_map_bs for index_map, dofmap in maps]
    d, product = matrix.createVecs()
    d.array[:] = np.concatenate([v[:n] for v, n in zip(direction, sizes, strict=True)])
    matrix.mult(d, product)
    rows = product.array_r / problem.scales.row_factors
    parts = np.split(rows, np.cumsum(sizes)[:-1])
    d.destroy()
    product.destroy()
    return parts


def _worst(
    problem: FrictionalContactProblem,
    i: int,
    exact: Array,
    difference: Array,
    change: Array,
    free: npt.NDArray[np.bool_],
) -> BlockDifference:
    """Find the largest relative difference of block ``i`` over all ranks, and its row."""
    comm, sizes = problem.comm, abs(exact[free])
    scale = float(comm.allreduce(np.max(sizes, initial=0.0), MPI.MAX)) or 1.0
    kink = free & (change > KINK * scale)
    error = np.where(free & ~kink, abs(difference - exact) / scale, 0.0)
    error[~np.isfinite(error)] = np.inf
    row = int(np.argmax(error)) if len(error) else -1
    largest = float(error[row]) if len(error) else 0.0
    where = _name_of_row(problem, i, row) if len(error) else ""
    largest, where = max(comm.allgather((largest, where)))
    counts = comm.allreduce(np.array([np.sum(free & ~kink), np.sum(kink)]), MPI.SUM)
    return BlockDifference(_block_name(problem, i), largest, int(counts[0]), int(counts[1]), where)


def _block_name(problem: FrictionalContactProblem, i: int) -> str:
    """Return the name of the block of unknown ``i``."""
    own = len(problem.unknowns)
    if i < own:
        return "momentum" if i == 0 else f"block {i}"
    return f"contact '{problem.contacts[i - own].surface.name}'"


def _name_of_row(problem: FrictionalContactProblem, i: int, row: int) -> str:
    """Say which row of block ``i`` an owned row is."""
    f, V = problem.state[i], problem.state[i].function_space
    for body in problem.bodies:
        if body.q is f:
            return f"{body.names[row]} of rigid body '{body.name}'"
    node, component = divmod(row, V.dofmap.index_map_bs)
    x = V.tabulate_dof_coordinates()[node][: V.mesh.geometry.dim]
    at = ", ".join(f"{value:.6g}" for value in x)
    names = ("x", "y", "z") if i < len(problem.unknowns) else ("normal", "tangent 1", "tangent 2")
    what = names[component] if V.dofmap.index_map_bs > 1 else "scalar"
    return f"{what} row of {_block_name(problem, i)} at ({at})"
