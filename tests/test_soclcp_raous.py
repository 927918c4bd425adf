# SPDX-License-Identifier: MIT
"""The exact reference on the Raous rectangle (code_aster SSNV128)."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from fenicsx_friction.verification.soclcp import Increment, solve_increment
from increments import Array, dissipation, make_increment

DATA = Path(__file__).parent / "data"


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
