# SPDX-License-Identifier: MIT
"""Increments of contact in matrices, for tests of their exact solution."""

import numpy as np
import numpy.typing as npt

from fenicsx_friction.verification.soclcp import ExactSolution, Increment

Array = npt.NDArray[np.float64]


def make_increment(
    stiffness: npt.ArrayLike,
    load: npt.ArrayLike,
    mu: float,
    gap: npt.ArrayLike = 0.0,
    previous: npt.ArrayLike = 0.0,
    dim: int = 2,
) -> Increment:
    """Fill an increment from scalars or arrays, all components free."""
    n = np.size(load) // dim
    return Increment(
        stiffness=np.asarray(stiffness, dtype=float),
        load=np.asarray(load, dtype=float).ravel(),
        gap=np.broadcast_to(gap, n).astype(float),
        previous=np.broadcast_to(previous, (n, dim - 1)).astype(float),
        mu=np.broadcast_to(mu, n).astype(float),
        free=np.ones((n, dim), dtype=bool),
    )


def random_increment(rng: np.random.Generator, n: int, dim: int, mu: float) -> Increment:
    """Draw a full symmetric positive definite stiffness, loads, gaps and a previous state."""
    m = rng.normal(size=(n * dim, n * dim))
    return make_increment(
        m @ m.T / (n * dim) + 0.1 * np.eye(n * dim),
        rng.normal(size=n * dim),
        mu,
        gap=np.where(rng.random(n) < 0.5, 0.0, 0.3 * rng.normal(size=n)),
        previous=0.3 * rng.normal(size=(n, dim - 1)),
        dim=dim,
    )


def dissipation(solution: ExactSolution) -> Array:
    return -np.sum(solution.force[:, 1:] * solution.slip, axis=1)
