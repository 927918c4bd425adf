# SPDX-License-Identifier: MIT
"""The exact reference on many nodes: all states enumerated, invariances, wrong solutions."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from fenicsx_friction.verification.cone import project
from fenicsx_friction.verification.soclcp import (
    ExactSolution,
    Increment,
    natural_residual,
    solve_increment,
)
from increments import Array, dissipation, make_increment, random_increment


def enumerate_states(increment: Increment) -> Iterator[Array]:
    """Yield the displacement of every admissible state: open, stick, slip + or - per node (2D)."""
    n, eye = len(increment.mu), np.eye(2 * len(increment.mu))
    law = {  # state: coefficients of (q_n, q_t, r_n, r_t) in its two equations, without mu
        "open": ([0, 0, 1, 0], [0, 0, 0, 1]),
        "stick": ([1, 0, 0, 0], [0, 1, 0, 0]),
        "slip+": ([1, 0, 0, 0], [0, 0, 1, 1]),
        "slip-": ([1, 0, 0, 0], [0, 0, -1, 1]),
    }
    for states in product(law, repeat=n):
        matrix = np.block([[increment.stiffness, -eye], [np.zeros_like(eye), np.zeros_like(eye)]])
        rhs = np.concatenate([increment.load, np.zeros(2 * n)])
        for i, state in enumerate(states):
            columns, row = [2 * i, 2 * i + 1, 2 * (n + i), 2 * (n + i) + 1], 2 * (n + i)
            matrix[row : row + 2, columns] = law[state]
            matrix[row + 1, columns[2]] *= increment.mu[i]
            rhs[row] = 0.0 if state == "open" else -increment.gap[i]
            rhs[row + 1] = increment.previous[i, 0] if state == "stick" else 0.0
        q, r = np.linalg.solve(matrix, rhs).reshape(2, n, 2)
        gap, slip = increment.gap + q[:, 0], q[:, 1] - increment.previous[:, 0]
        inside = np.abs(r[:, 1]) <= increment.mu * r[:, 0] + 1e-9
        if (inside & (r[:, 0] > -1e-9) & (gap > -1e-9) & (r[:, 1] * slip < 1e-9)).all():
            yield q


@pytest.mark.parametrize("mu", [0.0, 0.2, 1.0, 5.0])
def test_enumeration_of_all_states(mu: float) -> None:
    """The solution is one of those found by trying all 4^n states; the only one for small mu."""
    rng = np.random.default_rng(3)
    for _ in range(12):
        increment = random_increment(rng, int(rng.integers(1, 5)), 2, mu)
        admissible = list(enumerate_states(increment))
        solution = solve_increment(increment)
        errors = [np.abs(solution.displacement - q).max() for q in admissible]
        assert min(errors) < 1e-8
        assert max(errors) < 1e-8 or mu > 0.2


def test_high_friction_beyond_the_first_attempt() -> None:
    """Sixty problems of mu = 5, some of which fold the smoothed path, all end certified."""
    rng = np.random.default_rng(11)
    solutions = [solve_increment(random_increment(rng, 4, 2, 5.0)) for _ in range(60)]
    assert max(solution.residual for solution in solutions) <= 1e-10
    assert max(solution.iterations for solution in solutions) > 200  # else this tests nothing


@pytest.mark.parametrize("mu", [0.2, 0.5, 1.0, 2.0])
def test_random_3d_solutions_are_physical(mu: float) -> None:
    rng = np.random.default_rng(5)
    for n in (1, 3, 8, 15):
        increment = random_increment(rng, n, 3, mu)
        solution = solve_increment(increment)
        tangential = np.linalg.norm(solution.force[:, 1:], axis=1)
        assert natural_residual(increment, solution.displacement, solution.force) <= 1e-10
        assert (solution.force[:, 0] >= 0).all() and solution.gap.min() >= -1e-9
        assert (tangential <= mu * solution.force[:, 0] + 1e-9).all()
        np.testing.assert_allclose(
            dissipation(solution),
            mu * solution.force[:, 0] * np.linalg.norm(solution.slip, axis=1),
            atol=1e-9,
        )


def test_manufactured_3d_solution() -> None:
    """Pick states, slips and forces that satisfy the law, derive the load, recover them."""
    rng = np.random.default_rng(8)
    n, mu = 30, 0.2
    m = rng.normal(size=(3 * n, 3 * n))
    stiffness = np.eye(3 * n) + 0.1 * m @ m.T / n
    state = rng.integers(0, 3, n)  # open, stick, slip
    angle = rng.uniform(0, 2 * np.pi, n)
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    r_n = np.where(state > 0, rng.uniform(0.5, 1.5, n), 0.0)
    r_t = -unit * (mu * r_n * np.where(state == 2, 1.0, rng.uniform(0, 0.9, n)))[:, None]
    slip = unit * np.where(state == 1, 0.0, rng.uniform(0.1, 1.0, n))[:, None]
    gap = np.where(state == 0, rng.uniform(0.1, 1.0, n), 0.0)
    previous, gap0 = rng.normal(size=(n, 2)), rng.normal(size=n)
    q, r = np.column_stack([gap - gap0, slip + previous]), np.column_stack([r_n, r_t])
    load = stiffness @ q.ravel() - r.ravel()
    solution = solve_increment(make_increment(stiffness, load, mu, gap0, previous, dim=3))
    np.testing.assert_allclose(solution.displacement, q, atol=1e-10)
    np.testing.assert_allclose(solution.force, r, atol=1e-10)


@pytest.mark.parametrize("dim", [2, 3])
def test_units_do_not_matter(dim: int) -> None:
    """Forces in uN, lengths in km, and a rigid shift of the history give the same numbers."""
    base = random_increment(np.random.default_rng(4), 6, dim, 1.0)
    reference = solve_increment(base)
    newton, metre = 1e6, 1e-3
    scaled = replace(
        base,
        stiffness=base.stiffness * newton / metre,
        load=base.load * newton,
        gap=base.gap * metre,
        previous=base.previous * metre,
    )
    solution = solve_increment(scaled)
    np.testing.assert_allclose(solution.force / newton, reference.force, atol=1e-9)
    np.testing.assert_allclose(solution.displacement / metre, reference.displacement, atol=1e-9)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_smoothed_projection(dim: int) -> None:
    """Its derivative is that of its value; it tends to the projection, which splits v in x - y."""
    v = np.random.default_rng(6).normal(size=(50, dim))
    v[0, 1:] = 0.0  # equal spectral values
    _, slope = project(v, 0.1)
    for j, step in enumerate(1e-6 * np.eye(dim)):
        difference = (project(v + step, 0.1)[0] - project(v - step, 0.1)[0]) / 2e-6
        np.testing.assert_allclose(slope[:, :, j], difference, atol=1e-8)
    x = project(v, 0.0)[0]
    y = x - v
    np.testing.assert_allclose(project(v, 1e-9)[0], x, atol=1e-8)
    for part in (x, y):
        assert (np.linalg.norm(part[:, 1:], axis=1) <= part[:, 0] + 1e-12).all()
    np.testing.assert_allclose(np.sum(x * y, axis=1), 0.0, atol=1e-12)


# --- the certificate must be able to fail --------------------------------------------------------


def mutations(increment: Increment, solution: ExactSolution) -> Iterator[tuple[str, float]]:
    q, r = solution.displacement, solution.force
    flip = r * np.r_[1.0, -np.ones(r.shape[1] - 1)]
    yield "as it is", natural_residual(increment, q, r)
    yield "sign of r_t", natural_residual(increment, q, flip)
    rebalanced = replace(increment, load=increment.load + (r - flip).ravel())
    yield "sign of r_t, in equilibrium", natural_residual(rebalanced, q, flip)
    yield "mu + 1 %", natural_residual(replace(increment, mu=1.01 * increment.mu), q, r)
    yield "mu - 1 %", natural_residual(replace(increment, mu=0.99 * increment.mu), q, r)
    yield "gap + 1e-3", natural_residual(replace(increment, gap=increment.gap + 1e-3), q, r)
    yield "gap - 1e-3", natural_residual(replace(increment, gap=increment.gap - 1e-3), q, r)
    yield "load", natural_residual(replace(increment, load=1.001 * increment.load), q, r)
    shifted = replace(increment, previous=increment.previous + 2 * solution.slip)
    yield "slip reversed", natural_residual(shifted, q, r)


@pytest.mark.parametrize("dim", [2, 3])
def test_certificate_rejects_mutations(dim: int) -> None:
    increment = random_increment(np.random.default_rng(2), 8, dim, 0.5)
    solution = solve_increment(increment)
    slipping = (np.linalg.norm(solution.slip, axis=1) > 1e-6) & (solution.force[:, 0] > 1e-6)
    assert slipping.any() and not slipping.all()
    residuals = dict(mutations(increment, solution))
    assert residuals.pop("as it is") == solution.residual <= 1e-10
    assert min(residuals.values()) > 1e-4, residuals


def test_certificate_is_first_order_in_direction() -> None:
    """A slip direction wrong by 1e-6 must show as 1e-6, not 1e-12 as in the product r_t . s."""
    increment = make_increment(2.0 * np.eye(3), [-2.0, 3.0, 0.0], 0.5, dim=3)
    q, r = np.array([[0.0, 1.0, 0.0]]), np.array([[2.0, -1.0, 0.0]])
    assert natural_residual(increment, q, r) < 1e-15
    turned = r + np.array([[0.0, 0.0, 1e-6]])
    balanced = replace(increment, load=increment.load - (turned - r).ravel())
    assert 1e-7 < natural_residual(balanced, q, turned) < 1e-5
