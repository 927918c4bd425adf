# SPDX-License-Identifier: MIT
"""Random states of a problem at which its Jacobian is checked."""

from collections.abc import Iterator
from contextlib import contextmanager

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..certificate.nodal_state import OPEN, STICK, UNLIMITED
from ..contact.contact import Contact
from ..equations.conditions import constrained
from ..increment import snapshot
from ..problem import FrictionalContactProblem

Array = npt.NDArray[np.floating]

#: Nodes are put this far from both sides of a kink, relative to the amplitude.
MARGIN = 0.5


@contextmanager
def kept(problem: FrictionalContactProblem) -> Iterator[None]:
    """Put back everything that a check changes."""
    frozen = [f for k in problem.contacts for f in (k.c_stick, k.slipping, k.slip_scale, k.scale)]
    functions = [*problem.state, *frozen]
    before = snapshot.save(functions)
    for k in problem.contacts:  # so that nodal values have the kinks of the rows
        k.scale.x.array[:] = k.r.x.array
    xi, eps = problem._xi.value.copy(), problem._eps.value.copy()
    try:
        yield
    finally:
        snapshot.restore(functions, before)
        problem._xi.value, problem._eps.value = xi, eps


def free_masks(problem: FrictionalContactProblem) -> list[npt.NDArray[np.bool_]]:
    """Tell which (local) dofs of each unknown no condition holds."""
    unknowns = [constrained(f.function_space, problem.bcs) for f in problem.unknowns]
    return [f.x.array == 0.0 for f in unknowns] + [k.free.x.array > 0.5 for k in problem.contacts]


def freeze(
    problem: FrictionalContactProblem, rng: np.random.Generator, traction: float, length: float
) -> None:
    """Choose stick traction, nodes and scale of the slip rows at random."""
    for k in problem.contacts:
        n = k.surface.num_owned
        k.c_stick.x.array[:] = traction * rng.normal(size=len(k.c_stick.x.array))
        limit = k.friction_at_unit_pressure()
        k.slipping.x.array[:n] = rng.integers(0, 2, n) * (limit < UNLIMITED)
        k.slip_scale.x.array[:] = length
        for f in (k.c_stick, k.slipping):
            f.x.scatter_forward()


def direction(
    problem: FrictionalContactProblem,
    free: list[npt.NDArray[np.bool_]],
    size: float,
    rng: np.random.Generator,
) -> list[Array]:
    """Return a random direction in which all unknowns count about the same."""
    scales: list[Array | float] = [size]
    for f in problem.unknowns[1:]:
        largest = problem.comm.allreduce(np.max(np.abs(f.x.array), initial=0.0), MPI.MAX)
        scales.append(largest or 1.0)
    dim = problem.u.function_space.mesh.geometry.dim
    scales += [size * np.repeat(k.r.x.array, dim) for k in problem.contacts]
    directions = []
    for f, mask, scale in zip(problem.state, free, scales, strict=True):
        d = fem.Function(f.function_space)
        d.x.array[:] = np.where(mask, scale * rng.uniform(-1.0, 1.0, len(mask)), 0.0)
        d.x.scatter_forward()
        directions.append(d.x.array.copy())
    return directions


def mix(
    problem: FrictionalContactProblem,
    free: list[npt.NDArray[np.bool_]],
    amplitude: float,
    rng: np.random.Generator,
) -> None:
    """Shake the body, then choose the multipliers so that nodes are open, stick and slip."""
    u = problem.u
    u.x.array[:] += np.where(free[0], amplitude * rng.uniform(-1.0, 1.0, len(free[0])), 0.0)
    u.x.scatter_forward()
    for k, mask in zip(problem.contacts, free[len(problem.unknowns) :], strict=True):
        _choose_multipliers(k, mask, amplitude, rng)


def _choose_multipliers(
    k: Contact, free: npt.NDArray[np.bool_], amplitude: float, rng: np.random.Generator
) -> None:
    """Put each node into a random state, away from the kinks."""
    n, d = k.surface.num_owned, k.surface.mesh.geometry.dim
    c, mask = k.c.x.array[: n * d].reshape(n, d), free[: n * d].reshape(n, d)
    kind = rng.permutation(np.arange(n) % 3)
    kinematic = k.present()
    traction = k.r.x.array[:n] * amplitude
    pressure = np.where(kind == OPEN, -1.0, 1.0) * traction * rng.uniform(MARGIN, 2.0, n)
    c[:, 0] = kinematic.r * kinematic.gap + pressure
    k.c.x.scatter_forward()
    limit = k.present().limit
    # The trial traction c_t - r s: of half or twice the limit, in the disk variables of the law.
    trial = rng.normal(size=(n, d - 1))
    trial /= np.linalg.norm(trial, axis=1)[:, None]
    length = np.where(kind == STICK, MARGIN, 1.0 / MARGIN) * limit
    trial *= np.where((limit > 0.0) & (limit < UNLIMITED), length, traction)[:, None]
    disk = trial + kinematic.r[:, None] * kinematic.slip
    c[:, 1:] = np.einsum("ijk,ik->ij", _from_disk(k), disk)
    c[~mask] = 0.0
    k.c.x.scatter_forward()


def _from_disk(k: Contact) -> Array:
    """Return each node's linear map from the law's disk variables to tangential tractions."""
    n, d = k.surface.num_owned, k.surface.mesh.geometry.dim
    kept, columns = k.c.x.array.copy(), []
    for axis in range(1, d):
        k.c.x.array.reshape(-1, d)[:, 1:] = np.eye(d - 1)[axis - 1]
        columns.append(k.present().c[:, 1:])
    k.c.x.array[:] = kept
    return np.linalg.inv(np.stack(columns, axis=2)) if n else np.empty((0, d - 1, d - 1))
