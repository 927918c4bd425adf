"""Multigrid finds what the direct solver finds, for all states, laws, obstacles and bulks."""

import numpy as np
import pytest

import fenicsx_friction as ff
from bodies import stack
from models import block

pytestmark = pytest.mark.mpi
PATH = [(0.0, 0.0, -0.01), (0.004, 0.002, -0.01), (0.02, 0.005, -0.008), (0.0, 0.0, -0.006)]


def follow(make, path=PATH):
    """Return reports and unknowns of all steps."""
    model, found = make, []
    for place in path:
        model.move(*place)
        report = model.problem.solve()
        assert report.certified
        found.append((report, [f.x.array.copy() for f in model.problem.state]))
    return found


def assert_same(direct, multigrid):
    """Compare the states of all steps, and see that multigrid was at work."""
    for (exact, states), (report, others) in zip(direct, multigrid, strict=True):
        assert report.linear_solver == "multigrid" and report.solver == "full"
        assert exact.linear_solver == "direct"
        if report.iterations:
            assert report.krylov >= report.iterations
        for a, b in zip(states, others, strict=True):
            assert np.max(abs(a - b), initial=0.0) <= 1e-9 * max(np.max(abs(a), initial=0.0), 1e-300)


@pytest.mark.parametrize("energy", ["small", "finite"])
@pytest.mark.parametrize("mu", [0.0, 0.3, 1.0, 5.0])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_block_on_a_plane(cell, mu, energy):
    def made(linear):
        name = f"mg_{linear}_{cell}_{mu}_{energy}_"
        return block(cell, mu, name, n=(6, 5, 4), energy=energy, linear_solver=linear, solver="full")

    assert_same(follow(made("direct")), follow(made("multigrid")))
