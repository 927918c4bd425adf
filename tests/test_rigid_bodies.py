# SPDX-License-Identifier: MIT
"""Rigid bodies that carry loads: equilibrium, closed forms, frame invariance, errors."""

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.equations import contact_terms
from fenicsx_friction.verification import differences
from models import by_place
from pressed import Half


def ball(d, **options):
    """A ball of radius 1 that touches the block."""
    center = (0.0,) * (d - 1) + (1.0,)

    def bodies(msh):
        body = ff.RigidBody(msh, center=center, **options)
        return [body], [ff.RigidSphere(center, 1.0, motion=body)]

    return bodies


def platen(msh, **options):
    """A flat platen on the block, its center above the middle."""
    d = msh.geometry.dim
    up = (0.0,) * (d - 1)
    body = ff.RigidBody(msh, center=(*up, 0.5), **options)
    return [body], [ff.RigidPlane((*up, 0.0), (*up, -1.0), motion=body)]


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize(("d", "degree", "nodes"), [(2, 1, 1), (2, 2, 1), (2, 2, 2), (3, 1, 1)])
def test_pressing_by_force_equals_pressing_by_displacement(d, degree, nodes):
    """With friction and a drag, by turns: the same states, one given by motions, one by forces."""
    up, along = d - 1, "x"
    given = Half(f"given_{d}{degree}{nodes}_", ball(d), d, degree, nodes=nodes)
    loaded = Half(f"loaded_{d}{degree}{nodes}_", ball(d), d, degree, nodes=nodes)
    for depth, x in ((0.03, 0.0), (0.05, 0.0), (0.05, 0.01), (0.06, 0.03)):
        given.body.given.value[[0, up]] = x, -depth
        loaded.body.given.value[[0, up]] = x, -depth
        there = given.problem.solve()
        if depth == 0.03:  # in contact first
            loaded.problem.solve()
            loaded.body.free = (along, "y" if d == 2 else "z")
            continue
        force = np.array(there.bodies[0].force)
        loaded.body.force.value[:] = -force
        here = loaded.problem.solve()
        assert here.certified
        found = here.bodies[0]
        assert np.allclose(found.force, force, atol=1e-9 * np.linalg.norm(force))
        assert np.allclose(found.translation, there.bodies[0].translation, atol=1e-9)
        assert np.allclose(by_place(loaded.u), by_place(given.u), rtol=0.0, atol=1e-9 * 0.05)


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_an_off_centre_load_tilts_a_platen_until_moments_balance(d):
    names = ("z", "rx", "ry") if d == 3 else ("y", "rz")
    model = Half(f"tilt_{d}_", lambda msh: platen(msh, name="platen"), d, mu=0.2)
    body = model.body
    body.given.value[d - 1] = -1e-3
    model.problem.solve()
    body.free = names
    force = np.zeros(d)
    force[d - 1] = -2.0
    body.force.value[:] = force
    offset = np.array([0.1, -0.05, 0.0])[:d]  # of the load
    body.moment.value[:] = np.cross([*offset, 0.0][:3], [*force, 0.0][:3])[
        [2] if d == 2 else slice(3)
    ]
    report = model.problem.solve().bodies[0]
    assert np.allclose(np.array(report.force)[d - 1], 2.0, rtol=1e-9)
    free = slice(0, 1) if d == 2 else slice(0, 2)
    assert np.allclose(np.array(report.moment)[free], -body.moment.value[free], atol=1e-9 * 0.2)
    assert abs(report.rotation[0]) > 1e-4  # it has tilted
    _, forces = model.contacts[0].pairing.acting()
    total = model.problem.comm.allreduce(forces.sum(axis=0))
    assert total[d - 1] == pytest.approx(-2.0, rel=1e-9)


def test_a_driven_roller_sticks_up_to_mu_and_slips_above():
    """A wheel pressed by P that cannot move along: contact holds moments up to mu P R."""
    mu, P = 0.3, 2.0
    model = Half("driven_", ball(2), mu=mu)
    body = model.body
    body.given.value[1] = -0.02
    model.problem.solve()
    body.free = ("y", "rz")
    body.force.value[:] = (0.0, -P)
    for share in (0.0, 0.5, 0.95):
        M = share * mu * P
        body.moment.value[:] = M
        report = model.problem.solve().bodies[0]
        assert report.force[1] == pytest.approx(P, rel=1e-9)
        assert report.moment[0] == pytest.approx(-M, abs=1e-9)
        # The traction has about the arm of the radius less the depth.
        assert report.force[0] == pytest.approx(-M, rel=0.05, abs=1e-9)
    body.moment.value[:] = 1.05 * mu * P
    with pytest.raises(ff.StepFailed, match="Rigid body 'body' is free in y, rz"):
        model.problem.solve()


def test_a_free_roller_rolls_without_a_force():
    """A wheel that is moved along and may turn: its moment is zero, it rolls."""
    P = 2.0
    model = Half("rolling_", ball(2), mu=0.5, numbers=(64, 16))
    body = model.body
    body.given.value[1] = -0.02
    model.problem.solve()
    body.free = ("y", "rz")
    body.force.value[:] = (0.0, -P)
    for x in np.arange(1, 11) * 0.02:
        body.given.value[0] = x
        report = model.problem.solve().bodies[0]
        assert abs(report.moment[0]) < 1e-9 * P
    assert report.rotation[0] == pytest.approx(-x, rel=0.05)
    assert abs(report.force[0]) < 0.02 * P


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("degree", [1, 2])
def test_jacobian(d, degree):
    names = ("x", "y", "rz") if d == 2 else ("x", "y", "z", "rx", "ry", "rz")
    numbers = (6, 3) if d == 2 else (6, 6, 1)
    model = Half(f"jacobian_{d}{degree}_", ball(d), d, degree, numbers=numbers)
    rotation = [0.3] if d == 2 else [0.1, -0.2, 0.3]
    model.body.given.value[:] = [0.02, *([0.0] * (d - 2)), -0.2, *rotation]
    model.problem.solve()
    model.body.free = names
    for seed in range(2):
        report = ff.check_jacobian(model.problem, seed=seed)
        assert report.error < 1e-6, str(report)


def test_rows_of_bodies_have_names_in_differences():
    model = Half("names_", ball(3, name="ball"), 3, numbers=(2, 2, 1))
    found = [differences._name_of_row(model.problem, 1, i) for i in (0, 5)]
    assert found == ["x of rigid body 'ball'", "rz of rigid body 'ball'"]


def test_a_missing_block_is_seen(monkeypatch):
    original = contact_terms.derivatives_of

    def without(k, kernel):
        blocks = original(k, kernel)
        for block in blocks.body[:1]:
            block[:] = 0.0
        blocks.laws[:, :, -3:] *= 0.9
        return blocks

    monkeypatch.setattr(contact_terms, "derivatives_of", without)
    model = Half("missing_", ball(2), numbers=(6, 3))
    model.body.given.value[1] = -0.1
    assert ff.check_jacobian(model.problem).error > 1e-3


def test_turned_model_gives_the_turned_answer():
    """A platen with a load, a moment and friction, the whole model in another frame."""
    found = []
    for angle in (0.0, 0.7, 2.5):
        c, s = np.cos(angle), np.sin(angle)
        R = np.array([[c, -s], [s, c]])

        def bodies(msh, R=R):
            body = ff.RigidBody(msh, center=tuple(R @ (0.1, 0.4)))
            plane = ff.RigidPlane((0.0, 0.0), tuple(R @ (0.0, -1.0)), motion=body)
            return [body], [plane]

        model = Half("frame_", bodies, place=lambda x, R=R: x @ R.T, mu=0.4)
        body = model.body
        body.given.value[:2] = R @ (0.0, -1e-3)
        model.problem.solve()
        body.free = ("x", "y", "rz")
        body.force.value[:] = R @ (0.2, -2.0)
        body.moment.value[:] = -0.1
        report = model.problem.solve().bodies[0]
        found.append((R.T @ report.translation, report.rotation, R.T @ report.force))
    for other in found[1:]:
        for a, b in zip(found[0], other, strict=True):
            assert np.allclose(a, b, atol=1e-9)


def test_rolling_several_turns_in_three_dimensions():
    """Rotations of steps add up: a ball that is turned about its contact comes back."""
    model = Half("turns_", ball(3), 3, mu=0.0)
    model.body.given.value[2] = -0.02
    first = model.problem.solve()
    for k in range(1, 9):
        angle = 2.0 * np.pi * k / 4.0
        turned = (angle + np.pi) % (2.0 * np.pi) - np.pi
        model.body.given.value[3:] = (0.0, turned, 0.0)
        report = model.problem.solve()
    assert np.allclose(report.bodies[0].rotation, 0.0, atol=1e-12)
    assert np.allclose(report.bodies[0].force, first.bodies[0].force, atol=1e-9)


def test_given_values_of_free_rotations_do_not_count():
    """A ball at rest, turned about two axes, one of them free: nothing changes it."""
    model = Half("stale_", ball(3), 3, mu=0.3, numbers=(4, 4, 2))
    body = model.body
    body.given.value[2] = -0.05
    model.problem.solve()
    for share in (0.5, 1.0):
        body.given.value[3:] = share * np.array([0.5, 0.0, 0.8])
        model.problem.solve()
    body.free = ("rz",)
    for stale in (0.0, 0.8, -2.0):
        body.given.value[5] = stale
        report = model.problem.solve().bodies[0]
        assert np.allclose(report.rotation[:2], (0.5, 0.0), atol=1e-3)
        assert abs(report.rotation[2] - 0.8) < 0.1  # it settles to where no moment acts


def test_springs_hold_a_body_that_touches_nothing():
    """A spring carries what contact does not."""
    model = Half("spring_", ball(2, free=("y",), spring=(0.0, 50.0, 0.0)), mu=0.0)
    model.body.force.value[:] = (0.0, 1.0)  # away
    report = model.problem.solve().bodies[0]
    assert report.translation[1] == pytest.approx(1.0 / 50.0, rel=1e-9)
    assert abs(report.force[1]) < 1e-12
    model.body.force.value[:] = (0.0, -3.0)
    report = model.problem.solve().bodies[0]
    assert report.force[1] + 50.0 * -report.translation[1] == pytest.approx(3.0, rel=1e-9)


def test_one_body_with_two_surfaces():
    """Two balls on one axle share its load; off the middle, one carries more."""

    def axle(msh):
        body = ff.RigidBody(msh, center=(0.0, 0.3))
        centers = ((-0.5, 0.3), (0.5, 0.3))
        return [body], [ff.RigidSphere(c, 0.3, motion=body) for c in centers]

    model = Half("axle_", axle, mu=0.0)
    model.body.given.value[1] = -0.02
    model.problem.solve()
    model.body.free = ("y", "rz")
    model.body.force.value[:] = (0.0, -4.0)
    model.body.moment.value[:] = -0.5  # more on the right
    report = model.problem.solve()
    left, right = (k.force[1] for k in report.contacts)
    assert -(left + right) == pytest.approx(4.0, rel=1e-9)
    assert -right > -left
    assert report.bodies[0].moment[0] == pytest.approx(0.5, rel=1e-8)


def test_a_rejected_step_leaves_the_body_where_it_was():
    model = Half("rejected_", ball(2), mu=0.3)
    model.body.given.value[1] = -0.02
    model.problem.solve()
    model.body.free = ("x", "y")
    before = [a.copy() for a in model.body.save()]
    model.body.force.value[:] = (100.0, -1.0)  # far above what friction holds
    with pytest.raises(ff.StepFailed):
        model.problem.solve()
    for one, other in zip(before, model.body.save(), strict=True):
        assert np.array_equal(one, other)
    model.body.force.value[:] = (0.1, -1.0)
    assert model.problem.solve().certified


@pytest.mark.mpi
def test_restart(tmp_path):
    path = MPI.COMM_WORLD.bcast(tmp_path) / "body.h5"

    def steps(model, first, last):
        for k in range(first, last):
            model.body.force.value[:] = (0.05 * k, 0.0, -1.0 - 0.1 * k)
            report = model.problem.solve()
        return report.bodies[0]

    model = Half("whole_", ball(3), 3)
    model.body.given.value[2] = -0.03
    model.problem.solve()
    model.body.free = ("x", "z")
    steps(model, 1, 3)
    ff.write_checkpoint(path, model.problem)
    expected = steps(model, 3, 5)
    again = Half("again_", ball(3), 3)
    ff.read_checkpoint(path, again.problem)
    assert again.body.free == ("x", "z")
    found = steps(again, 3, 5)
    for name in ("translation", "rotation", "force", "moment"):
        assert np.allclose(getattr(found, name), getattr(expected, name), atol=1e-11)


def test_a_body_that_nothing_holds_is_told():
    model = Half("loose_", ball(2, free=("y",)), mu=0.0)
    model.body.free = ()
    model.body.given.value[1] = 0.1
    model.problem.solve()
    model.body.free = ("y",)
    with pytest.raises(ff.ContactInputError, match=r"touches nothing.*\by\b"):
        model.problem.solve()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"free": ("q",)}, "the components are x, y, rz"),
        ({"spring": (1.0, 2.0)}, "3 finite numbers"),
        ({"spring": (1.0, -2.0, 0.0)}, "must not be negative"),
        ({"center": (0.0, 0.0, 1.0)}, "center"),
        ({"name": ""}, "name of a rigid body"),
    ],
)
def test_wrong_arguments(options, message):
    msh = mesh.create_unit_square(MPI.COMM_SELF, 2, 2)
    with pytest.raises(ff.ContactInputError, match=message):
        ff.RigidBody(msh, **options)


def test_attributes_are_not_replaced():
    msh = mesh.create_unit_square(MPI.COMM_SELF, 2, 2)
    body = ff.RigidBody(msh)
    with pytest.raises(ff.ContactInputError, match=r"force\.value\[:\]"):
        body.force = fem.Constant(msh, (0.0, 1.0))
    with pytest.raises(ff.ContactInputError, match="free = 3"):
        body.free = 3


@pytest.mark.mpi
def test_what_differs_between_ranks_or_is_negative_is_refused():
    model = Half("ranks_", ball(2), numbers=(6, 3))
    model.body.spring.value[1] = -1.0
    with pytest.raises(ff.ContactInputError, match="negative"):
        model.problem.solve()
    model.body.spring.value[1] = 0.0
    last = MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1
    model.body.force.value[0] = np.nan if last else 0.0
    with pytest.raises(ff.ContactInputError, match="not finite"):
        model.problem.solve()
    model.body.force.value[0] = 0.0
    model.body.spring.value[1] = 1.0 + MPI.COMM_WORLD.rank
    if MPI.COMM_WORLD.size > 1:
        with pytest.raises(ff.ContactInputError, match="differ between ranks"):
            model.problem.solve()
