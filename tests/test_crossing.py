"""Nodes that go through faces or rigid obstacles within a step."""

from dataclasses import replace
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse
from dolfinx import fem, mesh
from scipy.spatial.transform import Rotation

import fenicsx_friction as ff
from fenicsx_friction.obstacles.crossing import Motion, find_crossed
from fenicsx_friction.obstacles.passage import through_ball
from fenicsx_friction.obstacles.ways import sign_changes
from fenicsx_friction.surfaces.face_cells import FACE_CELLS
from models import tagged_facets
from shapes import BALL, BAR, ball, bar, lid, outline, steep

DOWN = (0.0, -1.0)


def crossed(
    kind, nodes, faces, start, end, *, looks=None, moved=None, started=-1, turn=None, met=None
):
    """Return which nodes have crossed; all turned by ``turn`` at the end."""
    start, end = (np.atleast_2d(np.asarray(x, dtype=float)) for x in (start, end))
    d = nodes.shape[1]
    looks = np.eye(d)[-1] * -1.0 if looks is None else looks
    n = np.tile(np.asarray(looks, dtype=float), (len(start), 1))
    corners = nodes[faces]
    depths = 1e-3 * np.linalg.norm(np.ptp(corners, axis=1), axis=1)
    surface = SimpleNamespace(cell=FACE_CELLS[kind], faces=faces)
    moved, turn = nodes if moved is None else moved, np.eye(d) if turn is None else turn
    motion = Motion(
        (nodes, moved @ turn.T + 3.0),
        (start, end @ turn.T + 3.0),
        (n, n @ turn.T),
        (depths, np.full(len(start), np.inf)),
        (250.0 * depths, np.full(len(start), np.inf)),
    )
    return (find_crossed(surface, motion, np.full(len(start), started), met) >= 0).tolist()


def interval(start, end, top=False, **options):
    X, edges = outline()
    if top:
        edges = edges[np.all(X[edges][:, :, 1] == 1.0, axis=1)]
    return crossed("interval", X, edges, start, end, looks=DOWN, **options)


@pytest.mark.parametrize("turn", [0.0, 0.7, 3.0, np.pi])
@pytest.mark.parametrize("top", [False, True], ids=["closed", "top"])
def test_nodes_that_go_into_a_square_or_through_it_are_seen(top, turn):
    """Deep, from close by, right through; the frame may turn by any angle meanwhile."""
    c, s = np.cos(turn), np.sin(turn)
    options = {"top": top, "turn": np.array([[c, -s], [s, c]])}
    start = [(0.5, 1.2), (0.5, 1.0 + 1e-17), (0.5, 1.0 - 1e-16), (0.5, 1.2), (0.33, 9.0)]
    end = [(0.55, 0.7), (0.5, 0.5), (0.6, 0.5), (0.52, -0.3), (0.4, -9.0)]
    assert interval(start, end, **options) == [True] * 5


@pytest.mark.parametrize("turn", [0.0, 0.7, 3.0, np.pi])
@pytest.mark.parametrize("top", [False, True], ids=["closed", "top"])
def test_nodes_that_stay_in_front_or_go_over_the_edge_are_not(top, turn):
    """Slide with rounding, come and go, fall beside the body, slip off its edge."""
    c, s = np.cos(turn), np.sin(turn)
    options = {"top": top, "turn": np.array([[c, -s], [s, c]])}
    start = [(0.2, 1.0), (0.2, 1.0 + 1e-17), (0.5, 1.5), (1.05, 1.1), (0.9, 1.0), (0.5, 1.0)]
    end = [(0.8, 1.0 - 1e-16), (0.8, 1.0 - 1e-17), (0.5, 1.0), (1.05, -3.0), (1.2, 0.95), (0.5, 2)]
    assert interval(start, end, **options) == [False] * 6


def test_a_corner_that_the_straight_way_cuts_is_no_crossing():
    """Round a 24-gon by two or three sides; the averaged normal turns with the node."""
    angle = 2.0 * np.pi * np.arange(24) / 24.0
    X = np.column_stack([np.cos(angle), np.sin(angle)])
    edges = np.column_stack([np.arange(24), (np.arange(24) + 1) % 24])
    start, end = X[6] + [0.0, 1e-9], [1.0 + 1e-9, 1.0 + 1e-9] * (X[9] + X[8]) / 2.0
    assert crossed("interval", X, edges, start, end, looks=-(X[6] + X[9])) == [False]
    # The same way on to the middle of the polygon is one.
    assert crossed("interval", X, edges, start, 0.0 * end, looks=-(X[6] + X[9])) == [True]


def test_a_face_that_holds_a_node_is_not_entered_but_others_are():
    """Through the upper of two sheets on to the lower one, behind it by what an average allows."""
    X = np.array([[0.0, 1.0], [1.0, 1.0], [0.0, 0.0], [1.0, 0.0]])
    edges = np.array([[1, 0], [3, 2]])
    held = scipy.sparse.csr_array(np.array([[0, 1]]))
    for top, found in ((1.5, True), (0.5, False)):
        way = {"start": (0.5, top), "end": (0.5, -0.05)}
        assert crossed("interval", X, edges, **way, met=held) == [found]
        assert crossed("interval", X, edges, **way) == [True]


def test_a_node_that_slides_over_a_ridge_by_a_hair_has_not_crossed_it():
    """It is behind the face that it has left, whose edge is where it is."""
    X = np.array([[-1.0, -1.0], [0.0, 0.0], [1.0, -1.0]])
    edges = np.array([[1, 0], [2, 1]])
    for x in -np.logspace(-5, -1, 20):
        assert crossed("interval", X, edges, (0.5, -0.5), (x, x)) == [False]


def test_a_thin_moving_sheet_is_crossed():
    """The sheet moves, the node rests: also the other way round, and both at once."""
    X, edges = outline(1.0, 1e-3)
    for way in (0.0, 0.4, 1.0):
        start, end = np.array([[0.52, 0.5]]), np.array([[0.52, 0.5 - way]])
        moved = X + np.array([0.0, 1.0 - way])
        assert crossed("interval", X, edges, start, end, looks=DOWN, moved=moved) == [True]
    moved = X + np.array([0.0, 0.4])
    assert crossed("interval", X, edges, start, start, looks=DOWN, moved=moved) == [False]


def test_a_face_that_does_not_look_at_the_node_counts_not():
    """The lower side of a clamp moves under the lid and away from it."""
    X, edges = outline()
    start, end = (0.5, -0.3), (0.5, 1.4)
    assert crossed("interval", X, edges, start, end, looks=(0.0, -1.0)) == [False]


@pytest.mark.quick
@pytest.mark.parametrize("kind", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e6])
def test_surfaces_in_space(kind, unit):
    """Through the middle, through an edge, through a node; beside; turned by 2 rad."""
    X, faces = lid(kind)
    R = Rotation.from_rotvec([1.2, -0.8, 1.4]).as_matrix()
    start = np.array([[0.3, 0.4, 0.2], [0.5, 0.3, 0.2], [0.5, 0.5, 0.2], [1.1, 0.5, 0.2]])
    end = start - np.array([0.0, 0.0, 0.9])
    found = crossed(kind, unit * X, faces, unit * start, unit * end, turn=R)
    assert found == [True, True, True, False]
    slide = np.array([[0.1, 0.2, 0.0], [0.9, 0.7, -1e-17]])
    assert crossed(kind, unit * X, faces, unit * slide, unit * slide[::-1], turn=R) == [False] * 2


def test_the_warp_of_quadrilaterals_is_no_crossing():
    """A node just before a warped face is behind one of its triangles; deeper is a crossing."""
    X = np.array([[0, 0, 0.0], [1, 0, 0.2], [0, 1, 0.2], [1, 1, 0.0]])
    faces = np.array([[0, 1, 2, 3]])
    for a, b in ((0.6, 0.3), (0.25, 0.25), (0.5, 0.8)):
        z = 0.2 * (a * (1 - b) + b * (1 - a))
        start, end = (a, b, 0.6), (a, b, z + 1e-6)
        assert crossed("quadrilateral", X, faces, start, end) == [False]
        assert crossed("quadrilateral", X, faces, start, (a, b, z - 0.2)) == [True]


def test_a_node_that_was_behind_its_face_already_counts_as_entering():
    """As behind a condition that pushes bodies into each other: then out of reach."""
    assert interval((0.52, 0.97), (0.52, 0.3), top=True) == [False]
    X, edges = outline()
    edges = edges[np.all(X[edges][:, :, 1] == 1.0, axis=1)]
    face = int(np.flatnonzero(np.all(abs(X[edges][:, :, 0] - 0.52) < 0.1, axis=1))[0])
    assert interval((0.52, 0.97), (0.52, 0.3), top=True, started=face) == [True]


def test_sign_changes_of_polynomials():
    rng = np.random.default_rng(4)
    for degree in (2, 3):
        roots = rng.uniform(-0.5, 1.5, (200, degree))
        p = np.array([np.polynomial.polynomial.polyfromroots(r) for r in roots]).T
        row, t, falling = sign_changes(p)
        for k in range(200):
            inner = np.sort(roots[k][(roots[k] > 0.0) & (roots[k] < 1.0)])
            assert np.sort(t[row == k]) == pytest.approx(inner, abs=1e-9)
        slope = [np.polynomial.polynomial.polyval(s, np.polynomial.polynomial.polyder(p[:, k]))
                 for k, s in zip(row, t, strict=True)]  # fmt: skip
        assert np.array_equal(np.array(slope) < 0.0, falling)


# -- rigid obstacles ------------------------------------------------------------------------------


def test_a_ball_is_passed_where_entry_and_exit_enclose_a_right_angle():
    start, end = np.array([[-3.0, y] for y in (0.0, 0.7, 0.72, 2.0)]), np.zeros((4, 2))
    end[:] = start * [-1.0, 1.0]
    assert through_ball(start, end, 1.0).tolist() == [True, True, False, False]
    assert through_ball(start, start, 1.0).tolist() == [False] * 4


def falling(obstacle, d, moving):
    """Make the bottom nodes of a block that stands 0.5 above the origin.

    ``crossed(way)`` moves them, or the obstacle by the opposite, from the old state.
    """
    create = mesh.create_rectangle if d == 2 else mesh.create_box
    low, high = [-1.0] * (d - 1) + [0.5], [1.0] * (d - 1) + [1.0]
    msh = create(MPI.COMM_WORLD, [low, high], [9] + [1] * (d - 1))
    tags = tagged_facets(msh, lambda x: np.isclose(x[d - 1], 0.5))
    motion = ff.RigidMotion(msh, axis=(0.0, 1.0, 0.0))
    shape = replace(obstacle, motion=motion)
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1), shape, ff.Frictionless())
    V = fem.functionspace(msh, ("Lagrange", 1, (d,)))
    u, u_old = fem.Function(V), fem.Function(V)
    contact.bind(u, u_old, fem.Constant(msh, 1.0), "chen-mangasarian")
    X, n = V.tabulate_dof_coordinates()[:, :d], contact.surface.num_owned

    def crossed(way, angle=0.0):
        shift = way(np.zeros((1, d)))[0]
        motion.translation.value, motion.angle.value = 0.0 * shift, 0.0
        motion.commit()
        motion.angle.value = angle
        body_moves = angle != 0.0 or not moving
        motion.translation.value = 0.0 * shift if body_moves else -shift
        u.x.array[:] = (way(X) - X).ravel() if body_moves else 0.0
        before = u.x.array.copy()
        flags = contact.pairing.crossed(np.zeros(n, dtype=bool))
        assert np.array_equal(u.x.array, before)  # looking on the way leaves no trace
        return flags

    return SimpleNamespace(crossed=crossed, x=contact.surface.x)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("obstacle", "d"),
    [(BALL, 2), (ff.ImplicitObstacle(ball), 2), (ff.ImplicitObstacle(steep), 2), (BAR, 3)]
    + [(ff.ImplicitObstacle(bar), 3)],
)
@pytest.mark.parametrize("moving", [False, True], ids=["body moves", "obstacle moves"])
def test_a_rigid_obstacle_that_is_passed_through(obstacle, d, moving):
    """Straight through; along it; with it, as it goes round; to one side."""
    model = falling(obstacle, d, moving)
    for way, passes in (
        (lambda x: x - 2.0 * np.eye(d)[-1], True),
        (lambda x: x - 0.1 * np.eye(d)[-1], False),
        (lambda x: x + 2.0 * np.eye(d)[0], False),
    ):
        flags = model.crossed(way)
        below = abs(model.x[: len(flags), 0]) < 0.2
        assert np.array_equal(flags, passes & below)
    turn = Rotation.from_rotvec([0.0, 3.0, 0.0] if d == 3 else [0.0, 0.0, 3.0]).as_matrix()[:d, :d]
    assert not np.any(model.crossed(lambda x: x @ turn.T, angle=3.0))
