"""Friction so weak that it is like errors holds nothing; what it alone carries may not fly."""

import numpy as np
import pytest
import ufl

import fenicsx_friction as ff
from fenicsx_friction.increment.adrift import bodies_adrift
from pressed import Half
from test_floating import Block, middle
from test_rigid_bodies import ball, platen

FAINT = (1e-12, 1e-10, 1e-9, 1e-8, 1e-7)


@pytest.mark.mpi
@pytest.mark.parametrize("energy", ["small", "finite"])
@pytest.mark.parametrize("mu", FAINT)
def test_a_block_that_is_pressed_unevenly_is_where_it_was_or_refused(mu, energy):
    """There is no tangential load, but friction all one way was less than errors may be."""
    block = Block(f"faint_{mu}{energy}_".replace(".", ""), mu=mu, energy=energy)
    block.lean.value = 0.5
    for load in (1.0, 0.5, 2.0):
        block.load.value[1], before = -load, middle(block.u)
        try:
            assert block.problem.solve().certified
        except ff.StepFailed:
            assert np.array_equal(middle(block.u), before)
        assert np.all(abs(middle(block.u) - before) < 0.5)


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(("mu", "holds"), [(1e-10, False), (1e-6, True), (0.3, True)])
def test_friction_holds_a_block_as_far_as_it_is_more_than_errors(mu, holds, d):
    block = Block(f"holds_{d}{mu}_".replace(".", ""), d)  # the same state solves with friction
    assert block.problem.solve().certified
    rough = Block(f"rough_{d}{mu}_".replace(".", ""), d, mu=mu)
    for f, g in zip(rough.problem.state, block.problem.state, strict=True):
        f.x.array[:] = g.x.array
    rough.problem.scales.begin()
    assert (rough.drifted(x=5.0) == []) == holds
    # Errors grow with a flight, by the rounding of stiffness times displacement.
    rough.u.x.array[::d] += 1e6
    assert (rough.drifted(x=5.0) == []) == (mu == 0.3)


def strong_at_a_corner(x, strong=0.3):
    return ufl.conditional(ufl.gt(x[0] + x[1], 0.9), strong, 1e-10)


WEAK_IN_PART = {
    # Across its axis, this friction holds by less than errors.
    "orthotropic": (
        lambda: ff.OrthotropicCoulomb((0.3, 1e-10), (1, 1, 0)),
        {"x": 5.0, "y": -5.0},
        {"x": 5.0, "y": 5.0},
    ),
    # One node holds no turn about itself.
    "pivot": (
        lambda: ff.Coulomb(lambda p, sliding: strong_at_a_corner(sliding.x)),
        {"rz": 5.0, "x": 2.5, "y": -2.5},
        {"rz": 5.0},
    ),
    "glued pivot": (
        lambda: ff.Coulomb(lambda p, sliding: strong_at_a_corner(sliding.x, 1e15)),
        {"rz": 5.0, "x": 2.5, "y": -2.5},
        {"rz": 5.0},
    ),
}


@pytest.mark.mpi
@pytest.mark.parametrize("law", WEAK_IN_PART)
def test_friction_that_is_faint_in_part_holds_nothing_there(law):
    friction, free, held = WEAK_IN_PART[law]
    block = Block(f"in_part_{law}_".replace(" ", "_"), 3)
    assert block.problem.solve().certified
    rough = Block(f"rough_in_part_{law}_".replace(" ", "_"), 3, law=friction())
    for f, g in zip(rough.problem.state, block.problem.state, strict=True):
        f.x.array[:] = g.x.array
    rough.problem.scales.begin()
    assert rough.drifted(**free)
    assert not rough.drifted(**held)


@pytest.mark.mpi
@pytest.mark.parametrize("shape", [ball, platen])
@pytest.mark.parametrize(("mu", "holds"), [(1e-10, False), (1e-6, True)])
def test_friction_holds_a_rigid_body_as_far_as_it_is_more_than_errors(mu, holds, shape):
    bodies = shape(2) if shape is ball else shape
    model = Half(f"faint_{shape.__name__}{mu}_".replace(".", ""), bodies, mu=mu)
    body, way = model.body, {ball: ("rz", 2), platen: ("x", 0)}[shape]
    body.given.value[1] = -0.02
    model.problem.solve()
    body.free, start = (way[0],), [f.x.array.copy() for f in model.problem.unknowns]
    start[-1][way[1]] -= 5.0
    assert (bodies_adrift(model.problem, start) == []) == holds


@pytest.mark.mpi
@pytest.mark.parametrize("energy", ["small", "finite"])
def test_who_deforms_much_may_not_fly_either(energy):
    """By ten times what it deforms it would go: half the mesh is enough."""
    block = Block(f"deforms_{energy}_", energy=energy)
    assert block.problem.solve().certified
    x = block.u.function_space.tabulate_dof_coordinates()[:, :2]
    for stretch, way, lines in ((0.0, 0.4, 1), (0.2, 0.4, 0), (0.2, 0.6, 1), (3.0, 1.0, 0)):
        start = [f.x.array.copy() for f in block.problem.unknowns]
        start[0].reshape(-1, 2)[:, 1] -= stretch * x[:, 1]
        start[0].reshape(-1, 2)[:, 0] -= way
        assert len(bodies_adrift(block.problem, start)) == lines


@pytest.mark.mpi
@pytest.mark.parametrize("far", [0.0, 10.0, 100.0])
def test_a_platen_that_has_slid_far_carries_small_forces(far):
    """What rounding leaves of its slips is no violation; the resolution tells of it."""
    model = Half(f"slid_{far}_".replace(".", ""), platen, 3, mu=1.0)
    body, rng = model.body, np.random.default_rng(1)
    body.given.value[2] = -1e-6
    assert model.problem.solve().certified
    body.given.value[0] = far
    pressed = model.problem.solve().bodies[0].force[2]
    body.free = ("x", "y", "z")
    body.force.value[2] = -pressed
    for _ in range(4):
        body.force.value[:2] = 0.2 * pressed * rng.uniform(-1.0, 1.0, 2)
        report = model.problem.solve()
        assert report.certified
        assert report.bodies[0].force == pytest.approx(-body.force.value, abs=1e-6 * pressed)
        assert report.certificate.resolution < 1e-6
