"""Rigid tools from surface meshes and displacements of degree 2: against shapes with a formula."""

from mpi4py import MPI

import numpy as np
import pytest

import fenicsx_friction as ff
from fenicsx_friction.obstacles.averaged import DEEP
from fenicsx_friction.obstacles.weighted_surface import WeightedSurface
from fenicsx_friction.verification.jacobian import check_jacobian
from models import by_place, tagged_facets
from pressed import Half
from rectangles import body, tractions
from test_rigid_surface import (
    distance,
    floor,
    follow_the_plane,
    forces,
    plane,
    pressed,
    refuse_the_way_through,
    tool_body,
    way,
)
from tools import ball, box

QUADRATIC = {"degree": 2, "simplices": True}
PATH = [(0, -0.02), (0, -0.05), (0.03, -0.05), (0.1, -0.05), (0.08, -0.03), (0, 0.02), (0, -0.03)]


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("d", "kind"),
    [(2, QUADRATIC), (2, {"degree": 3, "simplices": True}), (3, QUADRATIC), (3, {"degree": 2})],
    ids=["triangles", "cubic", "tetrahedra", "hexahedra"],
)
def test_a_plane_in_uneven_faces_is_the_plane(d, kind):
    """Pressed, dragged over faces, lifted, pressed again: tractions and displacements."""
    name = f"{kind['degree']}{len(kind)}{d}_"
    models = [pressed(o, f"{n}{name}", d, **kind) for o, n in ((plane(d), "p"), (floor(d), "s"))]
    for x, z in PATH if kind["degree"] == 2 else PATH[:3]:
        for model in models:
            model.place(np.eye(d), way(d, x, z))
            assert model.problem.solve().certified
        expected, found = (tractions(model) for model in models)
        assert found == pytest.approx(expected, abs=1e-9 * max(np.max(abs(expected)), 1.0))
        first, second = (by_place(model.u) for model in models)
        assert second == pytest.approx(first, abs=1e-10)
    assert check_jacobian(models[1].problem).error < 1e-6


@pytest.mark.mpi
def test_an_end_that_is_deep_in_the_floor_it_meets_has_not_gone_through_it():
    """Dragged hard, the end of a block is in front of the floor on average only, as of a plane."""
    path = [(0.01 * i, -0.03 - 0.002 * i) for i in range(16)]
    models = [
        pressed(o, f"{n}end_", 2, mu=0.6, n=[12, 6], **QUADRATIC)
        for o, n in ((plane(2), "p"), (floor(2), "s"))
    ]
    for x, z in path:
        for model in models:
            model.place(np.eye(2), way(2, x, z))
            report = model.problem.solve()
        assert tractions(models[1]) == pytest.approx(tractions(models[0]), abs=1e-6)
    face = models[0].contact.pairing.side.facet_size().max(initial=0.0)
    face = models[0].problem.comm.allreduce(face, MPI.MAX)
    assert report.contacts[0].penetration > DEEP * face


@pytest.mark.parametrize(("half", "thick", "depth"), [(1.5, 0.001, -2.0), (0.4, 0.2, -0.4)])
def test_a_body_is_not_held_by_a_plate_that_it_is_behind_or_beside(half, thick, depth):
    """Ends below a thin plate, corners beside a narrow one: deep, but not in the level face."""
    tool = ff.RigidSurface(*box((-half, -thick), (half, 0.0)))
    place = {"low": (-1.0, 0.0), "high": (1.0, 1.0), "n": [8, 4], "energy": "small"}
    model = pressed(tool, f"plate{thick}_".replace(".", ""), 2, **{**QUADRATIC, **place})
    model.place(np.eye(2), way(2, 0.0, depth))
    with pytest.raises(ff.StepFailed, match="went through"):
        model.problem.solve()


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_a_moving_turning_floor_is_the_moving_plane(d):
    follow_the_plane(d, "m2", ((0.0, 0.03), (0.03, 0.03), (0.06, 0.05)), **QUADRATIC)


def rolled(obstacle, name, d, n):
    """Press a block on a ball below, drag it and turn the ball; return nodal forces and model."""
    center, motions, found = (0.0,) * (d - 1) + (-1.0,), [], []

    def make(msh):
        motions.append(ff.RigidMotion(msh, center=center))
        return obstacle(center, motions[0])

    model = pressed(make, name, d, n=n, **QUADRATIC)
    for x, z, angle in ((0, -0.02, 0), (0, -0.05, 0), (0.03, -0.05, 0), (0.1, -0.05, 0.1)):
        model.place(np.eye(d), way(d, x, z))
        motions[0].angle.value = angle
        assert model.problem.solve().certified
        found.append(forces(model))
    return np.array(found), model


@pytest.mark.parametrize(
    ("d", "numbers", "n"), [(2, (40, 160, 640), [16, 8]), (3, (500, 4000), [4, 4, 2])]
)
def test_balls_in_ever_finer_faces_tend_to_the_ball(d, numbers, n):
    """With the square of the size of the faces; tangents are exact over many faces, too."""
    exact, _ = rolled(lambda c, m: ff.RigidSphere(c, 1.0, motion=m), f"exact{d}_", d, n)
    errors = []
    for number in numbers:

        def tool(center, motion, number=number):
            return ff.RigidSurface(*ball(d, number, center=center), motion=motion)

        found, model = rolled(tool, f"ball{d}{number}_", d, n)
        errors.append(distance(found, exact))
        assert check_jacobian(model.problem).error < 1e-6
    finer = np.log(numbers[-1] / numbers[0]) / (d - 1)
    assert errors[-1] < 0.02 and np.log(errors[0] / errors[-1]) > 1.6 * finer


def punch(n, prefix, *, low=-0.12, high=0.12, degree=2):
    """Press a block on a punch with sharp edges; return the report and the model."""
    tool = ff.RigidSurface(*box((low, -1.0), (high, 0.0)))
    model = pressed(tool, prefix, 2, n=[n, n // 2], degree=degree, simplices=True)
    for z in (-0.01, -0.02):
        model.place(np.eye(2), way(2, 0.0, z))
        report = model.problem.solve()
        assert report.certified
    return report.contacts[0], model


def test_only_what_is_over_the_tool_presses():
    """A punch whose edges are inside faces: on coarse meshes a node's share is what it covers."""
    found = [punch(n, f"punch{n}_") for n in (8, 16, 64)]
    force = [contact.force[1] for contact, _ in found]
    assert abs(np.array(force[:-1]) / force[-1] - 1.0) == pytest.approx(0.0, abs=0.06)
    _, model = found[1]
    x, f = model.contact.pairing.acting()
    over = (x[:, 0] > -0.13) & (x[:, 0] < 0.13)  # the block bulges beside the punch
    assert np.sum(f[over, 1]) == pytest.approx(force[1], rel=1e-12)
    residual = np.sum(f, axis=0)
    assert residual == pytest.approx(found[1][0].force, rel=1e-12)


def test_a_step_in_which_nothing_moves_changes_nothing():
    """What counts as covered depends on where points are, not on what was closed before."""
    contact, model = punch(8, "still_", low=-0.185, high=0.185)
    for _ in range(2):
        again = model.problem.solve().contacts[0]
        assert again.force == pytest.approx(contact.force, abs=1e-9 * contact.force[1])


def test_a_block_slides_over_an_edge_and_back():
    """Points under the top, near its edge, are far behind the side of the tool: they are not in."""
    tool = ff.RigidSurface(*box((-0.12, -1.0), (0.12, 0.0)))
    model = pressed(tool, "over_", 2, n=[10, 5], **QUADRATIC)
    for x, z in [(0, -0.01), (0, -0.02), (0.02, -0.02), (0.1, -0.02), (0.02, -0.02), (0, -0.02)]:
        model.place(np.eye(2), way(2, x, z))
        report = model.problem.solve()
        x_force, z_force = report.contacts[0].force
        assert report.certified and abs(x_force) < 0.3 * z_force * (1.0 + 1e-6)


def test_without_cover_the_punch_would_press_beside_its_edges(monkeypatch):
    """Averages over whole patches count what is beyond the edge: far nodes would be open."""

    def whole(self):
        write(self)
        self.points.share, self.cover = self._whole, (self.cover > 0.0) * 1.0

    write = WeightedSurface._write
    monkeypatch.setattr(WeightedSurface, "_write", whole)
    with pytest.raises((AssertionError, ff.StepFailed)):
        test_only_what_is_over_the_tool_presses()


@pytest.mark.mpi
def test_a_faceted_body_that_carries_loads_finds_its_place():
    """Pressed by the force that pressing it by a displacement has found; partly covered nodes."""

    def faceted(center, motion):
        return ff.RigidSurface(*box((-0.27, 0.0), (0.33, 0.4)), motion=motion)

    def model(name):
        return Half(name, tool_body(2, faceted), 2, degree=2)

    given, loaded = model("given_"), model("loaded_")
    for depth, x in ((0.01, 0.0), (0.02, 0.0), (0.02, 0.005)):
        given.body.given.value[:2] = loaded.body.given.value[:2] = x, -depth
        force = np.array(given.problem.solve().bodies[0].force)
        if depth == 0.01:
            loaded.problem.solve()
            loaded.body.free = ("x", "y")
            continue
        loaded.body.force.value[:] = -force
        here = loaded.problem.solve()
        assert here.certified
        assert np.allclose(np.array(here.bodies[0].translation), (x, -depth), atol=1e-9)
    assert check_jacobian(loaded.problem).error < 1e-6


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_a_step_through_a_thin_tool_is_refused(d, monkeypatch):
    refuse_the_way_through(d, WeightedSurface, 0.005, "thin2", monkeypatch, **QUADRATIC)


def test_a_spike_between_the_nodes_is_refused():
    """A tool that is smaller than the faces enters them where no average sees it."""
    spike = ff.RigidSurface(
        [(-0.02, -1.0), (0.02, -1.0), (0.0, 0.0)], [(0, 1), (1, 2), (2, 0)], open_edges="error"
    )
    model = pressed(spike, "spike_", 2, n=[5, 3], **QUADRATIC)
    with pytest.raises(ff.StepFailed):
        for depth in (0.01, 0.03, 0.06):
            model.place(np.eye(2), way(2, 0.0, -depth))
            model.problem.solve()


def test_gaps_of_a_bore_close():
    """A block in a slot of its own width, a little too wide: as in one that fits."""
    found = []
    for gap, close in ((0.0, None), (1e-3, 2e-3)):
        tool = floor(2, close_gaps=close)
        model = pressed(tool, f"bore{gap}_", 2, low=(-0.5, gap), high=(0.5, 0.5 + gap), **QUADRATIC)
        model.place(np.eye(2), way(2, 0.0, -0.03))
        assert model.problem.solve().certified
        found.append(forces(model))
    assert found[1] == pytest.approx(found[0], abs=1e-8 * np.max(abs(found[0])))


def test_multipliers_at_all_nodes_are_refused():
    def make(msh, surfaces):
        bottom = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0))
        whole = ff.ContactSurface(msh, bottom, 1, degree=2)
        return [ff.Contact(whole, floor(2), ff.Coulomb(0.3))]

    with pytest.raises(ff.ContactInputError, match="degree = 2: its nodes do not meet"):
        body(make, "all_", low=(-0.5, 0.0), high=(0.5, 0.5), n=[4, 2], **QUADRATIC)
