"""Rigid bodies that carry loads: all solvers, the same answers."""

import numpy as np
import pytest

import fenicsx_friction as ff
from models import by_place
from pressed import Half
from test_rigid_bodies import ball, platen


def dragged_on(name, bodies, d, free, **options):
    """Press with given values, then by forces: states, positions, the solvers at work."""
    model, found, solvers = Half(name, bodies, d, **options), [], set()
    model.body.given.value[d - 1] = -0.03
    force = -np.array(model.problem.solve().bodies[0].force)
    model.body.free = free
    for pressed, pushed in ((1.0, 0.0), (1.3, 0.1), (1.3, -0.05)):
        model.body.force.value[:] = pressed * force
        model.body.force.value[0] = pushed * force[d - 1]
        report = model.problem.solve()
        assert report.certified
        solvers |= {(report.solver, report.linear_solver)}
        body = report.bodies[0]
        found += [by_place(model.u).ravel(), np.array([*body.translation, *body.rotation])]
    return found, solvers


@pytest.mark.mpi
@pytest.mark.parametrize("energy", ["small", "finite"])
@pytest.mark.parametrize(
    ("obstacle", "d", "degree", "free"),
    [
        (ball, 2, 1, ("x", "y")),
        (ball, 2, 2, ("x", "y")),
        (platen, 2, 1, ("x", "y", "rz")),
        (ball, 3, 1, ("x", "z")),
        (platen, 3, 1, ("x", "z", "rx", "ry")),
    ],
)
def test_all_solvers_have_the_same_answer(obstacle, d, degree, free, energy):
    """The whole system factored, by multigrid, and condensed on the contact and the body."""
    ways = {"direct": ("full", "direct"), "condensed": ("condensed", "direct")}
    if d == 3:
        ways["multigrid"] = ("full", "multigrid")
    found = {}
    for name, (solver, linear) in ways.items():
        options = {"settings": ff.StepSettings(solver=solver), "linear_solver": linear}
        options |= {"degree": degree, "energy": energy, "mu": 0.4}
        bodies = platen if obstacle is platen else ball(d)
        found[name], used = dragged_on(f"{name}_{d}{degree}{energy}_", bodies, d, free, **options)
        assert used == {(solver, linear)}
    for values in found.values():
        for a, b in zip(values, found["direct"], strict=True):
            assert np.max(abs(a - b), initial=0.0) < 1e-9 * np.max(abs(b), initial=1e-3)


@pytest.mark.mpi
@pytest.mark.parametrize("solver", ["full", "condensed"])
def test_a_body_that_carries_nothing_costs_nothing(solver):
    """Above the block, on its spring alone, unloaded in the end; then moved by given values."""
    settings = ff.StepSettings(solver=solver)
    model = Half(f"alone_{solver}_", ball(2, spring=(37.3, 0.0, 0.0)), settings=settings)
    model.body.given.value[1] = 0.5
    model.problem.solve()
    model.body.free = ("x",)
    for load in (17.0, 19.0, 19.0 + 1e-8, 0.1, 0.0, 13.0):
        model.body.force.value[0] = load
        report = model.problem.solve()
        assert report.certified and report.solver == solver and report.iterations <= 2
        place = report.bodies[0].translation
        assert place == pytest.approx((load / 37.3, 0.5), rel=1e-12, abs=1e-14)
    model.body.free = ()
    for height in (0.01, 0.03, 0.5):
        model.body.given.value[1] = height
        report = model.problem.solve()
        assert report.certified and report.solver == solver
        assert report.bodies[0].translation[1] == pytest.approx(height, rel=1e-14)
