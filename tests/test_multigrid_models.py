"""Multigrid in whole models: bodies held in many ways, materials far apart, obstacles that move."""

from dataclasses import dataclass

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.solvers import choice
from models import by_place, tagged_facets

pytestmark = pytest.mark.mpi


@dataclass
class Cube:
    """A unit cube over planes; forces and motions are set by name."""

    problem: ff.FrictionalContactProblem
    traction: fem.Constant
    motion: ff.RigidMotion

    def states(self, path):
        """Return the states after a traction (Pa) and a place of the plane (m) each."""
        found = []
        for traction, place in path:
            self.traction.value = traction
            self.motion.translation.value = place
            report = self.problem.solve()
            assert report.certified
            found.append((report, [by_place(f) for f in self.problem.state]))
        return found


def cube(
    linear,
    *,
    n=6,
    E=lambda x: 1e3 + 0.0 * x[0],
    nu=0.3,
    bbar=False,
    energy="small",
    held="",
    wall=0,
    height=1,
):
    """Build the cube.

    Args:
        linear: The linear solver.
        n: Cells along an edge.
        E: Young's modulus (Pa) at points.
        nu, bbar, energy: The bulk.
        held: ``top`` or ``base`` (all), ``guide`` (one component each of two sides) or nothing:
            contact alone holds it.
        wall: Whether another plane stands at one side.
        height: Height (m), of as many times more cells.
    """
    size, kind = [1.0, 1.0, float(height)], mesh.CellType.hexahedron
    msh = mesh.create_box(MPI.COMM_WORLD, [[0.0] * 3, size], [n, n, height * n], kind)
    sides = [(2, 0.0), (2, size[2]), (1, 0.0), (0, 1.0)]
    tags = tagged_facets(msh, *(lambda x, i=i, at=at: np.isclose(x[i], at) for i, at in sides))
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    modulus = fem.Function(fem.functionspace(msh, ("DG", 0)))
    modulus.interpolate(E)
    density = ff.bulk.small_strain_energy if energy == "small" else ff.bulk.neo_hooke_energy
    stored = ff.bulk.stored_energy(density(u, ff.bulk.Elastic(modulus, nu)), ufl.dx, bbar=bbar)
    traction = fem.Constant(msh, np.zeros(3))
    ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
    motion = ff.RigidMotion(msh)
    bottom = ff.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), motion=motion)
    contacts = [ff.Contact(ff.ContactSurface(msh, tags, 1), bottom, ff.Coulomb(0.4))]
    if wall:
        side = ff.RigidPlane((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
        contacts.append(ff.Contact(ff.ContactSurface(msh, tags, 4, "wall"), side, ff.Coulomb(0.2)))
    bcs = []
    if held in ("top", "base"):
        dofs = fem.locate_dofs_topological(V, 2, tags.find(2 if held == "top" else 1))
        bcs = [fem.dirichletbc(np.zeros(3), dofs, V)]
    if held == "guide":
        bcs = [
            fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(i), 2, tags.find(m)), V.sub(i))
            for i, m in ((1, 3), (0, 2))
        ]
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v) - ufl.inner(traction, v) * ds(2),
        u,
        contact=contacts,
        bcs=bcs,
        petsc_options_prefix=f"cube_{linear}_",
        linear_solver=linear,
        settings=ff.StepSettings(solver="full"),
    )
    return Cube(problem, traction, motion)


def assert_equal(path, **model):
    """Solve with both linear solvers and compare the states; return the reports of multigrid.

    Tractions of two contacts that share nodes which stick are not unique.
    """
    direct = cube("direct", **model).states(path)
    multigrid = cube("multigrid", **model).states(path)
    for i in range(1 if model.get("wall") else 2):
        size = max(np.max(abs(states[i])) for _, states in direct)
        for (_, exact), (_, found) in zip(direct, multigrid, strict=True):
            assert found[i] == pytest.approx(exact[i], abs=1e-9 * size)
    assert all(r.linear_solver == "multigrid" for r, _ in multigrid)
    return [r for r, _ in multigrid]


REST = (0.0, 0.0, 0.0)
PUSH = [((0.0, 0.0, -20.0), REST), ((4.0, 0.0, -20.0), REST), ((5.0, 3.0, -30.0), REST)]
LIFT = [
    (REST, (0.0, 0.0, 0.02)),
    (REST, (0.01, 0.0, 0.02)),
    (REST, (0.05, 0.03, 0.015)),
    (REST, (0.0, 0.0, -0.01)),
]


@pytest.mark.parametrize("energy", ["small", "finite"])
def test_contact_alone_holds_the_body(energy):
    """Without springs at the closed nodes, its matrix would be singular."""
    reports = assert_equal(PUSH, energy=energy)
    assert all(r.contacts[0].stick for r in reports)


def test_a_moving_plane_presses_drags_and_leaves():
    reports = assert_equal(LIFT, held="top")
    assert reports[0].contacts[0].stick and reports[2].contacts[0].slip
    assert reports[3].contacts[0].open == 49


def test_a_tower_leaves_ranks_without_contact():
    model = cube("direct", n=3, height=9)
    counts = model.problem.comm.allgather(model.problem.contacts[0].surface.num_owned)
    if len(counts) > 1:
        assert min(counts) == 0
    assert_equal(PUSH[:2], n=3, height=9, held="guide")


def test_twelve_cells_an_edge():
    """A larger model than the others: open, stick and slip together."""
    reports = assert_equal(LIFT, n=12, held="top")
    assert reports[-1].contacts[0].open == 169
    assert any(min(k.open, k.slip) > 0 for r in reports for k in r.contacts)


def test_guides_and_two_contacts():
    assert_equal(PUSH, held="guide", wall=1)


def test_nearly_incompressible_with_bbar():
    reports = assert_equal(LIFT, held="top", nu=0.49, bbar=True)
    assert max(r.krylov for r in reports) <= 600  # 100 to 240 here, 230 to 420 on 3 ranks


def layers(x):
    """Steel on rubber in one body: moduli 1e5 apart, in layers that no mesh line follows."""
    return np.where(np.sin(9.0 * x[0]) * np.sin(8.0 * x[1] + 5.0 * x[2]) > 0.0, 1e8, 1e3)


def test_where_multigrid_fails_a_factor_follows(monkeypatch):
    """``auto`` never loses a step that a direct solver finds; it stays with what worked."""
    monkeypatch.setattr(choice, "MULTIGRID_FROM", 100)
    hard = {"held": "top", "energy": "finite", "E": layers, "n": 6}
    model = cube("auto", **hard)
    model.problem.solvers.full.options["ksp_max_it"] = 3
    found = model.states(LIFT[:2])
    assert [r.linear_solver for r, _ in found] == ["direct", "direct"]
    assert any("gmres with multigrid" in s.failure for s in found[0][0].substeps)
    assert found[0][0].krylov and not found[1][0].krylov
    direct = cube("direct", **hard).states(LIFT[:2])
    for (_, a), (_, b) in zip(found, direct, strict=True):
        assert a[0] == pytest.approx(b[0], abs=1e-9 * np.max(abs(b[0])))


@pytest.mark.parametrize("linear", ["auto", "direct", "multigrid"])
@pytest.mark.parametrize("solver", ["auto", "full"])
def test_held_nodes_that_are_pushed_end_with_a_message(linear, solver):
    """No force acts yet, and the state is its own solution but for the push."""
    model = cube(linear, n=3, held="base")
    model.problem.settings = ff.StepSettings(solver=solver)
    model.motion.translation.value = (0.0, 0.0, 0.01)
    with pytest.raises(ff.StepFailed, match="push"):
        model.problem.solve()


def test_set_ups_of_a_failed_step_are_those_of_all_tries(monkeypatch):
    model = cube("multigrid", n=4)
    model.problem.settings = ff.StepSettings(solver="full", raise_on_uncertified=False)
    model.states([((0.0, 0.0, -20.0), REST)])
    before = model.problem.solvers.full.set_ups
    model.traction.value = (40.0, 0.0, -20.0)  # more than friction holds
    report = model.problem.solve()
    assert not report.certified
    assert report.set_ups == model.problem.solvers.full.set_ups - before > 1


def test_a_line_search_that_is_asked_for_is_taken():
    """Else the first corrector backtracks."""
    model = cube("multigrid", n=3, held="top")
    model.motion.translation.value = (0.01, 0.0, 0.02)
    model.problem.solve()
    assert model.problem.projection.solver.getLineSearch().getType() == "bt"
    F, contact = model.problem.bulk, model.problem.contacts[0]
    plane = ff.Contact(contact.surface, ff.RigidPlane((0, 0, 0.02), (0, 0, 1)), ff.Coulomb(0.4))
    asked = ff.FrictionalContactProblem(
        F,
        model.problem.u,
        contact=plane,
        bcs=model.problem.bcs,
        petsc_options_prefix="asked_",
        petsc_options={"snes_linesearch_type": "basic"},
        linear_solver="multigrid",
    )
    asked.solve()
    assert asked.projection.solver.getLineSearch().getType() == "basic"


@pytest.mark.parametrize("kind", ["bubbles", "temperature"])
def test_displacements_with_other_unknowns_are_refused(kind):
    """Multigrid by aggregation knows displacements at vertices; ``auto`` takes a factor instead."""
    msh = mesh.create_unit_cube(MPI.COMM_WORLD, 2, 2, 2)
    tags = tagged_facets(msh, lambda x: np.isclose(x[2], 0.0))
    P1, bubble = (basix.ufl.element(n, "tetrahedron", k) for n, k in (("P", 1), ("Bubble", 4)))
    element = P1 if kind == "temperature" else basix.ufl.enriched_element([P1, bubble])
    V = fem.functionspace(msh, basix.ufl.blocked_element(element, shape=(3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1e3, 0.3))
    blocks = [ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)]
    unknowns = [u]
    if kind == "temperature":
        T = fem.Function(fem.functionspace(msh, P1))
        q = ufl.TestFunction(T.function_space)
        blocks.append(ufl.inner(ufl.grad(T), ufl.grad(q)) * ufl.dx)
        unknowns.append(T)
    plane = ff.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))

    def made(linear):
        contact = ff.Contact(ff.ContactSurface(msh, tags, 1), plane, ff.Coulomb(0.3))
        options = {"contact": contact, "petsc_options_prefix": f"refused_{kind}_{linear}_"}
        return ff.FrictionalContactProblem(blocks, unknowns, linear_solver=linear, **options)

    words = {"bubbles": "values at the vertices", "temperature": "more unknowns"}[kind]
    with pytest.raises(ff.ContactInputError, match=f"'multigrid': it .*{words}.*take 'direct'"):
        made("multigrid")
    assert made("auto").solvers.linear_solvers == ["direct"]
