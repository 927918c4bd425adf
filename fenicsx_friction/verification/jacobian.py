# SPDX-License-Identifier: MIT
"""Compare the derived Jacobians with finite differences of the residuals."""

from dataclasses import dataclass
from typing import NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from ..base.validators import instance, integer, number
from ..certificate.nodal_state import OPEN, SLIP, STICK
from ..contact.contact import Contact
from ..increment import snapshot
from ..problem import FrictionalContactProblem
from ..system.substep import Substep
from . import random_state

Array = npt.NDArray[np.floating]

#: Substeps with the blend ``xi`` and the smoothing ``eps`` (relative to tractions) of their check.
VARIANTS = (("stick", 0.0, 0.5), ("slip", 0.3, 0.5), ("projection", 0.0, 0.0), ("projection", 0, 1))
#: Perturbation of the displacement, relative to the size of the smallest facet.
AMPLITUDE = 1e-2
#: A difference that changes by more than this, relative, when the step is halved meets a kink.
KINK = 3e-7
#: A derivative that changes by more than this within the step, relative, jumps.
JUMP = 1e-3


@dataclass(frozen=True)
class BlockCheck:
    """One block of rows of one substep at one state.

    Attributes:
        substep: ``stick``, ``slip`` or ``projection``.
        xi: Blend of the slip rows.
        eps: Smoothing (Pa).
        state: ``present`` or ``mixed``.
        block: ``momentum``, ``block i`` (further unknowns of the user) or ``contact 'name'``.
        error: Largest difference between derivative and finite difference over the largest
            derivative of the block, both in one random direction of all unknowns.
        rows: Number of rows compared.
        kinks: Number of rows left out because a kink of the law lies between the differences.
        where: The row of the largest difference.
    """

    substep: str
    xi: float
    eps: float
    state: str
    block: str
    error: float
    rows: int
    kinks: int
    where: str


@dataclass(frozen=True)
class JacobianReport:
    """What :func:`check_jacobian` found.

    Attributes:
        checks: One entry a substep, state and block.
        states: Number of open, sticking and slipping nodes of each contact in the mixed state.
    """

    checks: tuple[BlockCheck, ...]
    states: tuple[tuple[int, int, int], ...]

    @property
    def worst(self) -> BlockCheck:
        """The check with the largest error."""
        return max(self.checks, key=lambda check: check.error)

    @property
    def error(self) -> float:
        """The largest relative error of all; infinite where a residual is not finite."""
        return self.worst.error

    def largest(self) -> dict[tuple[str, str], float]:
        """Return the largest relative error of each (substep, block)."""
        errors: dict[tuple[str, str], float] = {}
        for check in self.checks:
            key = (check.substep, check.block)
            errors[key] = max(errors.get(key, 0.0), check.error)
        return errors

    def __str__(self) -> str:
        """Return a table of the checks and the worst row."""
        lines = [
            f"{c.substep:<10} {c.state:<7} xi {c.xi:<3g} eps {c.eps:<9.3g} {c.block:<20} "
            f"error {c.error:.1e} in {c.rows} rows, {c.kinks} at kinks"
            for c in self.checks
        ]
        return "\n".join([*lines, f"Largest: {self.error:.1e}, {self.worst.where}."])


def check_jacobian(
    problem: FrictionalContactProblem,
    *,
    seed: int = 0,
    step: float = 1e-7,
    amplitude: float | None = None,
) -> JacobianReport:
    """Compare the Jacobian of each substep with central differences of its residual; collective.

    It does so twice: at the present state, and at a state near it whose contact nodes are open,
    sticking and slipping at random. In this mixed state each node is away from the kinks: the
    arguments of ``max`` and projection are at least half the perturbation, about 1e4 steps, from
    their switch. Other kinks may still lie between the differences: the cap of a limit, or a state
    that touches with ``g = c_n = 0``, where ``max`` takes the derivative of one side. Halving the
    step and the jump of the derivative show such rows. They are left out and counted.

    Args:
        problem: The problem; its state and history are the same after, bit for bit.
        seed: Seed of the random state and direction.
        step: Step of the differences, relative to the size of the smallest facet.
        amplitude: Perturbation of the displacement (m); 1/100 of the smallest facet by default.

    Returns:
        The report, equal on all ranks.
    """
    instance(problem, FrictionalContactProblem, "problem", "a FrictionalContactProblem")
    integer(seed, "seed", at_least=0)
    number(step, "step", above=0.0)
    if amplitude is not None:
        number(amplitude, "amplitude (m)", above=0.0)
    rng = np.random.default_rng([seed, problem.comm.rank])
    local = min(np.min(k.surface.area.x.array, initial=np.inf) for k in problem.contacts)
    dim = problem.u.function_space.mesh.topology.dim
    size = float(problem.comm.allreduce(local, MPI.MIN)) ** (1.0 / (dim - 1))
    amplitude = AMPLITUDE * size if amplitude is None else amplitude
    stiffness = min(np.min(k.r.x.array, initial=np.inf) for k in problem.contacts)
    traction = amplitude * float(problem.comm.allreduce(stiffness, MPI.MIN))
    checks = []
    with random_state.kept(problem):
        free = random_state.free_masks(problem)
        random_state.freeze(problem, rng, traction, amplitude)
        direction = random_state.direction(problem, free, size, rng)
        for name in ("present", "mixed"):
            if name == "mixed":
                random_state.mix(problem, free, amplitude, rng)
            here = snapshot.save(problem.state)
            for kind, xi, eps in VARIANTS:
                problem._xi.value = np.asarray(xi)
                problem._eps.value = np.asarray(eps * traction)
                found = _compare(problem, getattr(problem, kind), free, direction, step)
                snapshot.restore(problem.state, here)
                checks += [BlockCheck(kind, xi, eps * traction, name, *entry) for entry in found]
        states = tuple(_count(problem, k) for k in problem.contacts)
    return JacobianReport(tuple(checks), states)


def _count(problem: FrictionalContactProblem, k: Contact) -> tuple[int, int, int]:
    """Count the open, sticking and slipping nodes of a contact."""
    nodal = k.present()
    counts = np.bincount(nodal.states()[nodal.takes_part], minlength=3)
    total = problem.comm.allreduce(counts, MPI.SUM)
    return int(total[OPEN]), int(total[STICK]), int(total[SLIP])


class _Found(NamedTuple):
    """What a comparison says of one block; see :class:`BlockCheck`."""

    block: str
    error: float
    rows: int
    kinks: int
    where: str


def _compare(
    problem: FrictionalContactProblem,
    substep: Substep,
    free: list[npt.NDArray[np.bool_]],
    direction: list[Array],
    step: float,
) -> list[_Found]:
    """Compare the derivative along the direction with central differences, block by block."""
    here = snapshot.save(problem.state)

    def move(t: float) -> None:
        """Go ``t`` along the direction."""
        for f, values, d in zip(problem.state, here, direction, strict=True):
            f.x.array[:] = values + t * d

    def residual(t: float) -> list[Array]:
        """Assemble the residual there, without boundary conditions."""
        move(t)
        contact = [values.ravel() for values in problem.terms.residuals(substep.law)]
        return [problem.assemble_momentum(), *problem.assemble_others(), *contact]

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
        # The second differences of a smooth row are proportional to the square of the step.
        curvature = (forth + back - 2.0 * middle) - 4.0 * (near + behind - 2.0 * middle)
        change = np.maximum(abs(difference - halved), abs(curvature) / step)
        jump = np.maximum(abs(sides[0][i] - exact), abs(sides[1][i] - exact))
        change = np.maximum(change, KINK / JUMP * jump)
        found.append(_worst(problem, i, exact, difference, change, free[i][: len(exact)]))
    return found


def _derivative(
    problem: FrictionalContactProblem, substep: Substep, direction: list[Array]
) -> list[Array]:
    """Return the Jacobian times the direction, one array of owned rows a block."""
    matrix = substep.jacobian()
    maps = [(f.function_space.dofmap.index_map, f.function_space.dofmap) for f in problem.state]
    sizes = [index_map.size_local * dofmap.index_map_bs for index_map, dofmap in maps]
    d, product = matrix.createVecs()
    d.array[:] = np.concatenate([v[:n] for v, n in zip(direction, sizes, strict=True)])
    matrix.mult(d, product)
    parts = np.split(product.array.copy(), np.cumsum(sizes)[:-1])
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
) -> _Found:
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
    return _Found(_block_name(problem, i), largest, int(counts[0]), int(counts[1]), where)


def _block_name(problem: FrictionalContactProblem, i: int) -> str:
    """Return the name of the block of unknown ``i``."""
    own = len(problem.unknowns)
    if i < own:
        return "momentum" if i == 0 else f"block {i}"
    return f"contact '{problem.contacts[i - own].surface.name}'"


def _name_of_row(problem: FrictionalContactProblem, i: int, row: int) -> str:
    """Say which row of block ``i`` an owned row is."""
    V = problem.state[i].function_space
    node, component = divmod(row, V.dofmap.index_map_bs)
    x = V.tabulate_dof_coordinates()[node][: V.mesh.geometry.dim]
    at = ", ".join(f"{value:.6g}" for value in x)
    names = ("x", "y", "z") if i < len(problem.unknowns) else ("normal", "tangent 1", "tangent 2")
    what = names[component] if V.dofmap.index_map_bs > 1 else "scalar"
    return f"{what} row of {_block_name(problem, i)} at ({at})"
