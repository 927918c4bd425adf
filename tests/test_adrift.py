# SPDX-License-Identifier: MIT
"""Rigid bodies where nothing holds them: they stay, or the step is refused."""

import numpy as np
import pytest

import fenicsx_friction as ff
from fenicsx_friction.increment.adrift import bodies_adrift
from pressed import Half
from test_rigid_bodies import ball, platen


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("lift", [0.02, 0.1])
def test_a_wheel_that_is_lifted_does_not_turn_far(lift):
    """Nothing says how far it has turned, once by 1e13: about as far as the block deforms, or not.

    Held, it leaves.
    """
    model = Half(f"lifted_{lift}_".replace(".", ""), ball(2), mu=0.4)
    body = model.body
    body.given.value[1] = -0.05
    model.problem.solve()
    body.free = ("rz",)
    for x in (0.05, 0.1):
        body.given.value[0] = x
        model.problem.solve()
    kept = [f.x.array.copy() for f in (model.u, body.q, model.contacts[0].c)]
    body.given.value[1] = lift
    try:
        report = model.problem.solve()
    except ff.StepFailed as failure:
        assert "moved in rz by" in str(failure)
        for f, values in zip((model.u, body.q, model.contacts[0].c), kept, strict=True):
            assert np.array_equal(f.x.array, values)
    else:
        assert report.contacts[0].stick == report.contacts[0].slip == 0
        assert abs(body.q.x.array[2] - kept[1][2]) < 0.3
    body.free, body.given.value[2] = (), body.q.x.array[2]
    report = model.problem.solve()
    assert report.certified
    assert report.contacts[0].stick == report.contacts[0].slip == 0


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    ("shape", "mu", "loose"), [(ball, 0, True), (ball, 0.4, False), (platen, 0, False)]
)
def test_what_holds_a_rotation(d, shape, mu, loose):
    """Friction holds that of a ball, pressure that of a platen; without friction a ball is free."""
    bodies = shape(d) if shape is ball else shape
    model = Half(f"turns_{d}{shape.__name__}{mu}_".replace(".", ""), bodies, d, mu=mu)
    body, up, turns = model.body, *(("y", ["rz"]) if d == 2 else ("z", ["rx", "ry"]))
    body.given.value[d - 1] = -0.02
    model.problem.solve()
    body.free = (up, *turns)
    body.force.value[d - 1] = -2.0
    report = model.problem.solve()
    assert report.bodies[0].force[d - 1] == pytest.approx(2.0, rel=1e-9)
    assert np.allclose(report.bodies[0].rotation, 0.0, atol=1e-9)  # what nothing holds has stayed
    start = [f.x.array.copy() for f in model.problem.unknowns]
    assert bodies_adrift(model.problem, start) == []
    start[-1][d : d + len(turns)] -= 0.1
    start[-1][d - 1] += 0.1  # pressure holds this
    found = bodies_adrift(model.problem, start)
    assert len(found) == loose
    assert all(f"{name} by 0.1" in line for line in found for name in turns)
    assert not any(f"{up} by" in line for line in found)


def test_pressure_holds_a_platen_whose_center_is_far_away():
    """A turn moves all points alike then, but not quite."""

    def far(msh):
        body = ff.RigidBody(msh, center=(1e5, 0.5))
        return [body], [ff.RigidPlane((0.0, 0.0), (0.0, -1.0), motion=body)]

    model = Half("far_", far, mu=0.3)
    body = model.body
    body.given.value[1] = -0.02
    model.problem.solve()
    body.free, start = ("y", "rz"), [f.x.array.copy() for f in model.problem.unknowns]
    body.q.x.array[1:] += (-7.69, -7.69e-5)
    assert bodies_adrift(model.problem, start) == []
