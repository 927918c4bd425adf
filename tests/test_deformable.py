"""Contact with the surface of a deformable body, node to face."""

from mpi4py import MPI

import numpy as np
import pytest

import fenicsx_friction as ff
from bodies import stack
from fenicsx_friction import coupling
from fenicsx_friction.checkpoint import read_checkpoint, write_checkpoint
from fenicsx_friction.face_cells import FACE_CELLS, blend, normals, project, shape_matrix
from fenicsx_friction.pair_kernel import PairGeometry, PairKernel
from models import gathered

CORNERS = {
    "interval": [[0.0, 0.0], [1.0, 0.2]],
    "triangle": [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.2, 0.9, 0.3]],
    "quadrilateral": [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.1, 0.9, 0.3], [1.2, 1.1, -0.2]],
}
#: In the face, on an edge, at a corner and beyond an edge.
PLACES = {"interval": [[0.3], [0.0], [1.0], [1.1]]}
PLACES["triangle"] = PLACES["quadrilateral"] = [[0.3, 0.4], [0.0, 0.5], [0.0, 0.0], [-0.1, 0.3]]
FLAT = {
    "quadrilateral": {"upper": (5, 3), "lower": (3, 3), "top": ((0, 1), (1, 2))}
    | {"base": ((0, 0), (1, 1)), "cell": "quadrilateral"},
    "triangle": {"upper": (5, 3), "lower": (3, 3), "top": ((0, 1), (1, 2))}
    | {"base": ((0, 0), (1, 1)), "cell": "triangle"},
    "tetrahedron": {"cell": "tetrahedron"},
    "hexahedron": {},
}


# -- the contact element --------------------------------------------------------------------------


def elements(kind):
    """Return a kernel and one element at each of the places, a bit off the face."""
    cell, rng = FACE_CELLS[kind], np.random.default_rng(1)
    face, xi = np.array(CORNERS[kind]), np.array(PLACES[kind])
    n, d = len(xi), face.shape[1]
    faces = np.tile(face, (n, 1, 1))
    x = blend(shape_matrix(cell, xi), faces) + 0.05 * normals(cell, faces, xi)
    old = faces + 0.1 * rng.standard_normal(faces.shape)
    z = np.concatenate([x[:, None], faces, old], axis=1)
    hint = np.tile(np.eye(d)[0], (n, 1))
    weights = shape_matrix(cell, rng.uniform(0.0, 1.0, xi.shape))
    return PairKernel(MPI.COMM_SELF, cell, d, n), PairGeometry(z, xi, weights, hint)


@pytest.mark.parametrize("kind", FACE_CELLS)
def test_projection_finds_the_foot_of_the_perpendicular(kind):
    _, geometry = elements(kind)
    cell = FACE_CELLS[kind]
    found = project(cell, geometry.z[:, 1 : 1 + cell.nodes], geometry.z[:, 0])
    assert found == pytest.approx(geometry.xi, abs=1e-12)


@pytest.mark.parametrize("kind", FACE_CELLS)
def test_element_has_the_gap_and_the_normal_it_was_made_with(kind):
    kernel, geometry = elements(kind)
    values, d, cell = kernel.values(geometry), geometry.z.shape[2], FACE_CELLS[kind]
    assert values[:, 0] == pytest.approx(0.05)
    expected = normals(cell, geometry.z[:, 1 : 1 + cell.nodes], geometry.xi)
    assert values[:, 1 + d : 1 + 2 * d] == pytest.approx(expected, abs=1e-13)
    assert values[:, -cell.nodes :] == pytest.approx(shape_matrix(cell, geometry.xi), abs=1e-13)


@pytest.mark.parametrize("kind", FACE_CELLS)
def test_derivatives_of_the_element_are_those_of_the_projection(kind):
    """Central differences with the projection found anew, on faces, edges, corners, beyond."""
    kernel, geometry = elements(kind)
    cell, h = FACE_CELLS[kind], 1e-6

    def values(z):
        xi = project(cell, z[:, 1 : 1 + cell.nodes], z[:, 0], geometry.xi)
        return kernel.values(PairGeometry(z, xi, geometry.old, geometry.hint))

    n, points, d = geometry.z.shape
    exact = kernel.derivatives(geometry).reshape(n, -1, points, d)
    for point in range(points):
        for axis in range(d):
            step = np.zeros_like(geometry.z)
            step[:, point, axis] = h
            difference = (values(geometry.z + step) - values(geometry.z - step)) / (2.0 * h)
            assert difference == pytest.approx(exact[:, :, point, axis], abs=1e-8)


def turned(z, angle=0.7):
    """Turn positions (in the plane of the first two axes) and shift them."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(z.shape[-1])
    R[:2, :2] = [[c, -s], [s, c]]
    return z @ R.T + 3.0, R


@pytest.mark.parametrize("kind", FACE_CELLS)
def test_a_common_rigid_motion_neither_opens_nor_slides(kind):
    """The old point moves with the face: the way turns with it, the gap stays."""
    kernel, geometry = elements(kind)
    z, R = turned(geometry.z)
    before, d = kernel.values(geometry), z.shape[2]
    hint = geometry.hint @ R.T
    after = kernel.values(PairGeometry(z, geometry.xi, geometry.old, hint))
    vectors = 1 + d * d
    assert after[:, 0] == pytest.approx(before[:, 0], abs=1e-13)
    turned_before = before[:, 1:vectors].reshape(len(z), d, d) @ R.T
    assert after[:, 1:vectors] == pytest.approx(turned_before.reshape(len(z), -1), abs=1e-12)


# -- two blocks -----------------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("kind", FLAT)
def test_jacobian_of_two_bodies(kind):
    model = stack(0.5, f"pair_jacobian_{kind}_", **FLAT[kind])
    d = model.problem.u.function_space.mesh.geometry.dim
    for x in (0.03, 0.05, 0.12):
        model.move(x, *([0.01] * (d - 2)), -0.02)
        if x < 0.1:
            assert model.problem.solve().certified
    assert ff.check_jacobian(model.problem).error < 1e-6


@pytest.mark.mpi
@pytest.mark.parametrize("kind", FLAT)
def test_action_equals_reaction(kind):
    """In force and moment, stick and slip, at finite strain."""
    model = stack(0.4, f"reaction_{kind}_", **FLAT[kind])
    V = model.problem.u.function_space
    d = V.mesh.geometry.dim
    for x in (0.01, 0.2):
        model.move(x, *([0.05] * (d - 2)), -0.03)
        report = model.problem.solve()
    bodies = model.problem.coupling.momentum()  # residual: minus the force on the primary body
    n = len(bodies) // d
    x = V.tabulate_dof_coordinates()[:n, :d] + model.problem.u.x.array.reshape(-1, d)[:n]
    f = -bodies.reshape(-1, d)
    arm = x[:, :1] * f[:, 1:2] - x[:, 1:2] * f[:, :1] if d == 2 else np.cross(x, f)
    moment = arm.sum(axis=0)
    comm, contact = model.problem.comm, report.contacts[0]
    assert contact.force[-1] > 1.0
    assert comm.allreduce(f.sum(axis=0)) == pytest.approx(-np.array(contact.force), abs=1e-11)
    assert comm.allreduce(moment) == pytest.approx(-np.array(contact.moment), abs=1e-10)


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron", "quadrilateral"])
def test_patch_test_with_matching_faces_is_exact(cell):
    """E = 2e6, nu = 0, pushed by -0.1 of a height of 2: p = 1e5 (code_aster SSNP121)."""
    plane = cell == "quadrilateral"
    shape = dict(FLAT[cell]) if plane else {"cell": cell}
    n = (3, 3) if plane else (3, 3, 3)
    shape |= {"upper": n, "lower": n}
    model = stack(ff.Frictionless(), f"patch_{cell}_", E=2e6, nu=0.0, energy="small", **shape)
    model.move(*([0.0] * (len(n) - 1)), -0.1)
    assert model.problem.solve().certified
    _, c, u = gathered(model.problem)
    assert c[:, 0] == pytest.approx(1e5, rel=1e-10)
    assert u[:, -1] == pytest.approx(-0.05, rel=1e-10)


@pytest.mark.parametrize(
    ("upper", "lower", "worst", "mean"),
    [((3, 3), (2, 2), 0.19, 0.10), ((4, 4), (3, 3), 0.16, 0.07), ((8, 8), (4, 4), 1e-10, 1e-10)],
)
def test_patch_test_with_faces_that_do_not_match(upper, lower, worst, mean):
    """Single-pass node-to-face passes it on nested faces only; documented by how much."""
    shape = {"upper": (*upper, 4), "lower": (*lower, 4), "energy": "small"}
    model = stack(ff.Frictionless(), f"patch_off_{upper[0]}_", E=2e6, nu=0.0, **shape)
    model.move(0.0, 0.0, -0.1)
    report = model.problem.solve()
    _, c, _ = gathered(model.problem)
    error = abs(c[:, 0] / 1e5 - 1.0)
    assert np.max(error) < worst
    assert np.mean(error) < mean
    assert report.contacts[0].force[2] == pytest.approx(1e5, rel=0.006)


@pytest.mark.mpi
def test_turning_both_bodies_turns_the_forces():
    """A stuck pair under shear, turned with its supports by 40 degrees in two steps."""
    model = stack(5.0, "turning_", upper=(3, 3, 2), lower=(2, 2, 2))
    model.move(0.01, 0.0, -0.02)
    before = model.problem.solve().contacts[0]
    assert before.stick == 16
    X = model.problem.u.function_space.tabulate_dof_coordinates()
    sheared = np.array([0.01, 0.0, -0.02])
    for angle in np.radians([20.0, 40.0]):
        c, s = np.cos(angle), np.sin(angle)
        R = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        for f, shift in ((model.bottom, np.zeros(3)), (model.top, sheared)):
            f.x.array[:] = ((X + shift) @ R.T - X).ravel()
        report = model.problem.solve()
        after = report.contacts[0]
        assert after.stick == 16
        expected = R @ np.array(before.force)
        assert after.force == pytest.approx(expected, abs=1e-10 * np.linalg.norm(expected))
        assert abs(after.dissipation) < 1e-12


@pytest.mark.mpi
@pytest.mark.parametrize("comm", [MPI.COMM_SELF, MPI.COMM_WORLD], ids=["self", "world"])
def test_slip_crosses_faces(comm):
    """The path is the way of the node over the base, however many faces and steps it takes."""
    model = stack(
        0.1,
        f"crossing_{comm.size}_{comm is MPI.COMM_WORLD}_",
        upper=(3, 3, 1),
        lower=(8, 4, 1),
        top=((0.0, 0.3, 1.0), (0.4, 0.7, 1.4)),
        base=((0.0, 0.0, 0.0), (2.0, 1.0, 1.0)),
        E=(1e3, 1e7),
        comm=comm,
    )
    model.move(0.0, 0.0, -0.02)
    model.problem.solve()
    faces = set()
    for x in np.linspace(0.1, 1.2, 6):
        model.move(x, 0.0, -0.02)
        report = model.problem.solve()
        assert report.contacts[0].slip == 16
        faces |= set(model.contact.obstacle.pairs.face.tolist())
    assert len(set().union(*comm.allgather(faces))) > 8
    path = model.contact.path.x.array
    # Rigid sliding but for the lag of the elastic block, mu p h / G of the way.
    assert np.all(abs(path - 1.2) < 0.02)


@pytest.mark.mpi
def test_nodes_that_slide_off_the_edge_are_let_go():
    model = stack(
        0.1,
        "edge_",
        upper=(4, 2, 1),
        lower=(2, 2, 1),
        top=((0.0, 0.25, 1.0), (0.5, 0.75, 1.5)),
        E=(1e3, 1e6),
    )
    model.move(0.0, 0.0, -0.01)
    assert model.problem.solve().contacts[0].open == 0
    for x in np.linspace(0.1, 0.8, 8):
        model.move(x, 0.0, -0.01)
        report = model.problem.solve()
    paired = model.problem.comm.allreduce(int(np.sum(model.contact.obstacle.pairs.paired)))
    assert 3 <= paired < 15
    assert report.contacts[0].open >= 15 - paired
    assert report.contacts[0].force[2] > 0.0


@pytest.mark.mpi
def test_more_ranks_have_the_same_answer():
    """Also where a rank has no node of the one or the other surface."""
    results = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        model = stack(0.4, f"ranks_{comm.size}_{comm is MPI.COMM_WORLD}_", comm=comm)
        for x in (0.01, 0.06, 0.2, 0.1):
            model.move(x, 0.5 * x, -0.02)
            model.problem.solve()
        results.append(gathered(model.problem))
    (x, c, u), (y, e, w) = results
    assert x == pytest.approx(y, abs=1e-12)
    assert c == pytest.approx(e, abs=1e-9 * np.max(abs(c)))
    assert u == pytest.approx(w, abs=1e-9 * np.max(abs(u)))


@pytest.mark.mpi
def test_resumed_run_equals_the_uninterrupted_one(tmp_path, comm):
    path = comm.bcast(tmp_path) / "pairs.h5"
    steps = [(0.0, -0.02), (0.06, -0.02), (0.2, -0.02), (0.1, -0.03)]
    model = stack(0.4, "pairs_uninterrupted_")
    for k, (x, z) in enumerate(steps):
        model.move(x, 0.0, z)
        model.problem.solve()
        if k == 1:
            write_checkpoint(path, model.problem)
    again = stack(0.4, "pairs_resumed_")
    read_checkpoint(path, again.problem)
    for x, z in steps[2:]:
        again.move(x, 0.0, z)
        again.problem.solve()
    for one, other in zip(gathered(model.problem), gathered(again.problem), strict=True):
        assert other == pytest.approx(one, abs=1e-9 * np.max(abs(one)))


# -- closed forms ---------------------------------------------------------------------------------


def faces_of_base(x):
    """Mark what the block of :func:`on_base` does not share: all nodes of a base of (2, 1, 1)."""
    return np.isclose(x[2], 0.5) & ~((x[0] > 0.3) & (x[0] < 1.1) & (x[1] > 0.1) & (x[1] < 0.9))


def on_base(prefix, E, lower=(3, 2, 1), hold=None, obstacle=None):
    """Return a block on a base, ``mu = 0.3``."""
    top, base = ((0.4, 0.2, 0.5), (1.0, 0.8, 1.1)), ((0.0, 0.0, 0.0), (2.0, 1.0, 0.5))
    bodies = {"upper": (2, 2, 2), "lower": lower, "top": top, "base": base}
    return stack(0.3, prefix, E=E, hold=hold, obstacle=obstacle, **bodies)


@pytest.mark.parametrize(("base", "rel"), [(1e7, 2e-4), (1e8, 2e-4), ("rigid", 2e-7)])
def test_incline(base, rel):
    """NAFEMS CGS-4, tan a = 0.1, mu = 0.3: F/G = (tan a + mu)/(1 - mu tan a) = 0.412371.

    As the block widens, its nodes do not slip quite along the slope: less than 1e-7.
    """
    slope, mu = 0.1, 0.3
    if base == "rigid":
        held = [(faces_of_base, k) for k in range(3)]
        model = on_base("incline_rigid_", 1e7, (2, 1, 1), held)
    else:
        model = on_base(f"incline_{base:g}_", base)
    # The block is dragged down the plane's x axis by its top: forces turned to the slope.
    model.move(0.0, 0.0, -1e-3)
    model.problem.solve()
    model.move(0.2, 0.0, -1e-3)
    report = model.problem.solve()
    assert report.contacts[0].stick + report.contacts[0].open == 0
    tangential, _, normal = report.contacts[0].force
    a = np.arctan(slope)
    push = np.array([np.cos(a), -np.sin(a)])  # horizontal, in axes along and normal to the plane
    weight = np.array([-np.sin(a), -np.cos(a)])
    F, G = np.linalg.solve(np.column_stack([push, weight]), [-tangential, -normal])
    assert F / G == pytest.approx((slope + mu) / (1.0 - mu * slope), rel=rel)


def test_a_held_base_is_a_rigid_plane():
    """The contact element on flat faces against the kinematics of a rigid plane in UFL."""
    held = [(faces_of_base, k) for k in range(3)]
    element = on_base("held_base_", 1e3, (2, 1, 1), held)
    plane = on_base("rigid_plane_", 1e3, (2, 1, 1), held, ff.RigidPlane((0, 0, 0.5), (0, 0, 1)))
    for way in ((0.0, 0.0, -0.01), (0.005, 0.0, -0.02), (0.1, 0.05, -0.02), (0.05, 0.0, -0.01)):
        results = []
        for model in (element, plane):
            model.move(*way)
            results.append((model.problem.solve().contacts[0], gathered(model.problem)))
        (one, (_, c, u)), (other, (_, e, w)) = results
        assert (one.open, one.stick, one.slip) == (other.open, other.stick, other.slip)
        assert u == pytest.approx(w, abs=1e-11)
        assert c == pytest.approx(e, abs=1e-9 * np.max(abs(e)))


@pytest.mark.parametrize(("way", "slides"), [(0.5, False), (3.0, True)])
def test_threshold_of_sliding(way, slides):
    """A block dragged by its top on a deformable base: below mu N it holds, then slides at mu N."""
    mu, G, depth = 0.3, 1e3 / 2.0, 0.01
    model = stack(mu, f"threshold_{way}_", nu=0.0, E=(1e3, 1e6))
    model.move(0.0, 0.0, -depth)
    normal = model.problem.solve().contacts[0].force[2]
    model.move(way * mu * normal / G, 0.0, -depth)
    states = model.problem.solve().contacts[0]
    friction = abs(states.force[0]) / states.force[2]
    if slides:
        assert (states.open, states.stick) == (0, 0)
        assert friction == pytest.approx(mu, rel=1e-3)  # of a base that is not quite flat
    else:
        assert states.stick > 0
        assert friction < 0.9 * mu


@pytest.mark.parametrize("law", [ff.Frictionless(), ff.Coulomb(0.0), ff.Coulomb(0.3)])
def test_the_stick_predictor_holds_only_what_has_friction(law):
    """What slides freely on one thing and sticks to another would be held twice."""
    model = stack(law, f"predictor_{law}_".replace(" ", ""))
    model.move(0.01, 0.0, -0.02)
    assert model.problem.run(model.problem.stick, 1e-8, max_it=30).converged
    tangential = abs(model.contact.nodal().c[:, 1:])
    held = law == ff.Coulomb(0.3)
    assert np.max(tangential) > 1.0 if held else np.max(tangential) < 1e-12


# -- broken on purpose ----------------------------------------------------------------------------


def test_dropped_derivatives_are_seen(monkeypatch):
    monkeypatch.setattr(coupling, "_element_matrices", lambda pair, law: 0.0 * ORIGINAL(pair, law))
    model = stack(0.5, "dropped_")
    model.move(0.0, 0.0, -0.02)
    assert ff.check_jacobian(model.problem).error > 1e-3


ORIGINAL = coupling._element_matrices


def test_missing_reaction_is_refused(monkeypatch):
    """Without the force on the base, equilibrium of the block alone must not pass."""
    model = stack(0.5, "no_reaction_")
    model.move(0.0, 0.0, -0.02)
    assert model.problem.solve().certified
    force = np.array(model.problem.contact_reports()[0].force)
    monkeypatch.setattr(coupling.Coupling, "_add_forces", lambda self, vector, targets: None)
    assert model.problem.certify().equilibrium > 0.01 * np.linalg.norm(force)


# -- bad input ------------------------------------------------------------------------------------


def test_an_obstacle_serves_one_contact():
    model = stack(0.5, "shared_")
    with pytest.raises(ff.ContactInputError, match="already belongs to a contact"):
        ff.FrictionalContactProblem(
            model.problem.bulk,
            model.problem.u,
            contact=ff.Contact(model.contact.surface, model.contact.obstacle, ff.Frictionless()),
            petsc_options_prefix="shared_again_",
        )


def test_a_coarse_secondary_surface_is_warned_about():
    with pytest.warns(UserWarning, match=r"coarser .* swap them"):
        stack(0.5, "coarse_", upper=(2, 2, 1), lower=(4, 4, 1))
