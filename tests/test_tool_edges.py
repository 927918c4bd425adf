# SPDX-License-Identifier: MIT
"""Edges of rigid tools: in faces of the body, beside its points, and moved away under it."""

import numpy as np
import pytest

import fenicsx_friction as ff
from fenicsx_friction.obstacles import against_faces, crossing_events
from fenicsx_friction.obstacles.face_pairs import FacesMet
from fenicsx_friction.obstacles.points_met import PointsMet
from fenicsx_friction.obstacles.tool_edges import ToolEdges
from fenicsx_friction.surfaces.faces import Faces
from rectangles import body
from test_rigid_surface import forces, pressed, way
from tools import box, polygon


def roof(parts, slope=1.0):
    """A ridge along y between two rows of nodes, whose ends are beyond the body."""
    y = np.linspace(-2.0, 2.0, parts + 1)
    points = np.array([(0.125 + x / slope, b, -abs(x)) for b in y for x in (0.0, -1.0, 1.0)])
    faces = []
    for a in range(0, 3 * parts, 3):
        b = a + 3
        faces += [(a, b, b + 1), (a, b + 1, a + 1), (a, b + 2, b), (a, a + 2, b + 2)]
    return ff.RigidSurface(points, faces, open_edges="allow")


@pytest.mark.parametrize("parts", [1, 8])
@pytest.mark.parametrize(
    "kind", [{}, {"simplices": True}, {"degree": 2, "simplices": True}], ids=["Q1", "P1", "P2"]
)
def test_a_ridge_of_long_triangles_between_the_nodes_is_refused(kind, parts):
    """Its only corners may be far away."""
    model = pressed(roof(parts), f"ridge{parts}{len(kind)}_", 3, mu=0.0, **kind)
    with pytest.raises(ff.StepFailed, match="went through"):
        for z in (0.02, 0.04, 0.06):
            model.place(np.eye(3), way(3, 0.0, -z))
            model.problem.solve()


def dip(touch, name):
    """Lower a block on a wedge whose tip is between nodes, till one touches a flank by ``touch``.

    Returns the force there; the tip is 0.3 of a face deep.
    """
    wedge = ff.RigidSurface(*polygon([(0.03, 0.0), (-0.97, -1.0), (1.03, -1.0)]))
    make = lambda msh, on: [ff.Contact(on[1], wedge, ff.Coulomb(0.3))]  # noqa: E731
    low, high = (-0.5, 0.0), (0.5, 0.5)
    model = body(make, name, low=low, high=high, n=[10, 5], simplices=True)
    for z in (0.01, -0.03 - touch):
        model.place(np.eye(2), np.array([0.0, z]))
        force = model.problem.solve().contacts[0].force
    return float(np.linalg.norm(force))


@pytest.mark.parametrize("touch", [0.0, 1e-6, 1e-4])
def test_a_node_that_only_touches_a_flank_does_not_hold_the_tip(touch, monkeypatch):
    with pytest.raises(ff.StepFailed, match="2 nodes of 'side 1' have faces"):
        dip(touch, "touch_")
    assert dip(0.015, "pressed_") > 1.0  # a force that belongs to it
    monkeypatch.setattr(against_faces, "SHARPER", 1e30)
    assert dip(max(touch, 1e-6), "net_") < 0.05  # a certificate for next to no force


def pulled_down(n, name):
    """A stretched belt, 0.4 of a face thick if n = 80, is pulled down over a roof by its ends."""
    roof = ff.RigidSurface(*polygon([(0.0, 0.0), (-2.75, -1.0), (2.75, -1.0)]))
    make = lambda msh, on: [ff.Contact(on[1], roof, ff.Frictionless())]  # noqa: E731
    ends = lambda x: np.isclose(abs(x[0]), 0.5)  # noqa: E731
    belt = body(make, name, low=(-0.5, 0.001), high=(0.5, 0.006), n=[n, 4], held=ends)
    for depth in (0.0, 0.03, 0.06, 0.09, 0.12, 0.15):
        belt.place(np.diag([1.02, 1.0]), np.array([0.0, -depth]))
        force = belt.problem.solve().contacts[0].force[1]
    return force


def test_thin_bodies_are_folded_round_edges_by_small_forces(monkeypatch):
    """The edge is an eighth of a face deep; a mesh twice as fine gives the same force."""
    force = pulled_down(80, "belt_")
    assert force == pytest.approx(pulled_down(160, "fine_belt_"), rel=0.02)
    monkeypatch.setattr(against_faces, "BENT", 0.0)
    with pytest.raises(ff.StepFailed, match="have faces"):
        pulled_down(80, "net_")


@pytest.mark.parametrize("simplices", [False, True])
def test_a_punch_may_end_at_a_node_or_a_little_inside_or_outside(simplices, monkeypatch):
    """The nodes at its edges slide down beside it, or stay on it: with the force in between."""

    def punched(half, name):
        punch = ff.RigidSurface(*box((-half, -0.5), (half, 0.0)))
        make = lambda msh, on: [ff.Contact(on[1], punch, ff.Coulomb(0.4))]  # noqa: E731
        low, high = (-0.5, 0.0), (0.5, 0.5)
        model = body(make, name, low=low, high=high, n=[10, 5], simplices=simplices)
        for z in (-0.0001, -0.0003, -0.003, -0.02):
            model.place(np.eye(2), np.array([0.0, z]))
            force = model.problem.solve().contacts[0].force[1]
        return force

    least, most = (punched(half, f"punch{half}_") for half in (0.19, 0.21))
    for inside in (0.0, 1e-9, 1e-5, 1e-4, -1e-4):
        force = punched(0.2 - inside, f"punch{inside}_")
        assert 0.99 * least < force < 1.01 * most
    monkeypatch.setattr(crossing_events, "ROUNDING", np.inf)  # nothing counts as beside
    with pytest.raises(ff.StepFailed, match="went through"):
        punched(0.2 - 1e-4, "net_")


def test_points_are_on_sharp_edges_only():
    """Of a cube in triangles: 8 corners, two points on each of 12 edges, none on diagonals."""
    points, faces = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    surface = ff.RigidSurface(points, faces).surface
    found = ToolEdges(surface, 0.4)
    assert len(found.open) == 0 and len(found.x) == 8 + 24
    on_edge = np.isclose(found.x, 0.0) | np.isclose(found.x, 1.0)
    assert np.all(np.sum(on_edge, axis=1) >= 2)
    between = np.sum(on_edge, axis=1) == 2
    out = 2.0 * (found.x - 0.5)
    assert found.normals[between] == pytest.approx(np.where(on_edge, out, 0.0)[between] / 2**0.5)
    lid = Faces(surface.cell, surface.X, surface.faces[1:])
    assert len(ToolEdges(lid, 0.4).open) == 3


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
def test_a_tool_that_is_drawn_out_under_a_block_at_rest_lets_it_go(degree):
    """Without friction nothing but the faces that are met changes: as if it were put there."""
    motions, found = [], []

    def make(msh, surfaces):
        motions.append(ff.RigidMotion(msh))
        plate = ff.RigidSurface(*box((-0.62, -1.0), (0.62, 0.0)), motion=motions[-1])
        return [ff.Contact(surfaces[1], plate, ff.Frictionless())]

    for path in ([(-0.02, 0.0), (-0.02, 0.4), (-0.02, 0.8)], [(0.1, 0.8), (-0.02, 0.8)]):
        model = body(
            make, f"out{degree}_", low=(-0.5, 0.0), high=(0.5, 0.5), n=[10, 5], degree=degree
        )
        for z, x in path:
            model.place(np.eye(2), np.array([0.0, z]))
            motions[-1].translation.value[0] = x
            found.append(model.problem.solve().contacts[0].force[1])
    whole, *_, drawn, _, fresh = found
    assert drawn == pytest.approx(fresh, rel=1e-9)
    assert 0.0 < drawn < 0.5 * whole


def two_punches(n):
    """Press quadratic triangles on two punches, with edges between the nodes; return the force."""
    ends = np.array([(-0.33, -1.0), (-0.2, 0.0), (0.22, -1.0), (0.37, 0.0)])
    boxes = [box(*ends[:2]), box(*ends[2:])]
    points = np.concatenate([b[0] for b in boxes])
    faces = np.concatenate([boxes[0][1], boxes[1][1] + len(boxes[0][0])])
    options = {"mu": 0.0, "degree": 2, "simplices": True, "n": [n, n // 2]}
    model = pressed(ff.RigidSurface(points, faces), f"two{n}_", 2, **options)
    for z in (0.01, 0.03, 0.03):
        model.place(np.eye(2), way(2, 0.0, -z))
        force = model.problem.solve().contacts[0].force[1]
    return force


@pytest.mark.mpi
def test_points_that_go_to_and_fro_over_an_edge_find_their_place():
    assert two_punches(10) == pytest.approx(two_punches(20), rel=0.05)


def test_without_keeping_they_do_not(monkeypatch):
    found = PointsMet._find
    monkeypatch.setattr(
        PointsMet, "_find", lambda self, u, held, last=None, keep=0.0: found(self, u, held, last)
    )
    with pytest.raises(ff.StepFailed):
        two_punches(10)


def over_the_step(name):
    """A block of the plane is put over the edge of a step, and drawn off it to the floor beside."""
    corners = [(-0.52, 0.04), (-3.0, 0.04), (-3.0, -1.0), (2.0, -1.0), (2.0, 0.0), (-0.52, 0.0)]
    stair = ff.RigidSurface(*polygon(corners))
    model = pressed(stair, name, 2, mu=0.0, n=[10, 5], simplices=True)
    down = [(-0.1, z) for z in (0.06, 0.02, 0.0, -0.02)]
    for x, z in [*down, *((x, -0.02) for x in (-0.05, -0.02, 0.01, 0.02))]:
        model.place(np.eye(2), np.array([x, z]))
        force = model.problem.solve().contacts[0].force[1]
    return force


def test_the_end_of_a_body_does_not_hang_beyond_an_edge(monkeypatch):
    """As on the flat floor; with nodes that keep their faces half a face beyond, 13 % more."""
    flat = pressed(
        ff.RigidPlane((0.0, 0.0), (0.0, 1.0)), "flat_", 2, mu=0.0, n=[10, 5], simplices=True
    )
    flat.place(np.eye(2), np.array([0.02, -0.02]))
    force = flat.problem.solve().contacts[0].force[1]
    assert over_the_step("end_") == pytest.approx(force, rel=1e-9)
    monkeypatch.setattr(FacesMet, "_gone", lambda self, found, *places: ~found.paired)
    assert over_the_step("hangs_") > 1.1 * force


def test_nodes_at_the_sides_of_a_body_keep_their_face_as_those_between():
    """Drawn over an edge by less than half a face, with the sides along the way."""
    tool = ff.RigidSurface(*box((-2.0, -2.0, -1.0), (0.3, 2.0, 0.0)))
    model, rows = pressed(tool, "sides_", 3, mu=0.0, n=[4, 4, 2]), []
    for x in (0.0, 0.04, 0.08, 0.1):
        model.place(np.eye(3), np.array([x, 0.0, -0.02]))
        assert model.problem.solve().certified
        rows.append(forces(model)[:, 2])
    assert np.array(rows[1:]) == pytest.approx(np.array(rows[:-1]), abs=1e-9)
    assert rows[0].reshape(5, 5)[:, 3].min() > 0.1  # the row that goes beyond the edge
