"""Obstacles: gaps and frames in closed form, moving obstacles, objectivity, several contacts."""

import math
from dataclasses import replace
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from scipy.spatial.transform import Rotation

import fenicsx_friction as ff
from fenicsx_friction.jacobian import check_jacobian
from fenicsx_friction.obstacles import kinematics
from models import tagged_facets

# -- gap, frame and slip at one point, without bodies ----------------------------------------


def numbers(vector):
    return ufl.as_vector([ufl.as_ufl(float(v)) for v in vector])


def values(msh, expression):
    """Evaluate a UFL vector of Constants."""
    point = np.zeros((1, msh.topology.dim))
    compiled = fem.Expression(expression, point, comm=MPI.COMM_SELF)
    return compiled.eval(msh, np.array([0], dtype=np.int32)).reshape(-1)


AXIS = np.array([1.0, 2.0, 2.0]) / 3.0


def off_axis(x):
    return x - np.dot(x, AXIS) * AXIS


def tilted(x):
    return np.dot(x - np.array([0.1, 0.2, 0.3]), AXIS)


#: Obstacle, gap and normal of a point.
SHAPES = {
    "line": (
        ff.RigidPlane((1.0, 0.5), (3.0, 4.0)),
        lambda x: 0.6 * (x[0] - 1.0) + 0.8 * (x[1] - 0.5),
        lambda x: np.array([0.6, 0.8]),
    ),
    "plane": (ff.RigidPlane((0.1, 0.2, 0.3), (2.0, 4.0, 4.0)), tilted, lambda x: AXIS),
    "circle": (
        ff.RigidSphere((0.0, 0.0), 0.5),
        lambda x: np.linalg.norm(x) - 0.5,
        lambda x: x / np.linalg.norm(x),
    ),
    "socket": (
        ff.RigidSphere((0.0, 0.0, 0.0), 3.0, inside=True),
        lambda x: 3.0 - np.linalg.norm(x),
        lambda x: -x / np.linalg.norm(x),
    ),
    "cylinder": (
        ff.RigidCylinder((2.0, 4.0, 4.0), 5.0 * AXIS, 0.4),
        lambda x: np.linalg.norm(off_axis(x)) - 0.4,
        lambda x: off_axis(x) / np.linalg.norm(off_axis(x)),
    ),
    "bearing": (
        ff.RigidCylinder((0.0, 0.0, 0.0), AXIS, 2.0, inside=True),
        lambda x: 2.0 - np.linalg.norm(off_axis(x)),
        lambda x: -off_axis(x) / np.linalg.norm(off_axis(x)),
    ),
    "paraboloid": (
        ff.ImplicitObstacle(lambda X: X[2] - X[0] ** 2 - 2.0 * X[1] ** 2),
        lambda x: x[2] - x[0] ** 2 - 2.0 * x[1] ** 2,
        lambda x: (n := np.array([-2 * x[0], -4 * x[1], 1.0])) / np.linalg.norm(n),
    ),
}


def turned(angle, d):
    """Return the rotation matrix of a motion about ``AXIS`` (3D) or z (2D)."""
    if d == 2:
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[c, -s], [s, c]])
    return Rotation.from_rotvec(angle * AXIS).as_matrix()


@pytest.mark.parametrize("name", SHAPES)
def test_gap_frame_and_slip_in_closed_form(name):
    """Of an obstacle that has been moved, and moves in the step."""
    shape, gap, normal = SHAPES[name]
    d = 2 if name in ("line", "circle") else 3
    create = mesh.create_rectangle if d == 2 else mesh.create_box
    msh = create(MPI.COMM_SELF, [[0] * d, [1] * d], [1] * d)
    center, shift = np.array([0.3, -0.1, 0.2])[:d], np.array([0.05, 0.02, -0.04])[:d]
    motion = ff.RigidMotion(msh, center=center, axis=2.0 * AXIS)
    obstacle = replace(shape, motion=motion)
    x, x_old, hint = (fem.Constant(msh, np.zeros(d)) for _ in range(3))
    hint.value[0] = 1.0
    kin, c = kinematics(obstacle, x, x_old, hint), np.array([3.0, -1.0, 2.0])[:d]
    parts = [[kin.gap], kin.normal, *kin.tangents, kin.slip, kin.traction(numbers(c))]
    found = ufl.as_vector([entry for part in parts for entry in part])
    sizes = np.cumsum([1, *[d] * d, d - 1])
    for old, now in ((0.0, 0.0), (0.25, 0.6), (2.0, -0.7)):
        motion.angle.value, motion.translation.value = old, 0.1 * shift
        motion.commit()
        motion.angle.value, motion.translation.value = now, shift
        x.value = np.array([0.7, -0.8, 1.1])[:d]
        x_old.value = np.array([0.68, -0.83, 1.05])[:d]
        R, step = turned(now, d), turned(now - old, d)
        back = center + R.T @ (x.value - center - shift)
        carried = center + shift + step @ (x_old.value - center - 0.1 * shift)
        g, n, *tangents, slip, traction = np.split(values(msh, found), sizes)
        tangents = np.array(tangents)
        assert g == pytest.approx([gap(back)], rel=1e-13)
        assert n == pytest.approx(R @ normal(back), abs=1e-13)
        assert tangents @ tangents.T == pytest.approx(np.eye(d - 1), abs=1e-13)
        assert tangents @ n == pytest.approx(np.zeros(d - 1), abs=1e-13)
        if d == 2:
            assert tangents[0] == pytest.approx([n[1], -n[0]], abs=1e-13)
        else:
            assert np.linalg.det([n, *tangents]) == pytest.approx(1.0, rel=1e-13)
            assert tangents[0, 0] > 0.0  # along the hint
            assert tangents[1, 0] == pytest.approx(0.0, abs=1e-13)
        assert slip == pytest.approx(tangents @ (x.value - carried), abs=1e-13)
        assert traction == pytest.approx(c[0] * n + c[1:] @ tangents, abs=1e-12)


def test_wrong_obstacles_are_refused():
    with pytest.raises(ff.ContactInputError, match="has no direction"):
        ff.RigidPlane((0, 0), (0, 0))
    with pytest.raises(ff.ContactInputError, match="radius"):
        ff.RigidSphere((0, 0), -1.0)
    with pytest.raises(ff.ContactInputError, match="axis"):
        ff.RigidCylinder((0, 0, 0), (0, 0, 0), 1.0)
    with pytest.raises(ff.ContactInputError, match="cannot be met by points of 2"):
        ff.RigidPlane((0, 0, 0), (0, 0, 1)).gap(numbers([0, 0]))
    with pytest.raises(ff.ContactInputError, match="must return a UFL scalar"):
        ff.ImplicitObstacle(lambda X: 2 * X).gap(numbers([0, 0]))
    msh = mesh.create_rectangle(MPI.COMM_SELF, [[0, 0], [1, 1]], [1, 1])
    with pytest.raises(ff.ContactInputError, match="2 finite numbers; it has 3"):
        ff.RigidMotion(msh, center=(0, 0, 0))


# -- bodies ----------------------------------------------------------------------------------


def body(make, prefix, *, low, high, n, turn=None, energy="finite", traction=None, comm=None):
    """Build a rectangle or box; surfaces: 1 bottom, 3 left, 5 both.

    ``make(msh, surfaces)`` returns the contacts; the top is held by the Function ``top`` unless
    there are loads: ``traction`` (top, right), pressures.
    """
    d, comm = len(low), comm or MPI.COMM_WORLD
    create = mesh.create_rectangle if d == 2 else mesh.create_box
    kind = mesh.CellType.quadrilateral if d == 2 else mesh.CellType.hexahedron
    msh = create(comm, [list(low), list(high)], n, kind)
    up = d - 1
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(x[up], low[up]),
        lambda x: np.isclose(x[up], high[up]),
        lambda x: np.isclose(x[0], low[0]),
        lambda x: np.isclose(x[0], high[0]),
    )
    facets = np.sort(np.concatenate([tags.find(1), tags.find(3)]))
    corner = mesh.meshtags(msh, up, facets, np.full(len(facets), 5, dtype=np.int32))
    turn = np.eye(d) if turn is None else turn
    msh.geometry.x[:, :d] = msh.geometry.x[:, :d] @ turn.T
    V = fem.functionspace(msh, ("Lagrange", 1, (d,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    density = {"finite": ff.bulk.neo_hooke_energy, "small": ff.bulk.small_strain_energy}[energy]
    stored = ff.bulk.stored_energy(density(u, ff.bulk.Elastic(1000.0, 0.3)), ufl.dx)
    F, bcs, loads = ufl.derivative(stored, u, v), [], []
    if traction is None:
        bcs = [fem.dirichletbc(top, fem.locate_dofs_topological(V, up, tags.find(2)))]
    else:
        ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
        loads = [fem.Constant(msh, float(value)) for value in traction]
        F += loads[0] * v[up] * ds(2) + loads[1] * v[0] * ds(4)
    surfaces = {tag: ff.ContactSurface(msh, tags, tag, name=f"side {tag}") for tag in (1, 3)}
    surfaces[5] = ff.ContactSurface(msh, corner, 5, name="corner")
    contacts = make(msh, surfaces)
    problem = ff.FrictionalContactProblem(
        F, u, contact=contacts, bcs=bcs, petsc_options_prefix=prefix
    )
    x0 = V.tabulate_dof_coordinates()[:, :d]

    def place(rotation, translation=0.0):
        """Move the top as a rigid body: ``x -> rotation x + translation``."""
        top.x.array[:] = (x0 @ np.asarray(rotation).T + translation - x0).ravel()

    return SimpleNamespace(
        problem=problem, contacts=contacts, contact=contacts[0], place=place, x=x0, u=u, loads=loads
    )


def everywhere(problem, contact, array):
    """Gather nodal values of all ranks, ordered by the reference coordinates of the nodes."""
    parts = problem.comm.allgather((contact.surface.x, array))
    x, gathered = (np.concatenate(list(column)) for column in zip(*parts, strict=True))
    return gathered[np.lexsort(np.round(x, 7).T[::-1])]


def tractions(model, contact=None):
    """Return the traction vectors of a contact's nodes."""
    contact = contact or model.contact
    return everywhere(model.problem, contact, contact.nodal_traction())


def on_floor(mu):
    """Make the contact of the bottom with the floor, at rest."""
    return lambda msh, surfaces: [
        ff.Contact(surfaces[1], ff.RigidPlane((0.0, 0.0), (0.0, 1.0)), ff.Coulomb(mu))
    ]


SQUARE = {"low": (0.0, 0.0), "high": (1.0, 0.5), "n": [6, 3]}
PATH = [(0.0, -0.02), (0.02, -0.02), (0.1, -0.03), (0.3, -0.03), (0.25, -0.03)]


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
    x = contact.nodal_position()
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


@pytest.mark.mpi
@pytest.mark.parametrize("name", ROUND)
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
        for angle in np.radians([0, 15, 30, 50, 70, 90, 110, 130, 150]):
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
    R = Rotation.from_rotvec([0.0, np.radians(20.0), 0.0]).as_matrix()
    assert results[0][-1] == pytest.approx(R @ results[0][-2], abs=1e-3 * size)
    report = check_jacobian(model.problem)
    assert report.error < 1e-6, str(report)


# -- several contacts ------------------------------------------------------------------------

FLOOR = ff.RigidPlane((0.0, 0.0), (0.0, 1.0))
WALL = ff.RigidPlane((0.0, 0.0), (1.0, 0.0))


def two_surfaces(mu):
    """Make the contacts of floor and wall; the corner node belongs to the floor alone."""

    def make(msh, s):
        tags = tagged_facets(msh, lambda x: np.isclose(x[0], 0.0) & (x[1] > 0.1))
        return [
            ff.Contact(s[1], FLOOR, ff.Coulomb(mu)),
            ff.Contact(ff.ContactSurface(msh, tags, 1, "left"), WALL, ff.Coulomb(mu)),
        ]

    return make


def one_surface(msh, s):
    """Make the contacts of one surface with both obstacles, at the corner node, too."""
    return [ff.Contact(s[5], side, ff.Frictionless()) for side in (FLOOR, WALL)]


def separate(msh, s):
    """Make the same contacts, of a surface each."""
    return [ff.Contact(s[k], side, ff.Frictionless()) for k, side in ((1, FLOOR), (3, WALL))]


@pytest.mark.mpi
@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a_block_in_a_corner_is_in_equilibrium_by_two_contacts(mu):
    """Held by contact alone, pushed by two pressures: 1 m at 20 Pa on top, 0.5 m at 10 Pa."""
    model = body(two_surfaces(mu), "corner_", traction=(20.0, 10.0), energy="small", **SQUARE)
    for top, right in ((20.0, 10.0), (20.0, 2.0), (40.0, 30.0)):
        for load, value in zip(model.loads, (top, right), strict=True):
            load.value = value
        report = model.problem.solve()
        assert report.certified
        forces = np.array([totals.force for totals in report.contacts])
        assert forces.sum(axis=0) == pytest.approx((right / 2, top), rel=1e-9)
        if mu == 0.0:
            assert forces == pytest.approx(np.array([[0.0, top], [right / 2, 0.0]]), abs=1e-8)
        else:
            assert abs(forces[0, 0]) > 0.1
            assert forces[1, 1] != 0.0
    assert check_jacobian(model.problem).error < 1e-6


@pytest.mark.mpi
def test_one_surface_with_two_obstacles_equals_two_surfaces():
    """The multipliers of the corner node have other areas, its forces are the same."""
    forces, moved = [], []
    for make in (one_surface, separate):
        model = body(make, "shared_", traction=(20.0, 10.0), energy="small", **SQUARE)
        report = model.problem.solve()
        assert report.certified
        forces.append(np.array([totals.force for totals in report.contacts]))
        moved.append(model.u.x.array.copy())
    assert forces[0] == pytest.approx(np.array([[0.0, 20.0], [5.0, 0.0]]), abs=1e-8)
    assert forces[1] == pytest.approx(forces[0], abs=1e-8)
    assert moved[1] == pytest.approx(moved[0], abs=1e-11)


@pytest.mark.mpi
def test_what_one_obstacle_pins_does_not_bind_the_contact_with_the_other():
    """Both contacts of one surface share its nodes.

    A node of the right side, whose ``u_x`` is held, takes no part in the contact with a wall
    there; with the floor it does.
    """
    msh = mesh.create_rectangle(
        MPI.COMM_WORLD, [[0, 0], [1, 0.5]], [6, 3], mesh.CellType.quadrilateral
    )
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0) | np.isclose(x[0], 1.0))
    surface = ff.ContactSurface(msh, tags, 1)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    rubber = ff.bulk.Elastic(1000.0, 0.0)
    stored = ff.bulk.stored_energy(ff.bulk.small_strain_energy(u, rubber), ufl.dx)
    bcs = []
    for k, value, at in ((1, -0.01, 0.5), (0, 0.0, 1.0)):
        side = mesh.locate_entities_boundary(msh, 1, lambda x, k=k, at=at: np.isclose(x[k], at))
        dofs = fem.locate_dofs_topological(V.sub(k), 1, side)
        bcs.append(fem.dirichletbc(value, dofs, V.sub(k)))
    wall = ff.RigidPlane((1.0, 0.0), (-1.0, 0.0))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v),
        u,
        contact=[ff.Contact(surface, side, ff.Coulomb(0.3)) for side in (FLOOR, wall)],
        bcs=bcs,
        petsc_options_prefix="pins_",
    )
    report = problem.solve()
    assert report.certified
    assert report.contacts[0].force == pytest.approx((0.0, 20.0), abs=1e-8)


# -- initial states --------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("start", [0.05, 0.0, -0.015])
def test_open_touching_and_overlapping_starts_reach_the_same_solution(start):
    """An initial overlap is no history: the first step closes it, as if the body were pressed."""
    model = body(
        lambda msh, s: [
            ff.Contact(s[1], ff.RigidPlane((0.0, -start), (0.0, 1.0)), ff.Coulomb(0.4))
        ],
        "start_",
        energy="small",
        **SQUARE,
    )
    report = model.problem.solve()  # the loads of the start: none
    assert report.certified
    assert report.contacts[0].open == (7 if start > 0.0 else 0)
    assert (report.contacts[0].force[1] > 0.0) == (start < 0.0)
    model.place(np.eye(2), (0.0, -0.02 - start))
    report = model.problem.solve()
    reference = body(on_floor(0.4), "reference_", energy="small", **SQUARE)
    if start < 0.0:  # the overlap was pressed first, then the rest
        reference.place(np.eye(2), (0.0, start))
        reference.problem.solve()
    reference.place(np.eye(2), (0.0, -0.02))
    reference.problem.solve()
    expected = tractions(reference)
    assert tractions(model) == pytest.approx(expected, abs=1e-9 * np.max(abs(expected)))
