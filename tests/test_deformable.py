"""Contact with the surface of a deformable body, node to face."""

from mpi4py import MPI

import numpy as np
import pytest

import fenicsx_friction as ff
from bodies import stack
from fenicsx_friction.equations import contact_terms
from fenicsx_friction.files.checkpoint import read_checkpoint, write_checkpoint
from fenicsx_friction.obstacles.node_to_face import NodeToFace
from models import gathered, with_contact

FLAT = {
    "quadrilateral": {"upper": (5, 3), "lower": (3, 3), "top": ((0, 1), (1, 2))}
    | {"base": ((0, 0), (1, 1)), "cell": "quadrilateral"},
    "triangle": {"upper": (5, 3), "lower": (3, 3), "top": ((0, 1), (1, 2))}
    | {"base": ((0, 0), (1, 1)), "cell": "triangle"},
    "tetrahedron": {"cell": "tetrahedron"},
    "hexahedron": {},
}

BOTH = pytest.mark.parametrize("method", ["node-to-face", "mortar"])


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
    contact = model.contact
    nodes = np.zeros_like(model.problem.u.x.array).reshape(-1, d)
    n = contact.surface.num_owned
    nodes[contact.parent_dofs[:n]] = contact.nodal_area()[:, None] * contact.nodal_traction()
    bodies = model.problem.terms.momentum()  # residual: minus the forces on both bodies
    bodies = bodies + nodes.ravel()[: len(bodies)]  # on the primary body alone
    n = len(bodies) // d
    x = V.tabulate_dof_coordinates()[:n, :d] + model.problem.u.x.array.reshape(-1, d)[:n]
    f = -bodies.reshape(-1, d)
    arm = x[:, :1] * f[:, 1:2] - x[:, 1:2] * f[:, :1] if d == 2 else np.cross(x, f)
    moment = arm.sum(axis=0)
    comm, contact = model.problem.comm, report.contacts[0]
    assert contact.force[-1] > 1.0
    assert comm.allreduce(f.sum(axis=0)) == pytest.approx(-np.array(contact.force), abs=1e-11)
    assert comm.allreduce(moment) == pytest.approx(-np.array(contact.moment), abs=1e-10)


@pytest.mark.quick
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


@BOTH
@pytest.mark.mpi
def test_turning_both_bodies_turns_the_forces(method):
    """A stuck pair under shear, turned with its supports by 40 degrees in two steps."""
    model = stack(5.0, f"turning_{method}_", upper=(3, 3, 2), lower=(2, 2, 2), method=method)
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
        faces |= set(model.contact.pairing.pairs.face.tolist())
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
    paired = model.problem.comm.allreduce(int(np.sum(model.contact.pairing.pairs.paired)))
    assert 3 <= paired < 15
    assert report.contacts[0].open >= 15 - paired
    assert report.contacts[0].force[2] > 0.0


@BOTH
@pytest.mark.mpi
def test_more_ranks_have_the_same_answer(method):
    """Also where a rank has no node of the one or the other surface."""
    results = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        name = f"ranks_{method}_{comm.size}_{comm is MPI.COMM_WORLD}_"
        model = stack(0.4, name, comm=comm, method=method)
        for x in (0.01, 0.06, 0.2, 0.1):
            model.move(x, 0.5 * x, -0.02)
            model.problem.solve()
        results.append(gathered(model.problem))
    (x, c, u), (y, e, w) = results
    assert x == pytest.approx(y, abs=1e-12)
    assert c == pytest.approx(e, abs=1e-9 * np.max(abs(c)))
    assert u == pytest.approx(w, abs=1e-9 * np.max(abs(u)))


@BOTH
@pytest.mark.mpi
def test_resumed_run_equals_the_uninterrupted_one(tmp_path, comm, method):
    path = comm.bcast(tmp_path) / "pairs.h5"
    steps = [(0.0, -0.02), (0.06, -0.02), (0.2, -0.02), (0.1, -0.03)]
    model = stack(0.4, f"pairs_uninterrupted_{method}_", method=method)
    for k, (x, z) in enumerate(steps):
        model.move(x, 0.0, z)
        model.problem.solve()
        if k == 1:
            write_checkpoint(path, model.problem)
    again = stack(0.4, f"pairs_resumed_{method}_", method=method)
    read_checkpoint(path, again.problem)
    for x, z in steps[2:]:
        again.move(x, 0.0, z)
        again.problem.solve()
    for one, other in zip(gathered(model.problem), gathered(again.problem), strict=True):
        assert other == pytest.approx(one, abs=1e-9 * np.max(abs(one)))


# -- broken on purpose ----------------------------------------------------------------------------


@BOTH
def test_dropped_derivatives_are_seen(method, monkeypatch):
    monkeypatch.setattr(contact_terms, "derivatives_of", without_stencil)
    model = stack(0.5, f"dropped_{method}_", method=method)
    model.move(0.0, 0.0, -0.02)
    assert ff.check_jacobian(model.problem).error > 1e-3


ORIGINAL = contact_terms.derivatives_of


def without_stencil(k, kernel):
    """Drop all derivatives by the positions of the stencil."""
    blocks = ORIGINAL(k, kernel)
    blocks.laws[:, :, : k.pairing.derivatives()[0].shape[2]] = 0.0
    for turned in blocks.turning:
        turned[:] = 0.0
    return blocks


def test_missing_reaction_is_refused(monkeypatch):
    """Newton without the force on the base finds a state of the block alone."""
    add_residual, weights = contact_terms.ContactTerms.add_residual, NodeToFace.weights

    def alone(self):
        """No share of the force for the faces."""
        shares = weights(self)
        shares[:, 1:] = 0.0
        return shares

    def forgetful(self, b, law):
        """Forget the reaction in the residual, but not for the certificate."""
        with monkeypatch.context() as patch:
            patch.setattr(NodeToFace, "weights", alone)
            add_residual(self, b, law)

    model = stack(0.5, "no_reaction_", fallbacks=0)
    model.move(0.0, 0.0, -0.02)
    monkeypatch.setattr(contact_terms.ContactTerms, "add_residual", forgetful)
    with pytest.raises(ff.StepFailed) as failure:
        model.problem.solve()
    assert failure.value.report.certificate.relative > 1e-3
    monkeypatch.undo()
    assert model.problem.solve().certified


# -- bad input ------------------------------------------------------------------------------------


def test_an_obstacle_serves_any_number_of_contacts():
    """Of two problems that take turns, each keeps its own pairs."""
    model, other = stack(0.5, "shared_"), stack(0.5, "own_")
    contact = ff.Contact(model.contact.surface, model.contact.obstacle, ff.Coulomb(0.5))
    again = with_contact(model, contact, "shared_again_")
    for x, z in ((0.0, -0.01), (0.3, -0.01)):
        for one in (model, other):
            one.move(x, 0.0, z)
        model.problem.u.x.array[:] = again.u_old.x.array
        forces = [p.solve().contacts[0].force for p in (again, other.problem)]
        assert forces[0] == pytest.approx(forces[1], rel=1e-9)
    assert not np.array_equal(contact.pairing.pairs.face, model.contact.pairing.pairs.face)


def test_a_coarse_secondary_surface_is_warned_about():
    with pytest.warns(UserWarning, match=r"coarser .* swap them"):
        stack(0.5, "coarse_", upper=(2, 2, 1), lower=(4, 4, 1))
