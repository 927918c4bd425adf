"""Steps with several exact solutions: all are found, the nearest one is taken, the user is told."""

import warnings

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.increment import advance, correctors, others, trial
from models import raous, tagged_facets

#: A sheared triangle: its free corner stands on the plane y = 0, the others are held.
CORNERS = np.array([[0.0, 0.0], [1.0, 2.0], [2.5, 1.0]])
AREA = 2.0


def corner(mu, ratio, prefix, **settings):
    """Load the corner of the triangle: a force of 1 N down, and ``ratio`` along the plane.

    Returns the problem, the force, and the compliance of the corner (m/N).
    """
    domain = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    first = MPI.COMM_WORLD.rank == 0
    cells = np.array([[0, 1, 2]] if first else np.zeros((0, 3)), dtype=np.int64)
    msh = mesh.create_mesh(MPI.COMM_WORLD, cells, domain, CORNERS[: 3 * first])
    # The lower one of the two facets at the corner.
    tags = tagged_facets(msh, lambda x: abs(x[1] - x[0] / 2.5) < 1e-9)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    energy = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E=100.0, nu=0.3))
    stored = ufl.derivative(ff.bulk.stored_energy(energy, ufl.dx), u, v)
    force = np.array([ratio, -1.0])
    body = fem.Constant(msh, 3.0 * force / AREA)  # a third of the area's load is the corner's
    held = fem.locate_dofs_geometrical(V, lambda x: x[1] > 0.5)
    problem = ff.FrictionalContactProblem(
        stored - ufl.inner(body, v) * ufl.dx,
        u,
        contact=ff.Contact(
            ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0.0, 0.0), (0.0, 1.0)), ff.Coulomb(mu)
        ),
        bcs=[fem.dirichletbc(np.zeros(2), held, V)],
        petsc_options_prefix=prefix,
        settings=ff.StepSettings(**settings),
    )
    tangent = fem.assemble_matrix(fem.form(ufl.derivative(stored, u))).to_dense()
    dofs = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 0.0))
    own = (2 * dofs[:, None] + np.arange(2)).ravel()
    parts = MPI.COMM_WORLD.allgather(tangent[np.ix_(own, own)])  # one rank has the cell
    return problem, force, np.linalg.inv(next(part for part in parts if part.size))


@pytest.fixture(scope="module")
def wedged():
    """The force that sticks and lifts, its friction, and the lift (m), in closed form.

    Lifted, the corner moves by ``C f``, upwards if the tangential force is large enough.
    """
    _, _, C = corner(1.0, 1.0, "compliance_")
    ratio = -1.5 * C[1, 1] / abs(C[1, 0]) * -np.sign(C[1, 0])
    force = np.array([ratio, -1.0])
    assert (C @ force)[1] > 0.0
    return ratio, 1.3 * abs(ratio), C @ force


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("solver", ["condensed", "full"])
def test_a_corner_that_may_stick_or_lift(wedged, solver):
    ratio, mu, lift = wedged
    settings = {"solver": solver, "look_for_others": True}
    problem, force, _ = corner(mu, ratio, f"several_{solver}_", **settings)
    with pytest.warns(UserWarning, match="has at least 2 certified solutions, up to"):
        report = problem.solve()
    # The nearest one: nothing moves, and the plane carries all of the load.
    assert report.certified
    assert report.contacts[0].force == pytest.approx(tuple(-force), rel=1e-9)
    assert np.max(abs(problem.u.x.array), initial=0.0) < 1e-12 * np.linalg.norm(lift)
    (other,) = report.others
    assert (other.contacts[0].open, other.contacts[0].stick, other.contacts[0].slip) == (1, 0, 0)
    assert other.contacts[0].force == pytest.approx((0.0, 0.0), abs=1e-12)
    assert other.force_difference == pytest.approx(np.linalg.norm(force), rel=1e-9)


@pytest.mark.mpi
def test_the_solution_nearest_to_the_last_state_is_taken(wedged, monkeypatch):
    """Whichever is found first: here the lifted one, which is that without friction."""
    ratio, mu, _ = wedged
    problem, force, _ = corner(mu, ratio, "nearest_", look_for_others=True)
    monkeypatch.setattr(advance, "_first", lambda *_: (None, others.Attempt("friction")))
    with pytest.warns(UserWarning, match="certified solutions"):
        report = problem.solve()
    assert report.certified
    assert report.contacts[0].force == pytest.approx(tuple(-force), rel=1e-9)
    assert [o.contacts[0].open for o in report.others] == [1]


def test_no_search_unless_asked_for_or_with_much_friction(wedged, monkeypatch):
    ratio, mu, _ = wedged

    def substeps(prefix, **settings):
        report = corner(mu, ratio, prefix, **settings)[0].solve()
        return len(report.substeps + report.searched)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert mu < others.MUCH_FRICTION
        once = substeps("quiet_")
        monkeypatch.setattr(others, "MUCH_FRICTION", 0.9 * mu)
        assert substeps("off_", look_for_others=False) == once
        assert substeps("whole_", solver="full") == once
        assert substeps("much_") == once + 1  # from the last state, without a predictor


def test_one_solution_is_no_several():
    """Where the load presses the corner down, no other is made up."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = corner(0.5, 0.1, "one_", look_for_others=True)[0].solve()
    assert report.certified and report.others == ()
    assert len(report.searched) > 4  # it has looked


def test_two_solutions_of_a_rectangle():
    """Raous' history at mu = 10: reversing the lateral pressure, two states are exact."""
    model = raous(32, 32, 10.0, "raous_several_")
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for load in ((0.3, 0.6), (0.7, 0.8), (1.0, 1.0), (0.6, 1.0), (0.1, 1.0)):
            model.load(*load)
            found.append(model.problem.solve())
    assert all(report.certified for report in found)
    assert [len(report.others) for report in found] == [0, 0, 0, 0, 1]
    assert found[-1].others[0].traction_difference > 1e6


# -- what the search must not change ---------------------------------------------------------------


@pytest.mark.parametrize("error", [ff.OutOfMemory("memory"), ff.ContactInputError("input")])
def test_an_error_of_the_search_loses_nothing(wedged, error, monkeypatch):
    ratio, mu, _ = wedged
    expected = corner(mu, ratio, "undisturbed_")[0].solve()
    problem, _, _ = corner(mu, ratio, "disturbed_", look_for_others=True)
    solved = []

    def once(*arguments, **options):
        if solved:
            raise error
        solved.append(correctors.correct(*arguments, **options))
        return solved[0]

    monkeypatch.setattr(trial, "correct", once)
    report = problem.solve()
    assert report.certified and problem.num_steps == 1
    assert report.contacts[0].force == pytest.approx(expected.contacts[0].force, rel=1e-12)


def test_a_warning_made_an_error_leaves_the_step_accepted(wedged):
    ratio, mu, _ = wedged
    problem, _, _ = corner(mu, ratio, "strict_", look_for_others=True)
    with warnings.catch_warnings(), pytest.raises(UserWarning, match="certified solutions"):
        warnings.simplefilter("error")
        problem.solve()
    assert problem.num_steps == 1 and problem.certify().certified


def test_steps_are_as_large_as_without_a_search():
    times = []
    for look in (False, True):
        model = raous(6, 6, 0.4, f"sizes_{look}_", look_for_others=look)
        path = ff.LoadStepper(
            model.problem, lambda t, m=model: m.load(t, t), end=1.0, step=0.05, largest=0.5
        )
        times.append([record.time for record in path])
    assert times[0] == times[1] and len(times[0]) < 12
