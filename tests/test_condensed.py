"""A linear bulk is factored once; contact is solved on its boundary, with the same result."""

from mpi4py import MPI
from petsc4py import PETSc

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import stack
from both_ways import compare
from fenicsx_friction.equations.contact_terms import ContactTerms
from fenicsx_friction.solvers import schur
from fenicsx_friction.solvers.boundary_matrix import BoundaryMatrix
from fenicsx_friction.solvers.bulk_tangent import BulkTangent
from fenicsx_friction.solvers.condensed_bulk import CondensedBulk
from models import block, by_place, raous, tagged_facets, with_contact

BLOCK = [(0.0, 0.0, -0.01), (0.004, 0.002, -0.01), (-0.004, 0.001, -0.012), (0.0, 0.0, 0.01)]
STACK = [(0.0, 0.0, -0.01), (0.01, 0.005, -0.012), (0.0, 0.0, -0.01)]
RAOUS = [(0.5, 0.5), (1.0, 1.0), (1.0, 0.4), (0.2, 0.2)]


# -- the same result ---------------------------------------------------------------------------


@pytest.mark.quick
@pytest.mark.parametrize("mu", [0.0, 0.3, 1.0, 5.0])
@pytest.mark.parametrize("corrector", [pytest.param("projection", marks=pytest.mark.mpi), "ramp"])
def test_rectangle(mu, corrector):
    """The bulk would fall without its contact."""
    reports = compare(lambda p: raous(8, 8, mu, p, corrector=corrector), RAOUS)
    assert [r.factorisations for r in reports] == [1, 0, 0, 0]


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_block(cell):
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    reports = compare(lambda p: block(cell, 0.3, p, rotation=turned), BLOCK)
    assert reports[1].contacts[0].slip > 0 and reports[3].contacts[0].open > 0
    assert sum(r.factorisations for r in reports) == 1


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_two_bodies(cell):
    """Pairs change on the way; the dofs of both surfaces stay."""
    reports = compare(lambda p: stack(0.3, p, cell=cell, energy="small"), STACK)
    assert sum(r.factorisations for r in reports) == 1


def test_without_mumps_interface(monkeypatch):
    monkeypatch.setattr(schur, "_petsc", lambda: None)
    made, original = [], schur._ByBackSolves.__init__

    def counted(self, *arguments):
        made.append(self)
        original(self, *arguments)

    monkeypatch.setattr(schur._ByBackSolves, "__init__", counted)
    compare(lambda p: raous(8, 8, 1.0, p), RAOUS)
    assert len(made) == 1


# -- one factorisation -------------------------------------------------------------------------


def factorisations():
    """Return how many numerical factorisations PETSc has made so far, of any kind."""
    names = ("MatLUFactorNum", "MatCholFctrNum")
    return sum(PETSc.Log.Event(name).getPerfInfo()["count"] for name in names)


def test_the_bulk_is_factored_once():
    PETSc.Log.begin()
    model = block("hexahedron", 0.3, "once_")
    counts = []
    for position in BLOCK:
        before = factorisations()
        model.move(*position)
        assert model.problem.solve().solver == "condensed"
        counts.append(factorisations() - before)
    assert counts == [1, 0, 0, 0]
    model.problem.settings = ff.StepSettings(solver="full")
    before = factorisations()
    model.move(*BLOCK[0])
    report = model.problem.solve()
    assert factorisations() - before == report.iterations > 1  # the count counts


# -- never with an old factor ------------------------------------------------------------------


def stiffened(model):
    """Change the modulus of a block, a field."""
    (young,) = (
        f
        for f in ufl.algorithms.extract_coefficients(model.problem.bulk)
        if f.function_space.element.basix_element.degree == 0
    )
    young.x.array[:] *= 2.0


def stretched(model):
    """Move the mesh of a block, whose bottom stays."""
    model.problem.u.function_space.mesh.geometry.x[:, 2] *= 1.5


@pytest.mark.parametrize("change", [stiffened, stretched])
@pytest.mark.parametrize("overlooked", [False, True])
def test_a_changed_bulk_is_factored_again_or_not_believed(change, overlooked, monkeypatch):
    force = []
    for solver in ("auto", "full"):
        model = block("hexahedron", 0.3, f"changed_{solver}_", solver=solver)
        model.move(*BLOCK[0])
        model.problem.solve()
        change(model)
        if overlooked:
            monkeypatch.setattr(
                BulkTangent, "_dependencies", lambda self: getattr(self, "_made_of", [])
            )
        model.move(*BLOCK[1])
        report = model.problem.solve()
        assert report.certified
        force.append(report.contacts[0].force)
        if solver == "auto":
            assert report.solver == ("full" if overlooked else "condensed")
            assert report.factorisations == (0 if overlooked else 1)
    assert force[0] == pytest.approx(force[1], rel=1e-9, abs=1e-9 * abs(force[1][2]))


def negative(S):
    return -S


def one_entry(S):
    S[0, 0] *= 1.0 + 1e-4
    return S


@pytest.mark.parametrize("spoil", [negative, one_entry, np.zeros_like])
def test_a_wrong_schur_complement_is_not_believed(spoil, monkeypatch):
    original = CondensedBulk._factored

    def wrong(self, options):
        factor = original(self, options)
        factor.schur = spoil(factor.schur)
        return factor

    monkeypatch.setattr(CondensedBulk, "_factored", wrong)
    found = []
    for solver in ("auto", "full"):
        model = raous(8, 8, 0.1, f"spoilt_{solver}_", solver=solver)
        model.load(1.0, 1.0)
        report = model.problem.solve()
        assert report.certified and report.solver == "full"
        found.append(report.contacts[0].force)
    assert found[0] == pytest.approx(found[1], rel=1e-9, abs=1e-9)


# -- where it is not possible ------------------------------------------------------------------


def test_another_linear_solver_of_the_user_is_taken():
    model = block("hexahedron", 0.3, "own_")
    contact = ff.Contact(model.contact.surface, model.contact.obstacle, ff.Coulomb(0.3))
    problem = with_contact(model, contact, "own_", petsc_options={"ksp_type": "gmres"})
    model.move(*BLOCK[0])
    assert problem.solve().solver == "full"


def test_a_bulk_that_contact_heats_is_solved_as_a_whole():
    """Terms with the contact traction in the user's forms depend on the iterate."""
    model = raous(4, 4, 0.3, "heats_")
    contact = ff.Contact(model.contact.surface, model.contact.obstacle, ff.Coulomb(0.3))
    v = model.problem.bulk.arguments()[0]
    drag = 1e-3 * contact.c[1] * v[0] * contact.surface.measure()
    problem = ff.FrictionalContactProblem(
        model.problem.bulk - drag,
        model.problem.u,
        contact=contact,
        bcs=model.problem.bcs,
        petsc_options_prefix="heated_",
        entity_maps=[contact.surface.entity_map],
    )
    model.load(1.0, 1.0)
    assert {substep.solver for substep in problem.solve().substeps} == {"full"}
    problem.settings = ff.StepSettings(solver="condensed")
    with pytest.raises(ff.ContactInputError, match="the bulk depends on the contact"):
        problem.solve()


# -- what an attack found ----------------------------------------------------------------------


def test_a_held_body_that_moves_is_met():
    """Its nodes get their values before the solve; the state is then not its own solution."""

    def make(prefix):
        def warp(x):
            x = x.copy()
            base = x[1] <= 1.0 + 1e-9
            x[1] += np.where(base, np.where(x[0] < -0.4, 0.12, 0.0) * x[1], 0.05)
            return x

        model = stack(
            0.3,
            f"{prefix}first_",
            cell="quadrilateral",
            upper=(4, 2),
            lower=(12, 2),
            top=((0.0, 1.0), (1.0, 2.0)),
            base=((-2.0, 0.0), (2.0, 1.0)),
            energy="small",
            warp=warp,
        )
        V = model.problem.u.function_space
        cells = np.arange(V.mesh.topology.index_map(2).size_local, dtype=np.int32)
        low = mesh.compute_midpoints(V.mesh, 2, cells)[:, 1] < 1.02
        V.mesh.topology.create_connectivity(2, 2)
        base = fem.locate_dofs_topological(V, 2, cells[low | (cells < 24)])
        contact = ff.Contact(model.contact.surface, model.contact.obstacle, ff.Coulomb(0.3))
        bcs = [fem.dirichletbc(model.bottom, base), model.problem.bcs[0]]
        return model, with_contact(model, contact, prefix, bcs=bcs)

    forces = []
    for solver in ("auto", "full"):
        model, problem = make(f"bump_{solver}_")
        problem.settings = ff.StepSettings(solver=solver)
        assert problem.solve().contacts[0].force == (0.0, 0.0)
        model.bottom.x.array[::2] = 0.6
        report = problem.solve()
        assert report.certified and report.solver == {"auto": "condensed"}.get(solver, solver)
        forces.append(report.contacts[0].force)
    assert forces[0] == pytest.approx(forces[1], rel=1e-9)
    assert forces[0][1] > 1.0


@pytest.mark.parametrize("where", ["residuals", "matrices", "solve"])
def test_after_an_interrupt_in_any_callback_steps_go_on(where, monkeypatch):
    """PETSc leaves vectors locked."""
    owner = BoundaryMatrix if where == "solve" else ContactTerms
    original, calls = getattr(owner, where), [0]

    def once(*arguments):
        calls[0] += 1
        if calls[0] == 2:
            raise KeyboardInterrupt
        return original(*arguments)

    model = block("hexahedron", 0.3, f"locked_{where}_")
    model.move(*BLOCK[0])
    model.problem.solve()
    model.move(*BLOCK[1])
    monkeypatch.setattr(owner, where, once)
    with pytest.raises(KeyboardInterrupt):
        model.problem.solve()
    report = model.problem.solve()
    assert report.certified and report.solver == "condensed"


@pytest.mark.mpi
def test_incompressible_without_a_diagonal():
    """MINI and a pressure: the condensed matrix has rows without a diagonal entry."""
    forces = [incompressible(solver) for solver in ("condensed", "full")]
    assert forces[0] == pytest.approx(forces[1], rel=1e-9, abs=1e-9)
    assert forces[0][1] > 0.1


def incompressible(solver):
    """Return the force on a pressed block."""
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0), lambda x: np.isclose(x[1], 1))
    P1, bubble = (basix.ufl.element(n, "triangle", k) for n, k in (("Lagrange", 1), ("Bubble", 3)))
    mini = basix.ufl.blocked_element(basix.ufl.enriched_element([P1, bubble]), shape=(2,))
    V, Q = fem.functionspace(msh, mini), fem.functionspace(msh, ("Lagrange", 1))
    u, p, v, w = fem.Function(V), fem.Function(Q), ufl.TestFunction(V), ufl.TestFunction(Q)
    strain = ufl.sym(ufl.grad(u))
    momentum = (100.0 * ufl.inner(strain, ufl.grad(v)) - p * ufl.div(v)) * ufl.dx
    top, held = fem.Function(V), fem.locate_dofs_topological(V, 1, tags.find(2))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0, 0), (0, 1)), ff.Coulomb(0.4)
    )
    problem = ff.FrictionalContactProblem(
        [momentum, -ufl.div(u) * w * ufl.dx],
        [u, p],
        contact=contact,
        bcs=[fem.dirichletbc(top, held)],
        petsc_options_prefix=f"stokes_{solver}_",
        settings=ff.StepSettings(solver=solver),
    )
    top.x.array[1::2] = -0.01
    report = problem.solve()
    assert report.certified and report.solver == solver
    divergence = fem.assemble_scalar(fem.form(ufl.div(u) * ufl.dx))
    assert msh.comm.allreduce(divergence) == pytest.approx(0.0, abs=1e-12)
    return report.contacts[0].force


@pytest.mark.mpi
def test_all_dofs_of_contact_are_prescribed():
    reports, moved = [], []
    for solver in ("condensed", "full"):
        model = block("hexahedron", 0.3, f"all_{solver}_", solver=solver)
        V = model.problem.u.function_space
        bottom = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[2], 0.0))
        bcs = [*model.problem.bcs, fem.dirichletbc(fem.Function(V), bottom)]
        contact = ff.Contact(model.contact.surface, model.contact.obstacle, ff.Coulomb(0.3))
        problem = with_contact(
            model, contact, f"held_{solver}_", bcs=bcs, settings=ff.StepSettings(solver=solver)
        )
        model.move(0.0, 0.0, 0.01)
        reports.append(problem.solve())
        moved.append(by_place(problem.u))
    assert moved[0] == pytest.approx(moved[1], abs=1e-12)
    assert np.max(abs(moved[1]), initial=0.0) == pytest.approx(0.01, rel=1e-12)
    assert [r.solver for r in reports] == ["condensed", "full"]
    assert all(r.certified and r.contacts[0].force == (0.0, 0.0, 0.0) for r in reports)
