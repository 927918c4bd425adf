"""Multipliers at all nodes of a quadratic displacement that meets a rigid obstacle."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from dolfinx.io import VTXWriter

import fenicsx_friction as ff
from closed_forms import indentation
from fenicsx_friction.files.checkpoint import read_checkpoint, write_checkpoint
from fenicsx_friction.verification.exact import ExactReference
from models import by_place, gathered, tagged_facets
from test_closed_forms import inclined_block
from test_weighted import ball, block, parabola, plane

mpi = pytest.mark.mpi
CELLS = {"triangle": 2, "quadrilateral": 2, "hexahedron": 3}
E, NU, PRESS = 1000.0, 0.3, 0.01


def all_nodes(cell, n, obstacle, mu=0.3, **options):
    """The block of the averages, with multipliers at all nodes."""
    return block(cell, n, obstacle, mu, surface_degree=2, **options)


# -- uniform pressure --------------------------------------------------------------------------


def uneven_column(cell):
    """A cube whose base has uneven facets, in 3D quadrilaterals of any shape."""
    d, kind = CELLS[cell], getattr(mesh.CellType, cell)
    make = mesh.create_unit_square if d == 2 else mesh.create_unit_cube
    msh = make(MPI.COMM_WORLD, *[3] * d, kind)
    x = msh.geometry.x
    bump = [0.25 * np.prod(x[:, : d - 1] * (1.0 - x[:, : d - 1]), axis=1) * 4 ** (d - 2)]
    bump.append(-0.6 * bump[0])
    for k in range(d - 1):
        x[:, k] += bump[k] * (1.0 - x[:, d - 1])
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(x[d - 1], 0.0),
        lambda x: np.isclose(x[d - 1], 1.0),
        *(lambda x, k=k: np.isclose(x[k], 0.0) for k in range(d - 1)),
    )
    return msh, tags


def pressed(cell, with_pressure):
    """Press a column whose sides are free; return its nodal pressures and the exact one."""
    msh, tags = uneven_column(cell)
    d, nu = msh.geometry.dim, 0.4999 if with_pressure else NU
    V = fem.functionspace(msh, ("Lagrange", 2, (d,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    G, K = E / (2.0 * (1.0 + nu)), E / (3.0 * (1.0 - 2.0 * nu))
    if with_pressure:
        Q = fem.functionspace(msh, ("Lagrange", 1))
        p, q = fem.Function(Q), ufl.TestFunction(Q)
        strain = ufl.sym(ufl.grad(u))
        shear = 2.0 * G * (ufl.inner(strain, ufl.grad(v)) - ufl.div(u) * ufl.div(v) / 3.0)
        F = [(shear - p * ufl.div(v)) * ufl.dx, (ufl.div(u) + p / K) * q * ufl.dx]
        unknowns = [u, p]
    else:
        density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, nu))
        F, unknowns = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v), u
    sides = [(2, d - 1, -PRESS), *((3 + k, k, 0.0) for k in range(d - 1))]
    bcs = [
        fem.dirichletbc(
            value, fem.locate_dofs_topological(V.sub(k), d - 1, tags.find(tag)), V.sub(k)
        )
        for tag, k, value in sides
    ]
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1, degree=2), plane(d), ff.Frictionless())
    problem = ff.FrictionalContactProblem(
        F, unknowns, contact=contact, bcs=bcs, petsc_options_prefix="patch_"
    )
    assert problem.solve().certified
    return contact.nodal().c[:, 0], E * PRESS / (1.0 - nu**2 if d == 2 else 1.0)


@pytest.mark.quick
@mpi
@pytest.mark.parametrize("with_pressure", [False, True], ids=["u", "Taylor-Hood"])
@pytest.mark.parametrize("cell", CELLS)
def test_a_uniform_pressure_is_exact_at_every_node(cell, with_pressure):
    found, exact = pressed(cell, with_pressure)
    assert found == pytest.approx(exact, rel=1e-10)


# -- profiles ----------------------------------------------------------------------------------


def profile(cell, n, surface_degree):
    """Pressures of a parabola on a block 2 x 1, the force, and penetration over approach."""
    model = block(
        cell, (n, n // 2), parabola, 0.0, span=([0.0, 0.0], [2.0, 1.0]),
        surface_degree=surface_degree, name=f"nodes_{cell}_{n}_{surface_degree}_",
    )  # fmt: skip
    model.move(0.0, -0.02)
    report = model.problem.solve().contacts[0]
    x, c, _ = gathered(model.problem)
    order = np.argsort(x[:, 0])
    pressure = np.interp(np.linspace(0.4, 1.6, 2001), x[order, 0], c[order, 0])
    return pressure, report.force[1], report.penetration / 0.02


@pytest.fixture(scope="module")
def fine_profile():
    """Averages on 256 cells: another discretisation."""
    return profile("quadrilateral", 256, 1)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_profile_and_force_of_a_line_contact(cell, fine_profile):
    """129 nodes on the surface: less than half the error of the averages on the same cells."""
    exact, force, _ = fine_profile
    coarse, fine, averages = (profile(cell, *case) for case in ((32, 2), (64, 2), (64, 1)))
    errors = [
        np.linalg.norm(p[0] - exact) / np.linalg.norm(exact) for p in (coarse, fine, averages)
    ]
    assert errors[1] <= 0.016
    assert errors[1] < 0.5 * errors[0] and errors[1] < 0.5 * errors[2]
    assert fine[1] == pytest.approx(force, rel=1e-3)
    assert 0.0 < fine[2] < 0.004 and fine[2] < 0.7 * coarse[2]


def test_hertz_sphere():
    """A quarter of a block, 2 and 4 cells on the radius of contact (Johnson 1985, 4.2(a))."""
    errors, peaks, deepest = [], [], []
    for n in (2, 4):
        model = indentation(
            3, n, f"sphere_{n}_", nu=0.3, full_x=False, far=10.0, growth=1.8, degree=2,
            surface_degree=2,
        )  # fmt: skip
        report = model.move(0.0, 0.0093)
        t = model.tractions()
        errors.append(t.norm(t.pressure - t.hertz.pressure(t.r)))
        peaks.append(abs(np.max(t.pressure) / t.hertz.p0 - 1.0))
        deepest.append(report.contacts[0].penetration / 0.0093)
    assert errors[1] < 0.025 and errors[0] > 1.8 * errors[1]
    assert peaks[1] < 0.01
    assert deepest[1] < 0.006 and deepest[0] > 2.0 * deepest[1]


@mpi
def test_penetration_is_told_between_the_nodes():
    """No node is in the obstacle, but points between are."""
    model = all_nodes("quadrilateral", 8, ball(2, 1.0, 0.0), 0.0, name="deep_")
    model.move(0.0, -0.02)
    report = model.problem.solve().contacts[0]
    assert model.problem.accepted[0].gap.min(initial=0.0) > -1e-12
    assert 1e-5 < report.penetration < 2e-3


# -- friction ----------------------------------------------------------------------------------


@mpi
@pytest.mark.parametrize("cell", CELLS)
def test_what_is_dragged_has_the_friction_of_its_load(cell):
    d = CELLS[cell]
    model = all_nodes(cell, 3, plane(d), 0.2, name=f"drag_{cell}_")
    model.move(*[0.0] * (d - 1), -0.01)
    model.problem.solve()
    model.move(0.3, *[0.0] * (d - 2), -0.02)
    report = model.problem.solve().contacts[0]
    assert report.stick == 0 and report.slip > 0
    nodal = model.contact.nodal()
    shear = np.linalg.norm(nodal.c[:, 1:], axis=1)
    assert shear == pytest.approx(0.2 * nodal.c[:, 0], rel=1e-9, abs=1e-12)
    # In 3D some nodes slip sideways, too.
    assert abs(report.force[0]) == pytest.approx(
        0.2 * report.force[-1], rel=1e-9 if d == 2 else 2e-3
    )


@pytest.mark.parametrize(("mu", "stays"), [pytest.param(0.31, True, marks=mpi), (0.29, False)])
def test_a_block_stays_on_a_slope_below_the_angle_of_friction(mu, stays):
    """Weight on an incline of tangent 0.3: only friction holds it."""
    slope, weight = 0.3, 10.0
    msh, tags, _, normal = inclined_block(slope, (1.0, 0.25), (4, 2))
    V = fem.functionspace(msh, ("Lagrange", 2, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1e5, NU))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v) + weight / 0.25 * v[1] * ufl.dx
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, degree=2), ff.RigidPlane((0.0, 0.0), normal), ff.Coulomb(mu)
    )
    problem = ff.FrictionalContactProblem(F, u, contact=contact, petsc_options_prefix="slope_")
    if not stays:
        with pytest.raises(ff.StepFailed):
            problem.solve()
        return
    report = problem.solve().contacts[0]
    assert np.array(report.force) == pytest.approx([0.0, weight], abs=1e-8 * weight)
    assert report.stick > 0


@pytest.mark.parametrize("cell", CELLS)
def test_steps_are_those_of_the_exact_reference(cell):
    """Another solver, of second-order cones, on the bulk condensed on the nodes."""
    d = CELLS[cell]
    tilted = ff.RigidPlane([0.5] * (d - 1) + [0.0], [0.01] * (d - 1) + [1.0])
    model = all_nodes(cell, 2, tilted, 0.4, comm=MPI.COMM_SELF, name=f"exact_{cell}_")
    exact = ExactReference(model.problem)
    for side, down in ((0.0, 0.01), (0.02, 0.012), (-0.01, 0.008), (0.03, 0.004)):
        model.move(side, *[0.5 * side] * (d - 2), -down)
        report, found = model.problem.solve().contacts[0], exact.advance()
        assert model.contact.nodal().c == pytest.approx(found.c, abs=1e-9 * np.max(abs(found.c)))
    assert report.slip > 0


@mpi
def test_a_coefficient_may_be_any_field():
    """Of the mesh or of the surface, of degree 1 or 2, or an expression: all the same."""

    def coefficients(msh, surface):
        for domain, degree in ((msh, 1), (msh, 2), (surface.submesh, 1), (surface.submesh, 2)):
            f = fem.Function(fem.functionspace(domain, ("Lagrange", degree)))
            f.interpolate(lambda x: 0.1 + 0.2 * x[0])
            yield f
        yield 0.1 + 0.2 * ufl.SpatialCoordinate(msh)[0]

    msh = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4, mesh.CellType.quadrilateral)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0))
    surface = ff.ContactSurface(msh, tags, 1, degree=2)
    for k, mu in enumerate(coefficients(msh, surface)):
        V = fem.functionspace(msh, ("Lagrange", 2, (2,)))
        u = fem.Function(V)
        density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU))
        contact = ff.Contact(surface, plane(2), ff.Coulomb(mu))
        top = fem.locate_dofs_topological(V, 1, tags.find(2))
        problem = ff.FrictionalContactProblem(
            ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, ufl.TestFunction(V)),
            u,
            contact=contact,
            bcs=[fem.dirichletbc(np.array([0.1, -0.01]), top, V)],
            petsc_options_prefix=f"mu_{k}_",
        )
        assert problem.solve().contacts[0].stick == 0
        share = 0.1 + 0.2 * surface.x[:, 0]
        c = contact.nodal().c
        assert abs(c[:, 1]) == pytest.approx(share * c[:, 0], rel=1e-9, abs=1e-12)


def test_surfaces_may_go_round_a_corner():
    """The side of the block does not touch; the corner's force is that of both its faces."""
    forces = []
    for both in (False, True):
        msh = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4, mesh.CellType.quadrilateral)
        tags = tagged_facets(
            msh,
            lambda x, both=both: np.isclose(x[1], 0.0) | (both & np.isclose(x[0], 0.0)),
            lambda x: np.isclose(x[1], 1.0),
        )
        V = fem.functionspace(msh, ("Lagrange", 2, (2,)))
        u = fem.Function(V)
        density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU))
        top = fem.locate_dofs_topological(V, 1, tags.find(2))
        problem = ff.FrictionalContactProblem(
            ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, ufl.TestFunction(V)),
            u,
            contact=ff.Contact(
                ff.ContactSurface(msh, tags, 1, degree=2), plane(2), ff.Coulomb(0.3)
            ),
            bcs=[fem.dirichletbc(np.array([0.0, -0.01]), top, V)],
            petsc_options_prefix=f"corner_{both}_",
        )
        forces.append(problem.solve().contacts[0].force[1])
    assert forces[1] == pytest.approx(forces[0], rel=1e-9)


# -- the rest of the package -------------------------------------------------------------------


@pytest.mark.parametrize("cell", CELLS)
def test_jacobian_against_differences(cell):
    d = CELLS[cell]
    model = all_nodes(cell, 2, ball(d), energy="finite", name=f"slopes_{cell}_")
    model.move(*[0.004] * (d - 1), -0.03)
    model.problem.solve()
    assert ff.check_jacobian(model.problem).error <= 1e-6


@mpi
@pytest.mark.parametrize("cell", CELLS)
def test_solvers_and_ranks_have_the_same_solution(cell):
    """The boundary, the whole system, and one rank for all."""
    d, states = CELLS[cell], []
    for solver, comm in (
        ("condensed", MPI.COMM_WORLD), ("full", MPI.COMM_WORLD), ("condensed", MPI.COMM_SELF)
    ):  # fmt: skip
        settings = ff.StepSettings(solver=solver)
        model = all_nodes(cell, 3, ball(d), settings=settings, comm=comm, name=f"{solver}_{cell}_")
        for place in ([0.0] * (d - 1), [0.01] * (d - 1)):
            model.move(*place, -0.03)
            report = model.problem.solve()
        assert report.solver == solver and report.contacts[0].slip + report.contacts[0].stick
        totals = report.contacts[0]
        states.append([*totals.force, *totals.moment, totals.penetration])
        if comm is MPI.COMM_WORLD:
            states[-1] += [*by_place(model.u).ravel(), *by_place(model.contact.c).ravel()]
    whole, full, alone = states
    assert full == pytest.approx(whole, abs=1e-9 * max(np.abs(whole)))
    assert alone == pytest.approx(whole[: len(alone)], rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
def test_half_of_a_symmetric_model_is_half_of_it(cell):
    d, forces = CELLS[cell], []
    for low in (-1.0, 0.0):
        sphere = ff.RigidSphere([0.0] * (d - 1) + [-9.98], 10.0)
        span = [low] + [-1.0] * (d - 2) + [0.0], [1.0] * d
        cells = [4 if low < 0.0 else 2] + [2] * (d - 1)
        model = all_nodes(
            cell, cells, sphere, 0.3, span=span, symmetric=low == 0.0, name=f"half_{low}_"
        )
        model.move(*[0.0] * (d - 1), -0.15)
        forces.append(model.problem.solve().contacts[0].force[-1])
    assert 2.0 * forces[1] == pytest.approx(forces[0], rel=1e-9)


@mpi
def test_fields_have_a_value_at_every_node(tmp_path):
    model = all_nodes("hexahedron", 2, ball(3), name="fields_")
    model.move(0.01, 0.0, -0.03)
    report, n = model.problem.solve().contacts[0], model.contact.surface.num_owned
    fields = ff.ContactFields(model.problem)
    fields.update()
    assert fields.pressure.x.array[:n] == pytest.approx(model.contact.nodal().c[:, 0])
    total = model.contact.nodal_area() @ fields.traction.x.array.reshape(-1, 3)[:n]
    assert model.problem.comm.allreduce(total) == pytest.approx(np.array(report.force), abs=1e-10)
    states = model.problem.comm.allreduce(
        np.bincount(fields.state.x.array[:n].astype(int), minlength=3)
    )
    assert states.tolist() == [report.open, report.stick, report.slip]
    assert sum(states) == 25  # 4 facets
    tags, submesh = fields.state_tags(), model.contact.surface.submesh
    at = fields.state.function_space.tabulate_dof_coordinates()
    for vertex in range(len(tags.values)):
        where = np.argmin(np.linalg.norm(at - _vertex(submesh, vertex), axis=1))
        assert tags.values[vertex] == fields.state.x.array[where]
    name = model.problem.comm.bcast(str(tmp_path / "contact.bp"))
    with VTXWriter(model.problem.comm, name, fields.scalars) as writer:
        writer.write(0.0)


def _vertex(msh, vertex):
    """Return the coordinates of a local vertex."""
    node = mesh.entities_to_geometry(msh, 0, np.array([vertex], dtype=np.int32))
    return msh.geometry.x[node[0, 0]]


@mpi
def test_a_run_goes_on_from_a_checkpoint(tmp_path):
    path = MPI.COMM_WORLD.bcast(str(tmp_path / "nodes.h5"))

    def build(surface_degree=2):
        return block("quadrilateral", 4, ball(2), surface_degree=surface_degree, name="kept_")

    first = build()
    first.move(0.0, -0.03)
    first.problem.solve()
    write_checkpoint(path, first.problem, {})
    second = build()
    read_checkpoint(path, second.problem)
    for model in (first, second):
        model.move(0.01, -0.03)
        model.problem.solve()
    for a, b in ((first.u, second.u), (first.contact.c, second.contact.c)):
        assert by_place(b) == pytest.approx(by_place(a), abs=1e-9)
    with pytest.raises(ff.CheckpointError):
        read_checkpoint(path, build(1).problem)
