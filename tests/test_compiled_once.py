"""A parameter study compiles nothing after its first problem; the numbers are new in each run."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from ffcx.codegeneration import jit

import fenicsx_friction as ff
from bodies import stack
from models import tagged_facets

RNG = np.random.default_rng()


@pytest.fixture
def compiled(monkeypatch):
    """The names of what is compiled from now on."""
    names, original = [], jit._compile_objects

    def counting(*arguments, **options):
        names.append(arguments[2])
        return original(*arguments, **options)

    monkeypatch.setattr(jit, "_compile_objects", counting)
    return names


def solve(prefix, obstacle, law, E, nu, load, motion=(0.0, 0.0)):
    """Press a square on an obstacle, audit included; returns the normal force."""
    msh = mesh.create_unit_square(MPI.COMM_SELF, 3, 3)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E=E, nu=nu))
    stored = ff.bulk.stored_energy(density, ufl.dx)
    F = ufl.derivative(stored, u, v) - load * v[0] * ufl.dx
    top = fem.Function(V)
    top.x.array[1::2] = -0.02
    held = fem.locate_dofs_topological(V, 1, tags.find(2))
    moves = ff.RigidMotion(msh, center=RNG.uniform(-1.0, 1.0, 2))
    moves.translation.value[:] = motion
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1), obstacle(moves), law)
    problem = ff.FrictionalContactProblem(
        F, u, contact=contact, bcs=[fem.dirichletbc(top, held)], petsc_options_prefix=prefix
    )
    audit = ff.EnergyAudit(problem, stored)
    report = problem.solve()
    audit.update()
    assert report.certified
    return report.contacts[0].force[1]


OBSTACLES = {
    "plane": lambda a, b: lambda m: ff.RigidPlane((a, -0.001 * b), (0.0, 1.0), motion=m),
    "circle": lambda a, b: lambda m: ff.RigidSphere((a, -100.0 - b), 100.0 + b, motion=m),
    "gap in UFL": lambda a, b: (
        lambda m: ff.ImplicitObstacle(lambda X: X[1] + 0.01 * b * X[0] ** 2 - 0.001 * a, motion=m)
    ),
}


@pytest.mark.parametrize("name", OBSTACLES)
def test_other_numbers_need_no_other_form(name, compiled):
    def study(k):
        a, b = RNG.uniform(0.2, 0.8, 2)
        mu, adhesion, cap = RNG.uniform(0.1, 0.9), RNG.uniform(0.1, 1.0), RNG.uniform(20.0, 30.0)
        numbers = RNG.uniform(500.0, 2000.0), RNG.uniform(0.1, 0.4), RNG.uniform(0.1, 1.0)
        law = ff.Coulomb(mu, adhesion=adhesion, cap=cap)
        return solve(f"study{k}_", OBSTACLES[name](a, b), law, *numbers, RNG.uniform(0, 1e-3, 2))

    first = study(0)
    compiled.clear()
    others = [study(k) for k in (1, 2)]
    assert compiled == []
    assert len({first, *others}) == 3


def test_other_coefficients_of_pairs_need_no_other_form(compiled):
    for k in range(3):
        if k == 1:
            compiled.clear()
        E, nu = RNG.uniform(500.0, 2000.0), RNG.uniform(0.1, 0.4)
        model = stack(RNG.uniform(0.1, 0.9), f"pairs{k}_", E=E, nu=nu, comm=MPI.COMM_SELF)
        model.move(0.01, 0.0, -0.01)
        assert model.problem.solve().certified
    assert compiled == []


def test_no_friction_and_a_coefficient_of_one_are_numbers_like_others(compiled):
    for k, mu in enumerate((0.5, 0.0, 1.0)):
        if k == 1:
            compiled.clear()
        solve(f"special{k}_", OBSTACLES["plane"](0.5, 0.5), ff.Coulomb(mu), 1000.0, 0.3, 0.5)
    assert compiled == []
