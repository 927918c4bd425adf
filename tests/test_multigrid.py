"""Multigrid finds what the direct solver finds, for all states, laws, obstacles and bulks."""

from dataclasses import replace

from petsc4py import PETSc

import numpy as np
import pytest
import ufl

import fenicsx_friction as ff
from bodies import stack
from fenicsx_friction.solvers import choice, node_elimination, saddle
from models import block, by_place, with_contact

pytestmark = pytest.mark.mpi
PATH = [(0.0, 0.0, -0.01), (0.004, 0.002, -0.01), (0.02, 0.005, -0.008), (0.0, 0.0, -0.006)]


LAWS = {
    "orthotropic": ff.OrthotropicCoulomb((0.2, 0.6), (1.0, 1.0, 0.0)),
    "adhesive": ff.Coulomb(0.3, adhesion=0.5),
    "capped": ff.Coulomb(0.8, cap=4.0),
    "path": ff.Coulomb(lambda pressure, sliding: 0.2 + 0.3 * sliding.path / 0.02),
    "rate": ff.Coulomb(lambda pressure, sliding: 0.5 / (1.0 + 10.0 * sliding.rate)),
    "stuck": ff.PermanentStick(),
    "smooth": ff.Frictionless(),
}


def follow(model, path=PATH):
    """Return reports, displacements and tractions of all steps.

    Of tangential tractions only the length: tangents may differ where ranks share the mesh in
    another way.
    """
    found = []
    for place in path:
        model.move(*place)
        report = model.problem.solve()
        assert report.certified
        u, c = (by_place(f) for f in model.problem.state)
        found.append((report, [u, np.column_stack([c[:, 0], np.linalg.norm(c[:, 1:], axis=1)])]))
    return found


def assert_same(direct, multigrid):
    """Compare the states of all steps, and see that multigrid was at work."""
    for (exact, states), (report, others) in zip(direct, multigrid, strict=True):
        assert report.linear_solver == "multigrid" and report.solver == "full"
        assert exact.linear_solver == "direct"
        if report.iterations:
            assert report.krylov >= report.iterations
        for a, b in zip(states, others, strict=True):
            assert np.max(abs(a - b), initial=0.0) <= 1e-9 * max(
                np.max(abs(a), initial=0.0), 1e-300
            )


@pytest.mark.quick
@pytest.mark.parametrize("energy", ["small", "finite"])
@pytest.mark.parametrize("mu", [0.0, 0.3, 5.0])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_block_on_a_plane(cell, mu, energy):
    def made(linear):
        name = f"mg_{linear}_{cell}_{mu}_{energy}_"
        return block(
            cell, mu, name, n=(6, 5, 4), energy=energy, linear_solver=linear, solver="full"
        )

    assert_same(follow(made("direct")), follow(made("multigrid")))


@pytest.mark.parametrize("law", LAWS)
def test_laws(law):
    def made(linear):
        body = block("hexahedron", 0.1, f"mg_{law}_{linear}_body_", n=(6, 6, 6))
        surface, plane = body.contact.surface, body.contact.obstacle
        contact = ff.Contact(surface, plane, LAWS[law])
        options = {"linear_solver": linear, "settings": ff.StepSettings(solver="full")}
        problem = with_contact(body, contact, f"mg_{law}_{linear}_", **options)
        return replace(body, problem=problem, contact=contact)

    assert_same(follow(made("direct")), follow(made("multigrid")))


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_obstacles(kind):
    def made(linear):
        body = block("hexahedron", 0.1, f"mg_{kind}_{linear}_body_", n=(6, 6, 6), energy="finite")
        if kind == "sphere":
            obstacle = ff.RigidSphere((0.6, 0.45, -0.8), 0.8)
        else:
            obstacle = ff.RigidCylinder((0.0, 0.45, -0.7), (1.0, 0.0, 0.0), 0.7)
        contact = ff.Contact(body.contact.surface, obstacle, ff.Coulomb(0.4))
        options = {"linear_solver": linear, "settings": ff.StepSettings(solver="full")}
        problem = with_contact(body, contact, f"mg_{kind}_{linear}_", **options)
        return replace(body, problem=problem, contact=contact)

    assert_same(follow(made("direct")), follow(made("multigrid")))


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("energy", ["small", "finite"])
def test_two_bodies(cell, energy):
    def made(linear):
        name = f"mg_pair_{linear}_{cell}_{energy}_"
        settings = {"linear_solver": linear, "solver": "full"}
        return stack(0.4, name, cell=cell, upper=(5, 5, 3), energy=energy, **settings)

    path = [(0.0, 0.0, -0.02), (0.01, 0.0, -0.02), (0.06, 0.02, -0.03)]
    assert_same(follow(made("direct"), path), follow(made("multigrid"), path))


def test_pairs_take_no_more_iterations_than_planes():
    """Stiff springs between nodes of two bodies would take four times as many."""
    model = stack(0.4, "mg_count_", upper=(8, 8, 4), lower=(6, 6, 4), linear_solver="multigrid")
    for place in [(0.0, 0.0, -0.02), (0.01, 0.0, -0.02)]:
        model.move(*place)
        assert model.problem.solve().krylov <= 60  # 28 to 44; 105 with springs as for planes


@pytest.mark.parametrize("linear", ["direct", "multigrid"])
@pytest.mark.parametrize("moduli", [(1e6, 1e2), (1e2, 1e6)])
def test_stiff_and_soft_bodies(moduli, linear):
    """A stiff body that is moved is far from its balance, but its contact forces are small."""
    model = stack(
        0.4, f"mg_stiff_{linear}_", upper=(5, 5, 3), lower=(4, 4, 3), E=moduli, linear_solver=linear
    )
    for place in [(0.0, 0.0, -0.02), (0.01, 0.0, -0.02), (0.06, 0.02, -0.03)]:
        model.move(*place)
        report = model.problem.solve()
        assert report.certified and report.linear_solver == linear
        if linear == "direct":
            assert report.iterations <= 25  # 57 with forces of the stiff body


def test_the_levels_serve_many_steps():
    """Slip fronts, reversals and openings change the finest level only."""
    body = block("hexahedron", 0.3, "mg_levels_", n=(10, 8, 6), linear_solver="multigrid")
    reports = [report for report, _ in follow(body, PATH + PATH[:2])]
    assert reports[0].set_ups >= 1
    assert sum(r.set_ups for r in reports) <= 4
    assert sum(r.iterations for r in reports) >= 15


def test_levels_that_are_worn_are_made_anew(monkeypatch):
    """A hierarchy of another matrix is found out by its iterations, or by its failure."""
    body = block("hexahedron", 0.3, "mg_worn_", n=(6, 5, 4), linear_solver="multigrid")
    body.move(0.0, 0.0, -0.01)
    assert body.problem.solve().certified
    young = next(f for f in body.stored.coefficients() if f.name != "u" and f.ufl_shape == ())
    young.x.array[: len(young.x.array) // 2] *= 100.0
    body.move(0.005, 0.0, -0.011)
    report = body.problem.solve()
    assert report.certified
    assert report.set_ups >= 1


@pytest.mark.parametrize("linear", ["auto", "direct", "multigrid"])
def test_the_choice_is_told(linear):
    body = block("hexahedron", 0.3, f"mg_told_{linear}_", linear_solver=linear)
    body.move(0.0, 0.0, -0.01)
    report = body.problem.solve()
    small = {"auto": "direct", "direct": "direct", "multigrid": "multigrid"}
    assert report.linear_solver == small[linear]
    assert report.solver == ("full" if linear == "multigrid" else "condensed")


def test_auto_takes_multigrid_for_large_solids(monkeypatch):
    monkeypatch.setattr(choice, "MULTIGRID_FROM", 100)
    finite = block("hexahedron", 0.3, "mg_large_", energy="finite")
    assert finite.problem.solvers.full.linear_solver == "multigrid"
    assert block("hexahedron", 0.3, "mg_l_").problem.solvers.full.linear_solver == "direct"
    monkeypatch.setattr(choice, "MOST_IN_3D", 100)
    small = block("hexahedron", 0.3, "mg_linear_")
    assert small.problem.solvers.full.linear_solver == "multigrid"
    for options in ({"pc_type": "lu"}, {"ksp_type": "cg"}):
        mine = with_contact(small, contact_of(small), "mg_user_", petsc_options=options)
        assert mine.solvers.full.linear_solver == "direct"


def contact_of(body):
    """Return a contact like that of a body."""
    return ff.Contact(body.contact.surface, body.contact.obstacle, ff.Coulomb(0.3))


def test_what_multigrid_cannot_do_is_refused():
    body = block("hexahedron", 0.3, "mg_refused_")
    for options, match in (
        ({"linear_solver": "gamg"}, "linear_solver"),
        ({"linear_solver": "multigrid", "petsc_options": {"pc_type": "lu"}}, "multigrid_pc_gamg"),
    ):
        with pytest.raises(ff.ContactInputError, match=match):
            with_contact(body, contact_of(body), "mg_refused_too_", **options)


def test_options_reach_the_cycle():
    body = block("hexahedron", 0.3, "mg_options_body_", n=(6, 5, 4))
    options = {"multigrid_mg_levels_ksp_max_it": 3}
    problem = with_contact(
        body, contact_of(body), "mg_options_", petsc_options=options, linear_solver="multigrid"
    )
    body.move(0.0, 0.0, -0.01)
    thorough = problem.solve()
    other = block("hexahedron", 0.3, "mg_usual_", n=(6, 5, 4), linear_solver="multigrid")
    other.move(0.0, 0.0, -0.01)
    assert thorough.certified and thorough.krylov < other.problem.solve().krylov


@pytest.mark.parametrize("options", [{"ksp_type": "gmres", "pc_type": "jacobi"}])
def test_a_linear_solver_that_cannot_work_is_named_at_once(options):
    body = block("hexahedron", 0.3, "mg_jacobi_body_", n=(6, 5, 4))
    options = {**options, "ksp_max_it": 5}
    problem = with_contact(body, contact_of(body), "mg_jacobi_", petsc_options=options)
    body.move(0.0, 0.0, -0.01)
    with pytest.raises(ff.StepFailed, match=r"gmres with jacobi .*DIVERGED.*'direct'") as failed:
        problem.solve()
    assert len(failed.value.report.substeps) == 2


def steep(beyond):
    """A law whose slope is no number in iterates with pressures (Pa) beyond this."""

    def mu(pressure, sliding):
        root = ufl.sqrt(ufl.max_value(pressure - 1e9, 0.0))
        return 0.3 + 1e-12 * ufl.conditional(ufl.gt(pressure, beyond), root, 0.0)

    return ff.Coulomb(mu)


@pytest.mark.parametrize("linear", ["direct", "multigrid", "auto"])
def test_a_matrix_that_is_not_finite_ends_one_try_only(linear, monkeypatch):
    """The solution has 30.1 Pa at most, some iterates have more."""
    monkeypatch.setattr(choice, "MULTIGRID_FROM", 100)
    monkeypatch.setattr(choice, "MOST_IN_3D", 100)
    forces = []
    for beyond in (32.0, 1e3):
        body = block("hexahedron", 0.1, f"mg_steep_{linear}_{beyond}_body_", n=(4, 4, 3))
        contact = ff.Contact(body.contact.surface, body.contact.obstacle, steep(beyond))
        options = {"linear_solver": linear, "settings": ff.StepSettings(solver="full")}
        problem = with_contact(body, contact, f"mg_steep_{linear}_{beyond}_", **options)
        body.move(0.006, 0.0, -0.01)
        report = problem.solve()
        assert report.certified
        forces.append(report.contacts[0].force)
        if beyond == 32.0:
            assert any("NaN" in s.failure for s in report.substeps)
    assert forces[0] == pytest.approx(forces[1], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("linear", ["direct", "multigrid"])
def test_a_step_without_finite_slopes_is_found_by_chance_or_fails_with_a_message(linear):
    """The law itself is finite, so that a solution with 30.1 Pa is right if a try meets it."""
    body = block("hexahedron", 0.1, f"mg_cliff_{linear}_body_", n=(4, 4, 3))
    contact = ff.Contact(body.contact.surface, body.contact.obstacle, steep(25.0))
    options = {"linear_solver": linear, "settings": ff.StepSettings(solver="full")}
    problem = with_contact(body, contact, f"mg_cliff_{linear}_", **options)
    body.move(0.006, 0.0, -0.01)
    try:
        assert problem.solve().certified
    except ff.StepFailed as failed:
        assert "NaN" in str(failed)
        assert np.all(problem.u.x.array == 0.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"multigrid_mg_coarse_pc_type": "bogus"}, "bogus"),
        ({"multigrid_mg_levels_ksp_max_it": "many"}, "many"),
    ],
)
def test_options_that_petsc_refuses_are_named(options, words):
    body = block("hexahedron", 0.3, "mg_bogus_body_", n=(6, 5, 4))
    problem = with_contact(
        body, contact_of(body), "mg_bogus_", petsc_options=options, linear_solver="multigrid"
    )
    body.move(0.0, 0.0, -0.01)
    with pytest.raises(ff.ContactInputError, match=f"PETSc refuses .*{words}"):
        problem.solve()
    assert np.all(problem.u.x.array == 0.0)


def test_options_in_the_global_database_do_not_replace_the_preconditioner():
    database = PETSc.Options("mg_global_projection_")
    database["pc_type"] = "jacobi"
    try:
        body = block("hexahedron", 0.3, "mg_global_", n=(6, 5, 4), linear_solver="multigrid")
        body.move(0.0, 0.0, -0.01)
        assert body.problem.solve().certified
    finally:
        del database["pc_type"]


def test_broken_parts_of_the_preconditioner_are_no_wrong_answers(monkeypatch):
    """A preconditioner decides about iterations, never about the solution."""
    exact = node_elimination.node_blocks

    def wrong(*arguments):
        blocks = exact(*arguments)
        return replace(blocks, roots=0.0 * blocks.roots, slopes=-blocks.slopes)

    monkeypatch.setattr(saddle, "node_blocks", wrong)
    body = block("hexahedron", 0.3, "mg_wrong_", linear_solver="multigrid")
    body.move(0.0, 0.0, -0.01)
    try:
        report = body.problem.solve()
    except ff.StepFailed:
        return
    direct = block("hexahedron", 0.3, "mg_right_", linear_solver="direct")
    direct.move(0.0, 0.0, -0.01)
    force = direct.problem.solve().contacts[0].force
    assert report.contacts[0].force == pytest.approx(np.array(force), rel=1e-9, abs=1e-9)
