# SPDX-License-Identifier: MIT
"""The exact reference: closed forms, all states enumerated, invariances, the Raous rectangle."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from fenicsx_friction.verification.cone import project
from fenicsx_friction.verification.soclcp import (
    ExactSolution,
    Increment,
    NoExactSolution,
    natural_residual,
    solve_increment,
)

Array = npt.NDArray[np.float64]
DATA = Path(__file__).parent / "data"


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


# --- one node, springs k = 2 N/m ---------------------------------------------------------------


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


# --- many nodes ----------------------------------------------------------------------------------


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


def test_invalid_data_is_refused() -> None:
    increment = make_increment(np.eye(4), np.zeros(4), 0.5)
    with pytest.raises(ValueError, match="gap must be finite with shape"):
        replace(increment, gap=np.zeros(3))
    with pytest.raises(ValueError, match="load must be finite"):
        replace(increment, load=np.full(4, np.nan))
    with pytest.raises(ValueError, match="mu must not be negative"):
        replace(increment, mu=np.array([0.5, -0.1]))


# --- Raous rectangle (code_aster SSNV128) --------------------------------------------------------


def q4_stiffness(hx: float, hy: float, bbar: bool, young: float = 130e9, nu: float = 0.2) -> Array:
    """Plane-strain Q4 with 2 x 2 Gauss points, strain (xx, yy, zz, xy); B-bar: mean dilatation."""
    lame, shear = young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))
    law = np.diag([2 * shear] * 3 + [shear])
    law[:3, :3] += lame
    sx, sy = np.array([-1, 1, 1, -1]), np.array([-1, -1, 1, 1])
    stiffness = np.zeros((8, 8))
    for x, y in product([-(3**-0.5), 3**-0.5], repeat=2):
        dx, dy = sx * (1 + sy * y) / (2 * hx), sy * (1 + sx * x) / (2 * hy)
        b = np.zeros((4, 8))
        b[0, ::2] = b[3, 1::2] = dx
        b[1, 1::2] = b[3, ::2] = dy
        b[3] = np.column_stack([dy, dx]).ravel()
        if bbar:
            mean = np.column_stack([sx / (2 * hx), sy / (2 * hy)]).ravel()
            b[:3] += (mean - np.column_stack([dx, dy]).ravel()) / 3
        stiffness += b.T @ law @ b * hx * hy / 4
    return stiffness


def raous(nx: int, ny: int, mu: float = 1.0, bbar: bool = False, factor: float = 1.0) -> Increment:
    """Condense the 40 mm x 40 mm half model on y = 0; the corner (40, 0) is held in x."""
    hx, hy, nodes = 0.04 / nx, 0.04 / ny, (nx + 1) * (ny + 1)
    corner = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)).ravel()
    cells = corner[:, None] + np.array([0, 1, nx + 2, nx + 1])
    dofs = (2 * cells[:, :, None] + np.arange(2)).reshape(-1, 8)
    entries = np.tile(q4_stiffness(hx, hy, bbar).ravel(), len(cells))
    rows, columns = np.repeat(dofs, 8, axis=1).ravel(), np.tile(dofs, 8).ravel()
    k = sp.coo_matrix((entries, (rows, columns)), shape=(2 * nodes, 2 * nodes)).tocsr()
    left, top = np.arange(ny + 1) * (nx + 1), ny * (nx + 1) + np.arange(nx + 1)
    load = np.zeros(2 * nodes)
    load[2 * left] = 150e6 * hy * factor
    load[2 * top + 1] = -50e6 * hx * factor
    load[2 * left[[0, -1]]] /= 2
    load[2 * top[[0, -1]] + 1] /= 2

    contact = np.arange(2 * nx + 2).reshape(-1, 2)[:, ::-1].ravel()  # normal is y
    kept = contact != 2 * nx
    boundary = contact[kept]
    inner = np.setdiff1d(np.arange(2 * nodes), np.concatenate([contact, 2 * (left + nx)]))
    coupling = k[inner][:, boundary].toarray()
    lifted = spla.splu(k[inner][:, inner].tocsc()).solve(np.column_stack([coupling, load[inner]]))
    schur = k[boundary][:, boundary].toarray() - coupling.T @ lifted[:, :-1]
    stiffness, condensed = np.eye(2 * nx + 2), np.zeros(2 * nx + 2)
    stiffness[np.ix_(kept, kept)] = (schur + schur.T) / 2
    condensed[kept] = load[boundary] - coupling.T @ lifted[:, -1]
    return replace(make_increment(stiffness, condensed, mu), free=kept.reshape(-1, 2))


POINTS = [0, 1, 4, 6, 9]  # A to E on 32 elements of 1.25 mm


U_X = {  # 1e-5 m at A to E; the first are also the values of code_aster SSNV128q
    "q4": [2.84594384, 2.70792364, 2.27402555, 1.97270669, 1.53641594],
    "bbar": [2.8577766681, 2.7199019760, 2.2835357837, 1.9788084575, 1.5400400510],
}


@pytest.mark.parametrize(("ny", "element"), [(10, "q4"), (16, "bbar")])
def test_raous_rectangle(ny: int, element: str) -> None:
    """All digits of the reference values and of the table that other solvers gave."""
    solution = solve_increment(raous(32, ny, bbar=element == "bbar"))
    np.testing.assert_allclose(
        solution.displacement[POINTS, 1], 1e-5 * np.array(U_X[element]), rtol=1e-8
    )
    _, c_n, c_t, u_x_mm, u_y_mm = np.loadtxt(
        DATA / f"raous_32x{ny}_{element}.csv", delimiter=",", skiprows=2
    ).T
    area = np.r_[0.5, np.ones(31)] * 0.04 / 32
    force, displacement = solution.force[:-1], solution.displacement[:-1]
    np.testing.assert_allclose(force[:, 0] / area / 1e6, c_n, atol=2e-5)
    np.testing.assert_allclose(-force[:, 1] / area / 1e6, c_t, atol=2e-5)
    np.testing.assert_allclose(1e3 * displacement[:, 1], u_x_mm, atol=1e-9)
    np.testing.assert_allclose(1e3 * displacement[:, 0], u_y_mm, atol=1e-9)
    assert solution.force[:, 0].sum() == pytest.approx(2.0e6, rel=1e-9)
    if element == "q4":
        assert solution.force[31, 0] == pytest.approx(1.04863768e5, rel=1e-8)  # R of SSNV128q


@pytest.mark.parametrize("mu", [0.0, 0.2, 0.5, 2.0, 5.0, 20.0])
def test_raous_friction_coefficients(mu: float) -> None:
    """More friction, less displacement at A; all forces physical, in one step from zero."""
    solution = solve_increment(raous(32, 10, mu))
    less = solve_increment(raous(32, 10, 0.9 * mu + 0.1 * (mu == 0)))
    assert (solution.displacement[0, 1] < less.displacement[0, 1]) == (mu > 0)
    assert (dissipation(solution) >= -1e-9).all()
    assert solution.force[:, 0].sum() == pytest.approx(2.0e6, rel=1e-9)


def test_raous_load_unload_reload() -> None:
    """Friction locks deformation in; the exact path dissipates in every step and is certified."""
    previous: Array = np.zeros((33, 1))
    history = []
    for factor in (0.5, 1.0, 0.6, 0.2, 0.0, 0.5, 1.0):
        increment = replace(raous(32, 10, mu=0.5, factor=factor), previous=previous)
        solution = solve_increment(increment)
        assert solution.residual <= 1e-10
        assert dissipation(solution).sum() > -1e-9
        previous = solution.displacement[:, 1:]
        history.append(solution.displacement[0, 1])
    assert history[1] == pytest.approx(2 * history[0], rel=1e-9)  # proportional first loading
    assert history[3] > 0.25 * history[1]  # slips back less than it came
    assert history[6] == pytest.approx(history[1], rel=0.02)
