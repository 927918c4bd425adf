# SPDX-License-Identifier: MIT
"""The exact reference on one node and on two: closed forms, held parts, floating bodies."""

from dataclasses import replace

import numpy as np
import pytest

from fenicsx_friction.verification.soclcp import NoExactSolution, natural_residual, solve_increment
from increments import dissipation, make_increment

# --- one node, springs k = 2 N/m ---------------------------------------------------------------


@pytest.mark.quick
@pytest.mark.parametrize(
    ("load", "mu", "displacement", "force"),
    [
        pytest.param([1.0, 0.5], 0.5, [0.5, 0.25], [0.0, 0.0], id="open"),
        pytest.param([-2.0, 0.5], 0.5, [0.0, 0.0], [2.0, -0.5], id="stick"),
        pytest.param([-2.0, 3.0], 0.5, [0.0, 1.0], [2.0, -1.0], id="slip"),
        pytest.param([-2.0, -3.0], 0.5, [0.0, -1.0], [2.0, 1.0], id="slip-back"),
        pytest.param([-2.0, 3.0], 0.0, [0.0, 1.5], [2.0, 0.0], id="frictionless"),
        pytest.param([1.0, 0.5, -1.0], 1.0, [0.5, 0.25, -0.5], [0.0, 0.0, 0.0], id="open-3d"),
        pytest.param([-2.0, 0.3, -0.4], 0.5, [0, 0, 0], [2.0, -0.3, 0.4], id="stick-3d"),
        pytest.param([-2.0, 3.0, -4.0], 0.5, [0, 1.2, -1.6], [2.0, -0.6, 0.8], id="slip-3d"),
    ],
)
def test_one_node(
    load: list[float], mu: float, displacement: list[float], force: list[float]
) -> None:
    increment = make_increment(2.0 * np.eye(len(load)), load, mu, dim=len(load))
    solution = solve_increment(increment)
    np.testing.assert_allclose(solution.displacement[0], displacement, atol=1e-12)
    np.testing.assert_allclose(solution.force[0], force, atol=1e-12)
    np.testing.assert_allclose(solution.gap, solution.displacement[:, 0])


def test_one_node_history_with_reversal() -> None:
    """Load, unload, reverse: k = 2, mu r_n = 1, hence slip beyond |load - 2 previous| = 1."""
    increment = make_increment(2.0 * np.eye(2), [-2.0, 0.0], 0.5)
    path = [(3.0, 1.0), (2.0, 1.0), (1.0, 1.0), (0.0, 0.5), (-3.0, -1.0), (-1.5, -1.0), (0.0, -0.5)]
    for pull, expected in path:
        load = np.array([-2.0, pull])
        solution = solve_increment(replace(increment, load=load))
        assert solution.displacement[0, 1] == pytest.approx(expected, abs=1e-12)
        assert solution.force[0, 1] == pytest.approx(2 * expected - pull, abs=1e-12)
        assert dissipation(solution)[0] >= -1e-15
        increment = replace(increment, previous=solution.displacement[:, 1:])


def test_grazing_contact_and_zero_state() -> None:
    """A node that just touches, and nothing at all, are solutions too."""
    grazing = solve_increment(make_increment(np.eye(2), [-1.0, 0.5], 0.5, gap=1.0))
    np.testing.assert_allclose(grazing.displacement, [[-1.0, 0.5]], atol=1e-9)
    nothing = solve_increment(make_increment(np.eye(6), np.zeros(6), 0.5, dim=3))
    assert not nothing.displacement.any() and not nothing.force.any()


# --- prescribed components -----------------------------------------------------------------------


@pytest.mark.parametrize("row_unit", [1.0, 1e-11, 1e11])
def test_prescribed_tangent_carries_no_friction(row_unit: float) -> None:
    """One of two tangents is held at 0.25: friction acts along the other; any row unit will do."""
    increment = make_increment(np.diag([2.0, row_unit, 2.0]), [-2, 0.25 * row_unit, 3], 0.5, dim=3)
    solution = solve_increment(replace(increment, free=np.array([[True, False, True]])))
    np.testing.assert_allclose(solution.displacement, [[0.0, 0.25, 1.0]], atol=1e-12)
    np.testing.assert_allclose(solution.force, [[2.0, 0.0, -1.0]], atol=1e-12)
    wrong = solution.displacement + np.array([[0.0, 1e-6, 0.0]])  # not the prescribed value
    held = replace(increment, free=np.array([[True, False, True]]))
    assert 1e-7 < natural_residual(held, wrong, solution.force) < 1e-5


def test_prescribed_normal_takes_node_out_of_contact() -> None:
    increment = make_increment(2.0 * np.eye(4), [-2.0, 3.0, -2.0, 3.0], 0.5)
    solution = solve_increment(replace(increment, free=np.array([[False, True], [True, True]])))
    np.testing.assert_allclose(solution.displacement, [[-1.0, 1.5], [0.0, 1.0]], atol=1e-12)
    np.testing.assert_allclose(solution.force, [[0.0, 0.0], [2.0, -1.0]], atol=1e-12)


# --- floating bodies -----------------------------------------------------------------------------


def test_floating_bar_slips_at_one_end() -> None:
    """Two nodes joined by springs only: the pull 0.75 exceeds 0.5 at one end, the other holds."""
    springs = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.diag([3.0, 2.0]))
    solution = solve_increment(make_increment(springs, [-1.0, 0.0, -1.0, 0.75], 0.5))
    np.testing.assert_allclose(solution.force, [[1.0, -0.25], [1.0, -0.5]], atol=1e-10)
    np.testing.assert_allclose(solution.displacement, [[0.0, 0.0], [0.0, 0.125]], atol=1e-10)


@pytest.mark.parametrize("load", [[-1.0, 0.0, -1.0, 1.2], [1.0, 0.0, 1.0, 0.0]])
def test_no_equilibrium_is_reported(load: list[float]) -> None:
    """Pulled beyond mu N, or lifted, the floating bar has no static solution."""
    springs = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.diag([3.0, 2.0]))
    with pytest.raises(NoExactSolution, match=r"nodes \[[01], [01]\] with mu = \[0.5, 0.5\]"):
        solve_increment(make_increment(springs, load, 0.5))


# --- wrong input ---------------------------------------------------------------------------------


def test_invalid_data_is_refused() -> None:
    increment = make_increment(np.eye(4), np.zeros(4), 0.5)
    with pytest.raises(ValueError, match="gap must be finite with shape"):
        replace(increment, gap=np.zeros(3))
    with pytest.raises(ValueError, match="load must be finite"):
        replace(increment, load=np.full(4, np.nan))
    with pytest.raises(ValueError, match="mu must not be negative"):
        replace(increment, mu=np.array([0.5, -0.1]))
