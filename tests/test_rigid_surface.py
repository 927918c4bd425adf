"""Rigid tools from surface meshes: against shapes with a formula, turned, loaded, refused."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import fenicsx_friction as ff
from fenicsx_friction.obstacles.surface_pairing import SurfacePairing
from fenicsx_friction.verification.jacobian import check_jacobian
from models import by_place
from pressed import Half
from rectangles import body, tractions, turned
from tools import ball, box, uneven_plane

BLOCK = {
    2: {"low": (-0.5, 0.0), "high": (0.5, 0.5), "n": [9, 5]},
    3: {"low": (-0.5, -0.5, 0.0), "high": (0.5, 0.5, 0.4), "n": [4, 4, 2]},
}
#: Along and down: press, drag, drag over many faces in one step, back, lift, press.
PATH = [(0, -0.02), (0, -0.1), (0.05, -0.1), (0.6, -0.1), (0.55, -0.08), (0, 0.02), (0, -0.03)]


def way(d, x, z):
    return np.array([x, *[0.5 * x] * (d - 2), z])


def pressed(obstacle, name, d, mu=0.3, **options):
    """Return a block on an obstacle."""

    def make(msh, surfaces):
        found = obstacle(msh) if callable(obstacle) else obstacle
        return [ff.Contact(surfaces[1], found, ff.Coulomb(mu))]

    return body(make, name, **{**BLOCK[d], **options})


def floor(d, **options):
    return ff.RigidSurface(*uneven_plane(d), open_edges="allow", **options)


def plane(d, **options):
    return ff.RigidPlane((0.0,) * d, (0.0,) * (d - 1) + (1.0,), **options)


def forces(model):
    """Return the nodal forces of all nodes, in one order on any partition."""
    contact, comm = model.contact, model.problem.comm
    n = contact.surface.num_owned
    rows = np.column_stack(
        [contact.surface.x[:n], contact.nodal_traction() * contact.nodal_area()[:, None]]
    )
    rows = np.concatenate(comm.allgather(rows))
    return rows[np.lexsort(np.round(rows[:, :3], 9).T)][:, 3:]


def distance(a, b):
    return np.linalg.norm(a - b) / np.linalg.norm(b)


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_a_plane_in_uneven_faces_is_the_plane(d):
    """Pressed, dragged over many faces, lifted: tractions, displacements and slip paths."""
    models = [pressed(o, f"{n}{d}_", d) for o, n in ((plane(d), "p"), (floor(d), "s"))]
    for x, z in PATH:
        for model in models:
            model.place(np.eye(d), way(d, x, z))
            assert model.problem.solve().certified
        expected, found = (tractions(model) for model in models)
        assert found == pytest.approx(expected, abs=1e-9 * max(np.max(abs(expected)), 1.0))
        first, second = (model.u.x.array for model in models)
        assert second == pytest.approx(first, abs=1e-9 * 0.1)
        paths = [model.contact.path.x.array for model in models]
        assert paths[1] == pytest.approx(paths[0], abs=1e-9)
    assert check_jacobian(models[1].problem).error < 1e-6


def follow_the_plane(d, name, steps, **options):
    """Move a floor of faces and a plane under blocks: the same tractions; returns the models."""
    motions = []

    def moving(obstacle):
        def make(msh):
            motions.append(ff.RigidMotion(msh, center=(0.1,) * d))
            return obstacle(d, motion=motions[-1])

        return make

    models = [pressed(moving(o), f"{name}{o.__name__}{d}_", d, **options) for o in (plane, floor)]
    for angle, up in steps:
        for model, motion in zip(models, motions, strict=True):
            motion.angle.value, motion.translation.value = angle, way(d, 0.4 * angle, up)
            assert model.problem.solve().certified
        expected = tractions(models[0])
        assert tractions(models[1]) == pytest.approx(expected, abs=1e-9 * np.max(abs(expected)))
    return models


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_a_moving_turning_floor_is_the_moving_plane(d):
    models = follow_the_plane(d, "m", ((0.0, 0.05), (0.05, 0.05), (0.1, 0.08)))
    assert check_jacobian(models[1].problem).error < 1e-6


def rolled(obstacle, name, d, n):
    """Press a block on a ball below, drag it along and turn the ball; return nodal forces."""
    center, motions, found = (0.0,) * (d - 1) + (-1.0,), [], []

    def make(msh):
        motions.append(ff.RigidMotion(msh, center=center))
        return obstacle(center, motions[0])

    model = pressed(make, name, d, n=n)
    for x, z, angle in ((0, -0.02, 0), (0, -0.05, 0), (0.05, -0.05, 0), (0.3, -0.05, 0.4)):
        model.place(np.eye(d), way(d, x, z))
        motions[0].angle.value = angle
        assert model.problem.solve().certified
        found.append(forces(model))
    return np.array(found)


@pytest.mark.parametrize(
    ("d", "numbers", "n"), [(2, (40, 640), [16, 8]), (3, (500, 8000), [6, 6, 2])]
)
def test_balls_in_ever_finer_faces_tend_to_the_ball(d, numbers, n):
    """Faster than with the size of the faces: gaps err with its square, normals with itself."""
    exact = rolled(lambda c, m: ff.RigidSphere(c, 1.0, motion=m), f"exact{d}_", d, n)
    errors = []
    for number in numbers:

        def tool(center, motion, number=number):
            return ff.RigidSurface(*ball(d, number, center=center), motion=motion)

        found = rolled(tool, f"ball{d}{number}_", d, n)
        totals = [np.sum(f, axis=1) for f in (found, exact)]
        errors.append([distance(found, exact), distance(*totals)])
    (first, first_total), (last, last_total) = errors
    finer = np.log(numbers[-1] / numbers[0]) / (d - 1)
    assert last_total < 0.02 and np.log(first_total / last_total) > 1.4 * finer
    assert last < 0.03 and np.log(first / last) > 1.0 * finer


@pytest.mark.mpi
def test_all_partitions_give_the_same():
    def tool(center, motion):
        return ff.RigidSurface(*ball(3, 1000, center=center), motion=motion)

    def run(comm, name):
        model = pressed(tool((0.0, 0.0, -1.0), None), name, 3, comm=comm)
        for x, z in PATH[:3]:
            model.place(np.eye(3), way(3, x, z))
            assert model.problem.solve().certified
        return forces(model)

    alone = run(MPI.COMM_SELF, "alone_")
    assert distance(run(MPI.COMM_WORLD, "together_"), alone) < 1e-8


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_a_model_that_is_turned_with_its_tool_gives_the_same(d):
    points, faces = ball(d, {2: 90, 3: 800}[d], center=(0.0,) * (d - 1) + (-1.0,))
    R = turned(0.8, d)
    straight = pressed(ff.RigidSurface(points, faces), f"straight{d}_", d)
    skew = pressed(ff.RigidSurface(points @ R.T, faces), f"skew{d}_", d, turn=R)
    for x, z in PATH[:4]:
        straight.place(np.eye(d), way(d, 0.3 * x, z))
        skew.place(np.eye(d), R @ way(d, 0.3 * x, z))
        for model in (straight, skew):
            assert model.problem.solve().certified
        a, b = (m.u.x.array.reshape(-1, d) for m in (straight, skew))
        assert b == pytest.approx(a @ R.T, abs=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_a_tool_carried_by_a_motion_is_the_tool_placed_there(d):
    center = np.array((0.0,) * (d - 1) + (-1.0,))
    points, faces = ball(d, {2: 90, 3: 800}[d], center=center)
    angle, shift = 0.7, np.full(d, 0.01)
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])[:d, :d]

    def carried(msh):
        motion = ff.RigidMotion(msh, center=center)
        motion.angle.value, motion.translation.value = angle, shift
        motion.commit()
        return ff.RigidSurface(points, faces, motion=motion)

    placed = ff.RigidSurface((points - center) @ R.T + center + shift, faces)
    models = [pressed(o, f"{n}{d}_", d) for o, n in ((carried, "carried"), (placed, "placed"))]
    for x, z in PATH[:3]:
        for model in models:
            model.place(np.eye(d), way(d, x, z))
            assert model.problem.solve().certified
        assert distance(forces(models[0]), forces(models[1])) < 1e-9


@pytest.mark.mpi
def test_a_wheel_of_many_edges_slides_round_with_the_moment_mu_N_R():
    """Half a turn, each step over some fifteen faces: slip is carried over all of them."""
    motions, mu = [], 0.25

    def wheel(msh):
        motions.append(ff.RigidMotion(msh, center=(0.0, -1.0)))
        return ff.RigidSurface(*ball(2, 360, center=(0.0, -1.0)), motion=motions[0])

    model = pressed(wheel, "wheel_", 2, mu=mu)
    model.place(np.eye(2), (0.0, -0.03))
    before = None
    for k in range(13):
        motions[0].angle.value = k * np.pi / 12
        assert model.problem.solve().certified
        contact, n = model.contact, model.contact.surface.num_owned
        closed = contact.nodal().states() == ff.SLIP
        path = contact.path.x.array[:n].copy()
        if k > 1:
            x, t = contact.pairing.positions() + [0.0, 1.0], contact.nodal_traction()
            area = contact.nodal_area()
            turning = area @ (x[:, 0] * t[:, 1] - x[:, 1] * t[:, 0])
            total = model.problem.comm.allreduce(
                np.array([turning, area @ contact.nodal().c[:, 0]])
            )
            assert total[0] == pytest.approx(mu * total[1], rel=0.01)
            chord = 2.0 * np.sin(np.pi / 24) * np.cos(np.pi / 24)  # along the tangent at its end
            assert (path - before)[closed] == pytest.approx(chord, rel=0.02)
        before = path


def tool_body(d, obstacle, **options):
    """Return what makes a body that touches the block of ``Half`` from above."""
    center = (0.0,) * (d - 1) + (1.0,)

    def bodies(msh):
        found = ff.RigidBody(msh, center=center, **options)
        return [found], [obstacle(center, found)]

    return bodies


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_a_faceted_body_that_carries_loads_finds_its_place(d):
    """Pressed by the force that pressing it by a displacement has found; exact tangents."""

    def faceted(center, motion):
        return ff.RigidSurface(*ball(d, {2: 200, 3: 3000}[d], center=center), motion=motion)

    given = Half(f"given_{d}_", tool_body(d, faceted), d)
    loaded = Half(f"loaded_{d}_", tool_body(d, faceted), d)
    up = d - 1
    for depth, x in ((0.03, 0.0), (0.05, 0.0), (0.05, 0.01), (0.06, 0.03)):
        given.body.given.value[[0, up]] = x, -depth
        loaded.body.given.value[[0, up]] = x, -depth
        force = np.array(given.problem.solve().bodies[0].force)
        if depth == 0.03:
            loaded.problem.solve()
            loaded.body.free = ("x", "y" if d == 2 else "z")
            continue
        loaded.body.force.value[:] = -force
        here = loaded.problem.solve()
        assert here.certified
        assert np.allclose(np.array(here.bodies[0].translation)[[0, up]], (x, -depth), atol=1e-9)
    assert check_jacobian(loaded.problem).error < 1e-6


@pytest.mark.mpi
def test_a_faceted_platen_under_an_off_centre_load_tilts_as_a_flat_one():
    models = []
    for kind in ("flat", "faceted"):

        def platen(center, motion, kind=kind):
            if kind == "flat":
                return ff.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), motion=motion)
            points, faces = uneven_plane(3)
            return ff.RigidSurface(points, faces, flip=True, open_edges="allow", motion=motion)

        model = Half(f"{kind}_", tool_body(3, platen), 3, mu=0.2)
        model.body.given.value[2] = -1e-3
        model.problem.solve()
        model.body.free = ("z", "rx", "ry")
        model.body.force.value[2] = -2.0
        model.body.moment.value[:] = (0.1, 0.2, 0.0)
        assert model.problem.solve().certified
        models.append(model)
    a, b = (by_place(model.u) for model in models)
    assert b == pytest.approx(a, abs=1e-9 * max(np.max(abs(a), initial=0.0), 1e-3))
    assert np.allclose(models[0].body.rotation(), models[1].body.rotation(), atol=1e-10)


def refuse_the_way_through(d, kind, thickness, name, monkeypatch, **options):
    """Press a block on a thin tool, lift it, and carry it through; ``kind`` sees it."""
    low, high = (-2.0,) * (d - 1) + (-thickness,), (2.0,) * (d - 1) + (0.0,)
    model = pressed(ff.RigidSurface(*box(low, high)), f"{name}{d}_", d, **options)
    for z in (-0.01, 0.3):
        model.place(np.eye(d), way(d, 0.0, z))
        assert model.problem.solve().certified
    kept = model.u.x.array.copy()
    model.place(np.eye(d), way(d, 0.0, -0.9))
    with pytest.raises(ff.StepFailed, match="went through the obstacle"):
        model.problem.solve()
    assert np.array_equal(model.u.x.array, kept)
    monkeypatch.setattr(kind, "crossed", lambda self, closed: np.zeros_like(closed))
    assert model.problem.solve().certified  # the test of crossings alone has seen it


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_a_step_through_a_thin_tool_is_refused(d, monkeypatch):
    refuse_the_way_through(d, SurfacePairing, 0.02, "thin", monkeypatch)


def test_a_tool_whose_faces_are_not_searched_again_is_not_met_rightly(monkeypatch):
    """The search after a solve is needed: without it nodes keep planes that they have left."""
    tool = ff.RigidSurface(*ball(2, 200, center=(0.0, -1.0)))
    found = []
    for searched in (True, False):
        if not searched:
            monkeypatch.setattr(SurfacePairing, "search", lambda self: False)
        model = pressed(tool, f"searched_{searched}_", 2)
        model.place(np.eye(2), (0.2, -0.05))
        assert model.problem.solve().certified
        radius = np.linalg.norm(model.contact.pairing.positions() + [0.0, 1.0], axis=1)
        closed = model.contact.nodal().states() != ff.OPEN
        found.append(np.max(abs(radius[closed] - 1.0)))
    assert found[0] < 1.3e-4 < 1e-3 < found[1]  # the sagitta of a side is 1.2e-4


@pytest.mark.mpi
def test_slivers_as_in_files_from_cad_are_met_as_the_plane():
    """A box of twelve triangles under a fine block, far longer than its facets."""
    flat, tool = (
        pressed(plane(3), "flat_", 3),
        pressed(ff.RigidSurface(*box((-40.0, -0.6, -1.0), (30.0, 0.7, 0.0))), "sliver_", 3),
    )
    for x, z in PATH[:3]:
        for model in (flat, tool):
            model.place(np.eye(3), np.array([x, 0.0, z]))
            assert model.problem.solve().certified
    assert distance(forces(tool), forces(flat)) < 1e-9
    assert tool.contact.pairing.faces.size < 0.5


@pytest.mark.mpi
def test_nodes_that_leave_the_last_face_are_free():
    """A block half over the edge of a box: the nodes beyond have no force."""
    model = pressed(ff.RigidSurface(*box((-5.0, -5.0, -1.0), (0.1, 5.0, 0.0))), "edge_", 3)
    model.place(np.eye(3), way(3, 0.0, -0.05))
    assert model.problem.solve().certified
    x, c = model.contact.surface.x, model.contact.nodal().c
    n = model.contact.surface.num_owned
    assert np.all(c[x[:n, 0] > 0.2, 0] == 0.0) and np.all(c[x[:n, 0] < 0.05, 0] > 0.0)


@pytest.mark.mpi
def test_a_run_goes_on_from_a_checkpoint(tmp_path_factory):
    path = Path(MPI.COMM_WORLD.bcast(str(tmp_path_factory.mktemp("tool")))) / "tool.h5"
    points, faces = ball(3, 1000, center=(0.0, 0.0, -1.0))

    def run(name):
        motions = []

        def make(msh):
            motions.append(ff.RigidMotion(msh, center=(0.0, 0.0, -1.0)))
            return ff.RigidSurface(points, faces, motion=motions[0])

        return pressed(make, name, 3), motions[0]

    def steps(model, motion, path):
        for x, z in path:
            model.place(np.eye(3), way(3, x, z))
            motion.angle.value = 2.0 * x
            assert model.problem.solve().certified
        return forces(model)

    model = run("whole_")
    steps(*model, PATH[:3])
    ff.write_checkpoint(path, model[0].problem)
    expected = steps(*model, [(0.1, -0.1), (0.2, -0.1)])
    again = run("again_")
    ff.read_checkpoint(path, again[0].problem)
    assert distance(steps(*again, [(0.1, -0.1), (0.2, -0.1)]), expected) < 1e-10
