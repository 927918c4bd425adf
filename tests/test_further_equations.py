"""Equations beside the momentum balance are measured by what flows in them, in any unit."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import LinearProblem

import fenicsx_friction as ff
from bodies import box, joined
from models import tagged_facets


def warm(
    prefix,
    source,
    conductivity=1.0,
    outside=0.0,
    *,
    held=True,
    bodies=1,
    friction=0.3,
    sink=None,
):
    """Return a problem in displacement and temperature, and the latter's solution without a sink.

    The top of a block is pressed down; heat of the ``source`` leaves it by its held top, or by all
    sides at a rate. A second body, beside, has a millionth of the source. A ``sink`` takes heat
    that depends on the temperature.
    """
    corners = [np.array([2.0 * k, 0.0]) for k in range(bodies)]
    parts = [box(x, x + 1.0, (4, 4), "triangle") for x in corners]
    msh = joined(MPI.COMM_WORLD, *parts)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    W = fem.functionspace(msh, ("Lagrange", 1))
    u, v, T, q = fem.Function(V), ufl.TestFunction(V), fem.Function(W), ufl.TestFunction(W)
    outside = float(outside)
    T.x.array[:] = outside
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    X = ufl.SpatialCoordinate(msh)
    rate = ufl.conditional(ufl.lt(X[0], 1.5), source, 1e-6 * source)

    def heat(T):
        flow = conductivity * ufl.inner(ufl.grad(T), ufl.grad(q)) * ufl.dx - rate * q * ufl.dx
        return flow if held else flow + conductivity * (T - outside) * q * ufl.ds

    top, up = fem.Function(V), fem.locate_dofs_topological(V, 1, tags.find(2))
    top.x.array[1::2] = -0.01
    cool = fem.dirichletbc(outside, fem.locate_dofs_topological(W, 1, tags.find(2)), W)
    thermal = [cool] if held else []
    a, L = ufl.system(heat(ufl.TrialFunction(W)))
    reference = LinearProblem(
        a, L, bcs=thermal, petsc_options_prefix=f"{prefix}heat_", petsc_options={"pc_type": "lu"}
    )
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0, 0), (0, 1)), ff.Coulomb(friction)
    )
    problem = ff.FrictionalContactProblem(
        [F, heat(T) if sink is None else heat(T) + sink(T) * q * ufl.dx],
        [u, T],
        contact=contact,
        bcs=[fem.dirichletbc(top, up), *thermal],
        petsc_options_prefix=prefix,
    )
    return problem, T, reference.solve()


SOURCES = [
    (1.0, 1.0, 0.0),
    (1e-12, 1.0, 0.0),
    (1e12, 1.0, 0.0),
    (1e3, 1e-6, 0.0),
    (1.0, 1.0, 300.0),
]


@pytest.mark.mpi
@pytest.mark.parametrize(("source", "conductivity", "outside"), SOURCES)
@pytest.mark.parametrize("held", [True, False])
def test_temperature_is_right_whatever_the_forces_are(source, conductivity, outside, held):
    problem, T, exact = warm(f"w{held}_", source, conductivity, outside, held=held, bodies=2)
    report = problem.solve()
    assert report.certified and report.iterations < 8
    rise, right = T.x.array - outside, exact.x.array - outside
    beside = T.function_space.tabulate_dof_coordinates()[:, 0] > 1.5
    for body in (~beside, beside):
        largest = problem.comm.allreduce(np.max(abs(right[body]), initial=0.0), MPI.MAX)
        assert 1e-9 * source < largest * conductivity < 10.0 * source
        slack = 1e-9 * largest + 1e-12 * outside
        assert rise[body] == pytest.approx(right[body], abs=slack)
    problem.dt.value = 2.0  # nothing else changes: the state is its own solution
    assert problem.solve().iterations == 0


@pytest.mark.parametrize("source", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("held", [True, False])
def test_wrong_temperature_is_not_certified(source, held):
    problem, T, _ = warm("wrong_", source, held=held)
    problem.solve()
    right = T.x.array.copy()
    T.x.array[:] = right * (1.0 + 1e-6)
    assert not problem.certify().solved
    T.x.array[:] = right
    assert problem.certify().solved


SINKS = {
    "kink at zero": lambda T: ufl.conditional(ufl.lt(T, 0.0), 1e15 * T, 0.0),
    "no number below zero": lambda T: 0.1 * T**1.5,
    "steep": lambda T: 1e6 * T**3,
}


@pytest.mark.parametrize("sink", SINKS.values(), ids=SINKS)
def test_kinks_beside_the_state_are_no_noise(sink):
    """The top is held at zero, where a small change of the temperature changes much."""
    problem, T, linear = warm("kink_", 1.0, sink=sink)
    T.x.array[:] = linear.x.array
    problem.solve()
    right = T.x.array.copy()
    for factor in (1.0 + 1e-6, 1.5):
        T.x.array[:] = right * factor
        assert not problem.certify().solved
    T.x.array[:] = right
    assert problem.certify().solved


def test_body_with_little_heat_is_not_excused_by_the_other():
    problem, T, _ = warm("little_", 1.0, bodies=2)
    problem.solve()
    beside = T.function_space.tabulate_dof_coordinates()[:, 0] > 1.5
    T.x.array[beside] *= 1.0 + 1e-6
    certificate = problem.certify()
    assert not certificate.solved
    assert 1e-7 < certificate.unbalanced < 1e-5


def test_mixed_pressure_is_measured_by_the_forces():
    """Its rows contain the displacement: P1 with bubbles and pressure against the pure form."""
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0))
    found = []
    for pure in (True, False):
        V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        P = fem.functionspace(msh, ("DG", 0))
        u, v, p, q = fem.Function(V), ufl.TestFunction(V), fem.Function(P), ufl.TestFunction(P)
        dilation, strain = ufl.div(u), ufl.sym(ufl.grad(u))
        pressure = 600.0 * dilation if pure else p
        F = ufl.inner(800.0 * strain + pressure * ufl.Identity(2), ufl.grad(v)) * ufl.dx
        G = (dilation - p / 600.0) * q * ufl.dx
        top = fem.Function(V)
        top.x.array[1::2] = -0.01
        held = fem.locate_dofs_topological(V, 1, tags.find(2))
        surface = ff.ContactSurface(msh, tags, 1)
        contact = ff.Contact(surface, ff.RigidPlane((0, 0), (0, 1)), ff.Coulomb(0.3))
        problem = ff.FrictionalContactProblem(
            F if pure else [F, G],
            u if pure else [u, p],
            contact=contact,
            bcs=[fem.dirichletbc(top, held)],
            petsc_options_prefix=f"pressure{pure}_",
        )
        report = problem.solve()
        assert report.certified and report.iterations < 8
        found.append(report.contacts[0].force)
    assert found[1] == pytest.approx(found[0], rel=1e-9)
    assert found[0][1] > 1.0


def test_field_derived_from_another_and_heat_in_the_deformed_body_without_any():
    """The temperature is that outside, all over: what is left of each equation is rounding."""
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4, mesh.CellType.quadrilateral)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0))
    V, W = (fem.functionspace(msh, ("Lagrange", 1, shape)) for shape in ((2,), ()))
    D = fem.functionspace(msh, ("DG", 0))
    u, T, damage = (fem.Function(space) for space in (V, W, D))
    v, q, e = (ufl.TestFunction(space) for space in (V, W, D))
    T.x.array[:] = outside = 293.15
    stored = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(1000.0, 0.3))
    C = (ufl.Identity(2) + ufl.grad(u)).T * (ufl.Identity(2) + ufl.grad(u))
    source = fem.Constant(msh, 0.0)
    flux = ufl.sqrt(ufl.det(C)) * ufl.inv(C) * ufl.grad(T)
    top, up = fem.Function(V), fem.locate_dofs_topological(V, 1, tags.find(2))
    cold = fem.locate_dofs_topological(W, 1, tags.find(2))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0, 0), (0, 1)), ff.Coulomb(0.3)
    )
    problem = ff.FrictionalContactProblem(
        [
            ufl.derivative(ff.bulk.stored_energy(stored, ufl.dx), u, v),
            ufl.inner(flux, ufl.grad(q)) * ufl.dx - source * q * ufl.dx,
            (damage - (T - outside)) * e * ufl.dx,
        ],
        [u, T, damage],
        contact=contact,
        bcs=[fem.dirichletbc(top, up), fem.dirichletbc(outside, cold, W)],
        petsc_options_prefix="isothermal_",
    )
    for heat, push in ((0.0, -0.01), (0.0, -0.02), (1e-3, -0.02), (1.0, -0.02)):
        source.value, top.x.array[1::2] = heat, push
        report = problem.solve()
        assert report.certified and report.iterations < 8
        assert np.max(T.x.array) - outside == pytest.approx(0.49 * heat, rel=0.05, abs=1e-11)


def test_a_weak_source_that_is_switched_on_is_not_overlooked():
    """It warms the body by 0.125 K, all of it beyond the tolerance beside 300 K."""
    problem, T, exact = warm("weak_", 5e-4, 400.0, 300.0, held=False)
    assert problem.solve().certified
    assert np.max(T.x.array) - 300.0 == pytest.approx(np.max(exact.x.array) - 300.0, rel=1e-3)


def test_an_equation_on_a_part_of_the_body():
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0))
    half = np.sort(mesh.locate_entities(msh, 2, lambda x: x[1] <= 0.5 + 1e-9))
    part, cells = mesh.create_submesh(msh, 2, half)[:2]
    dx = ufl.Measure("dx", domain=msh, subdomain_data=mesh.meshtags(msh, 2, half, 5))(5)
    V, W = fem.functionspace(msh, ("Lagrange", 1, (2,))), fem.functionspace(part, ("Lagrange", 1))
    u, v, T, q = fem.Function(V), ufl.TestFunction(V), fem.Function(W), ufl.TestFunction(W)
    stored = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(stored, ufl.dx), u, v) - 0.1 * T * ufl.div(v) * dx
    top, up = fem.Function(V), fem.locate_dofs_topological(V, 1, tags.find(2))
    top.x.array[1::2] = -0.01
    cold = fem.locate_dofs_geometrical(W, lambda x: np.isclose(x[1], 0.5))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0, 0), (0, 1)), ff.Coulomb(0.3)
    )
    problem = ff.FrictionalContactProblem(
        [F, ufl.inner(ufl.grad(T), ufl.grad(q)) * dx - q * dx],
        [u, T],
        contact=contact,
        bcs=[fem.dirichletbc(top, up), fem.dirichletbc(0.0, cold, W)],
        petsc_options_prefix="part_",
        entity_maps=[cells],
    )
    report = problem.solve()
    assert report.certified and report.iterations < 8
    largest = problem.comm.allreduce(np.max(T.x.array), MPI.MAX)
    assert largest == pytest.approx(0.125, rel=0.1)
