"""Bodies on obstacles that move, turn or are given by their gap; objectivity."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import mesh
from scipy.spatial.transform import Rotation

import fenicsx_friction as ff
from fenicsx_friction.verification.jacobian import check_jacobian
from rectangles import AXIS, PATH, SQUARE, body, on_floor, tractions, turned


@pytest.mark.quick
@pytest.mark.mpi
def test_dragging_the_body_equals_moving_the_plane_the_other_way():
    motions = []

    def moving(msh, surfaces):
        motions.append(ff.RigidMotion(msh))
        plane = ff.RigidPlane((0.0, 0.0), (0.0, 1.0), motion=motions[0])
        return [ff.Contact(surfaces[1], plane, ff.Coulomb(0.4))]

    dragged, still = body(on_floor(0.4), "drag_", **SQUARE), body(moving, "still_", **SQUARE)
    for x, y in PATH:
        dragged.place(np.eye(2), (x, y))
        motions[0].translation.value = (-x, -y)
        reports = [model.problem.solve() for model in (dragged, still)]
        assert all(report.certified for report in reports)
        expected = tractions(dragged)
        assert tractions(still) == pytest.approx(expected, abs=1e-9 * np.max(abs(expected)))
        assert reports[0].contacts[0].slip == reports[1].contacts[0].slip
    assert check_jacobian(still.problem).error < 1e-6


WHEEL = {"low": (-0.3, 1.0), "high": (0.3, 1.3), "n": [6, 3]}


def moment(model):
    """Return the moment of the contact forces about the origin, and the normal force."""
    problem, contact = model.problem, model.contact
    nodal, t = contact.nodal(), contact.nodal_traction()
    x = contact.pairing.positions()
    turning = nodal.area @ (x[:, 0] * t[:, 1] - x[:, 1] * t[:, 0])
    return problem.comm.allreduce(np.array([turning, nodal.area @ nodal.c[:, 0]]))


@pytest.mark.mpi
def test_a_turning_wheel_drags_the_body_with_the_moment_mu_N_R():
    made = []

    def wheel(msh, surfaces):
        motion = ff.RigidMotion(msh)
        made.append(motion)
        circle = ff.RigidSphere((0.0, 0.0), 1.0, motion=motion)
        return [ff.Contact(surfaces[1], circle, ff.Coulomb(0.25))]

    model = body(wheel, "wheel_", **WHEEL)
    model.place(np.eye(2), (0.0, -0.03))
    model.problem.solve()
    assert moment(model)[0] == pytest.approx(0.0, abs=1e-10)
    for angle in (0.002, 0.2, 0.5):  # stick inside, then slip everywhere, then more
        made[0].angle.value = angle
        report = model.problem.solve()
        assert report.certified
        if angle == 0.002:
            assert report.contacts[0].stick > 0
    totals, (turning, normal) = report.contacts[0], moment(model)
    assert totals.stick == 0
    assert totals.slip >= 3
    assert turning == pytest.approx(0.25 * normal, rel=1e-9)  # R = 1, with the rotation
    # All the slip is the wheel's: its path is the angle, from where it slips everywhere.
    nodal = model.contact.nodal()
    closed = nodal.c[:, 0] > 0.0
    assert np.all(np.abs(nodal.slip[closed]) < 0.31)
    # Turned back, the friction turns round.
    made[0].angle.value = 0.0
    model.problem.solve()
    turning, normal = moment(model)
    assert turning == pytest.approx(-0.25 * normal, rel=1e-9)
    assert check_jacobian(model.problem).error < 1e-6


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore:overflow encountered in divide")  # certificate: 1e300 / length
@pytest.mark.parametrize("law", [ff.PermanentStick(), ff.Coulomb(0.3)], ids=["stick", "Coulomb"])
def test_a_body_that_sticks_in_a_turning_socket_goes_with_it(law):
    """Held by contact alone, by press fit: the start overlaps, and the first step closes it."""
    made = []

    def socket(msh, surfaces):
        made.append(ff.RigidMotion(msh))
        wall = ff.RigidSphere((0.0, 0.0), 0.69, inside=True, motion=made[0])
        msh.topology.create_connectivity(1, 2)
        facets = np.sort(mesh.exterior_facet_indices(msh.topology))
        tags = mesh.meshtags(msh, 1, facets, np.full(len(facets), 1, dtype=np.int32))
        return [ff.Contact(ff.ContactSurface(msh, tags, 1), wall, law)]

    square = {"low": (-0.5, -0.5), "high": (0.5, 0.5), "n": [4, 4]}
    model = body(socket, "socket_", traction=(0.0, 0.0), **square)
    report = model.problem.solve()
    assert report.contacts[0].stick == 4  # the corners
    fitted = model.x + model.u.x.array.reshape(-1, 2)
    before = tractions(model)
    for angle in (0.2, 0.4, 0.6, 1.0):
        made[0].angle.value = angle
        report = model.problem.solve()
        assert report.certified
        R = turned(angle, 2)
        now = model.x + model.u.x.array.reshape(-1, 2)
        assert now == pytest.approx(fitted @ R.T, abs=1e-10)
        assert np.max(abs(model.contact.path.x.array), initial=0.0) < 1e-11
        expected = before @ R.T
        assert tractions(model) == pytest.approx(expected, abs=1e-9 * np.max(abs(before)))


@pytest.mark.mpi
def test_body_and_plane_turned_together_keep_tractions_and_do_not_slip():
    """3D, neo-Hooke, 1.5 rad about a skew axis in five steps, after slip and stick."""
    made = []

    def turning(msh, surfaces):
        made.append(ff.RigidMotion(msh, axis=AXIS))
        plane = ff.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), motion=made[0])
        return [ff.Contact(surfaces[1], plane, ff.Coulomb(0.3))]

    model = body(turning, "turn_", low=(0, 0, 0), high=(1.0, 0.8, 0.4), n=[3, 2, 1])
    pressed = np.array([0.011, 0.005, -0.02])
    for displacement in ((0.0, 0.0, -0.02), pressed):
        model.place(np.eye(3), displacement)
        report = model.problem.solve()
    assert report.contacts[0].stick > 0
    assert report.contacts[0].slip > 0
    before, path = tractions(model), model.contact.path.x.array.copy()
    rest = model.x + model.u.x.array.reshape(-1, 3)
    for angle in (0.2, 0.5, 0.9, 1.2, 1.5):
        R = turned(angle, 3)
        made[0].angle.value = angle
        model.place(R, R @ pressed)
        report = model.problem.solve()
        assert report.certified
        assert tractions(model) == pytest.approx(before @ R.T, abs=1e-9 * np.max(abs(before)))
        assert model.contact.path.x.array == pytest.approx(path, abs=1e-10)
        now = model.x + model.u.x.array.reshape(-1, 3)
        assert now == pytest.approx(rest @ R.T, abs=1e-10)
    assert check_jacobian(model.problem).error < 1e-6


@pytest.mark.mpi
def test_an_implicit_obstacle_equals_the_plane_and_the_circle():
    """The gradient need not have the length one."""
    scale = 2.5
    pairs = [
        (
            SQUARE,
            ff.RigidPlane((0.0, 0.0), (0.0, 1.0)),
            lambda X: scale * X[1],
            [(0.0, -0.02), (0.1, -0.02)],
        ),
        (
            WHEEL,
            ff.RigidSphere((0.0, 0.0), 1.0),
            lambda X: scale * (ufl.sqrt(ufl.dot(X, X)) - 1.0),
            [(0.0, -0.03), (0.1, -0.03)],
        ),
    ]
    for shape, rigid, distance, path in pairs:
        results = []
        for obstacle in (rigid, ff.ImplicitObstacle(distance)):
            model = body(
                lambda msh, s, obstacle=obstacle: [ff.Contact(s[1], obstacle, ff.Coulomb(0.3))],
                "implicit_",
                **shape,
            )
            for displacement in path:
                model.place(np.eye(2), displacement)
                model.problem.solve()
            results.append(tractions(model))
        size = np.max(abs(results[0]))
        assert results[1] == pytest.approx(results[0], abs=1e-9 * size)
        assert check_jacobian(model.problem).error < 1e-6


ROUND = {
    "cylinder": lambda turn: ff.RigidCylinder((0, 0, 0), turn @ np.array([0.0, 1.0, 0.0]), 1.0),
    "sphere": lambda turn: ff.RigidSphere((0, 0, 0), 1.0),
}


@pytest.mark.parametrize("name", ["cylinder", pytest.param("sphere", marks=pytest.mark.mpi)])
def test_sliding_far_round_an_obstacle_with_frames_chosen_anew(name):
    """By 150 degrees; the same as with turned coordinates, where other axes make the frames."""
    skew = Rotation.from_euler("xyz", [40.0, -25.0, 60.0], degrees=True).as_matrix()
    shape = {"low": (-0.2, -0.15, 1.0), "high": (0.2, 0.15, 1.2), "n": [2, 2, 1]}
    results, hints = [], []
    for turn in (np.eye(3), skew):
        model = body(
            lambda msh, s, turn=turn: [ff.Contact(s[1], ROUND[name](turn), ff.Coulomb(0.2))],
            "far_",
            turn=turn,
            **shape,
        )
        first = model.contact.hint.x.array.copy()
        history = []
        for angle in np.radians(range(0, 151, 10)):
            R = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
            down = R @ np.array([0.0, 0.0, -0.03])
            model.place(turn @ R @ turn.T, turn @ down)
            report = model.problem.solve()
            assert report.certified
            history.append(np.array([*report.contacts[0].force]) @ turn)
        results.append(np.array(history))
        changed = bool(np.any(model.contact.hint.x.array != first))
        hints.append(model.problem.comm.allreduce(changed, MPI.LOR))
    assert any(hints)
    size = np.max(abs(results[0]))
    assert results[1] == pytest.approx(results[0], abs=1e-8 * size)
    # Round the axis the last steps repeat the same picture, turned.
    R = Rotation.from_rotvec([0.0, np.radians(10.0), 0.0]).as_matrix()
    assert results[0][-1] == pytest.approx(R @ results[0][-2], abs=1e-3 * size)
    report = check_jacobian(model.problem)
    assert report.error < 1e-6, str(report)
