"""Friction that depends on a further unknown, heat that depends on contact: exact tangents."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from models import tagged_facets

WARM, CONDUCTANCE = 40.0, 0.02


def hot_block(prefix, cell="quadrilateral"):
    """A block that is warm at its top; the base takes heat in proportion to the pressure."""
    kind = getattr(mesh.CellType, cell)
    msh = mesh.create_rectangle(MPI.COMM_WORLD, [[0, 0], [1, 0.5]], [6, 3], kind)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 0.5))
    V, W = fem.functionspace(msh, ("Lagrange", 1, (2,))), fem.functionspace(msh, ("Lagrange", 1))
    u, v, T, q = fem.Function(V), ufl.TestFunction(V), fem.Function(W), ufl.TestFunction(W)
    surface = ff.ContactSurface(msh, tags, 1)
    law = ff.Coulomb(0.5 - 0.4 * T / WARM)
    contact = ff.Contact(surface, ff.RigidPlane((0.0, 0.0), (0.0, 1.0)), law)
    stored = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.3))
    ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
    heat = ufl.inner(ufl.grad(T), ufl.grad(q)) * ufl.dx + CONDUCTANCE * contact.c[0] * T * q * ds(1)
    top = fem.Function(V)
    held = fem.locate_dofs_topological(V, 1, tags.find(2))
    warm = fem.locate_dofs_topological(W, 1, tags.find(2))
    problem = ff.FrictionalContactProblem(
        [ufl.derivative(ff.bulk.stored_energy(stored, ufl.dx), u, v), heat],
        [u, T],
        contact=contact,
        bcs=[fem.dirichletbc(top, held), fem.dirichletbc(WARM, warm, W)],
        petsc_options_prefix=prefix,
    )

    def move(x, y):
        top.x.array[:] = np.tile([x, y], len(top.x.array) // 2)
        return problem.solve()

    return problem, contact, T, move


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_friction_of_an_unknown_temperature(cell):
    problem, contact, T, move = hot_block(f"hot_{cell}_", cell)
    assert move(0.0, -0.02).certified
    report = move(0.2, -0.02)
    assert report.certified and report.iterations < 15
    assert report.contacts[0].slip == 7
    nodal, n = contact.nodal(), contact.surface.num_owned
    at = T.x.array[contact.surface.parent_dofs(T.function_space)[:n]]
    assert np.all((at > 0.0) & (at < WARM))
    mu = 0.5 - 0.4 * at / WARM
    assert abs(nodal.c[:, 1]) == pytest.approx(mu * nodal.c[:, 0], rel=1e-9)
    spread = problem.comm.allreduce(np.max(mu, initial=0.0), MPI.MAX)
    spread -= problem.comm.allreduce(np.min(mu, initial=1.0), MPI.MIN)
    assert spread > 1e-3


@pytest.mark.mpi
def test_tangent_of_friction_and_heat():
    problem, _, _, move = hot_block("hot_tangent_")
    move(0.0, -0.02)
    move(0.01, -0.02)
    report = ff.check_jacobian(problem)
    assert report.error < 1e-6, str(report)


def test_friction_of_an_unknown_without_nodal_values_is_refused():
    problem, contact, _, _ = hot_block("hot_refused_")
    msh, u = problem.u.function_space.mesh, problem.u
    D = fem.functionspace(msh, ("DG", 0))
    damage, e = fem.Function(D), ufl.TestFunction(D)
    again = ff.Contact(contact.surface, contact.obstacle, ff.Coulomb(0.3 + 0.1 * damage))
    other = ff.FrictionalContactProblem(
        [problem.bulk, (damage - 0.5) * e * ufl.dx],
        [u, damage],
        contact=again,
        bcs=problem.bcs[:1],
        petsc_options_prefix="hot_other_",
    )
    with pytest.raises(ff.ContactInputError, match="without a dof at each contact node"):
        other.solve()
