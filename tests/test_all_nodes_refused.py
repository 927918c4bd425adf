"""What is refused where multipliers are at all nodes of a quadratic displacement."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.verification.exact import ExactReference
from models import tagged_facets
from test_weighted import block, plane

mpi = pytest.mark.mpi
E, NU = 1000.0, 0.3


def all_nodes(cell, n, obstacle, mu=0.3, **options):
    """The block of the averages, with multipliers at all nodes."""
    return block(cell, n, obstacle, mu, surface_degree=2, **options)


@mpi
@pytest.mark.parametrize(("height", "what"), [(0.19, "deep in the faces"), (0.6, "went through")])
def test_a_ball_between_the_nodes_is_no_open_contact(height, what):
    """It is in a face after the step, or has gone right through: no node has seen it."""
    model = all_nodes("triangle", 3, lambda msh: small_ball(0.03), 0.0, name="small_")
    model.move(0.0, -height)
    with pytest.raises(ff.StepFailed, match=what):
        model.problem.solve()


def small_ball(radius):
    """A ball under the first point of quadrature of the middle face, between two nodes."""
    x = (1.0 + 0.5 * (1.0 - np.sqrt(0.6))) / 3.0
    return ff.ImplicitObstacle(lambda X: ufl.sqrt((X[0] - x) ** 2 + (X[1] + 0.2) ** 2) - radius)


@mpi
def test_nodes_without_a_weight_are_refused():
    msh = mesh.create_unit_cube(MPI.COMM_WORLD, 2, 2, 2)
    tags = tagged_facets(msh, lambda x: np.isclose(x[2], 0.0))
    with pytest.raises(ff.ContactInputError, match=r"integrals of the vertices.* are zero"):
        ff.ContactSurface(msh, tags, 1, degree=2)
    with pytest.raises(ff.ContactInputError, match=r"degree = 3 must be 1 .* or 2"):
        ff.ContactSurface(msh, tags, 1, degree=3)
    with pytest.raises(ff.ContactInputError, match=r"degree = 2.0 must be an integer"):
        ff.ContactSurface(msh, tags, 1, degree=2.0)


@pytest.mark.parametrize("degree", [1, 3])
def test_nodes_that_are_not_those_of_the_displacement_are_refused(degree):
    with pytest.raises(
        ff.ContactInputError, match=rf"degree = 2 needs a displacement.* it has degree {degree}"
    ):
        all_nodes("triangle", 2, plane(2), degree=degree, name="other_")


@pytest.mark.parametrize("first", [1, 2])
def test_deformable_bodies_meet_at_vertices(first):
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 3, 3)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0))
    u = fem.Function(fem.functionspace(msh, ("Lagrange", 2, (2,))))
    F = ufl.derivative(ufl.inner(ufl.grad(u), ufl.grad(u)) * ufl.dx, u)
    low, top = (
        ff.ContactSurface(msh, tags, k, f"s{k}", degree=2 if k == first else 1) for k in (1, 2)
    )
    contact = ff.Contact(low, ff.DeformableObstacle(top), ff.Coulomb(0.3))
    with pytest.raises(ff.ContactInputError, match=rf"'s{first}' has degree = 2.*only meets rigid"):
        ff.FrictionalContactProblem(F, u, contact=contact, petsc_options_prefix="two_")


def test_friction_of_an_unknown_without_values_at_all_nodes_is_refused():
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 3, 3)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0))
    V, W = fem.functionspace(msh, ("Lagrange", 2, (2,))), fem.functionspace(msh, ("Lagrange", 1))
    u, heat, w = fem.Function(V), fem.Function(W), ufl.TestFunction(W)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, ufl.TestFunction(V))
    surface = ff.ContactSurface(msh, tags, 1, degree=2)
    top = fem.locate_dofs_topological(V, 1, tags.find(2))
    problem = ff.FrictionalContactProblem(
        [F, (heat - 0.5) * w * ufl.dx],
        [u, heat],
        contact=ff.Contact(surface, plane(2), ff.Coulomb(0.3 + 0.1 * heat)),
        bcs=[fem.dirichletbc(np.array([0.0, -0.01]), top, V)],
        petsc_options_prefix="heat_",
    )
    with pytest.raises(ff.ContactInputError, match="without a dof at each contact node"):
        problem.solve()


@pytest.mark.parametrize("degree", [1, 2])
def test_gaps_with_fields_of_the_surface_are_refused(degree):
    """They have no values where the obstacle is looked for between the nodes."""
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 3, 3)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0))
    surface = ff.ContactSurface(msh, tags, 1, degree=2)
    f = fem.Function(fem.functionspace(surface.submesh, ("Lagrange", degree)))
    u = fem.Function(fem.functionspace(msh, ("Lagrange", 2, (2,))))
    F = ufl.derivative(ufl.inner(ufl.grad(u), ufl.grad(u)) * ufl.dx, u)
    contact = ff.Contact(surface, ff.ImplicitObstacle(lambda X: X[1] - f), ff.Frictionless())
    with pytest.raises(ff.ContactInputError, match="not known at points between the nodes"):
        ff.FrictionalContactProblem(F, u, contact=contact, petsc_options_prefix="gap_")


def test_the_exact_reference_knows_no_averages():
    model = block("triangle", 2, plane(2), comm=MPI.COMM_SELF, name="reference_")
    with pytest.raises(ff.ContactInputError, match=r"not on average: .* degree=2"):
        ExactReference(model.problem)
