"""Bad input gets a clear error that names the value, on all ranks, before the solve."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.verification.exact import ExactReference
from models import block, raous, tagged_facets, with_contact

PLANE = ff.RigidPlane((0.0, 0.0), (0.0, 1.0))


@pytest.fixture
def square():
    return mesh.create_unit_square(MPI.COMM_WORLD, 4, 4)


def bottom(msh):
    return tagged_facets(msh, lambda x: np.isclose(x[1], 0.0))


def body(msh, u=None):
    """Return displacement and internal residual of an elastic body."""
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u = u or fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1.0, 0.3))
    return u, ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, ufl.TestFunction(V))


def refused(match):
    return pytest.raises(ff.ContactInputError, match=match)


@pytest.mark.quick
@pytest.mark.mpi
def test_surfaces(square):
    tags = bottom(square)
    with refused(r"tag 7 marks no facet; tags present: \[1\]"):
        ff.ContactSurface(square, tags, 7)
    cells = mesh.meshtags(square, 2, np.arange(2, dtype=np.int32), np.ones(2, dtype=np.int32))
    with refused("dimension 2, the facets of this mesh have dimension 1"):
        ff.ContactSurface(square, cells, 1)
    every = np.arange(square.topology.index_map(1).size_local, dtype=np.int32)
    inside = mesh.meshtags(square, 1, every, np.full(len(every), 5, dtype=np.int32))
    with refused("facets of tag 5 lie inside the mesh"):
        ff.ContactSurface(square, inside, 5, name="floor")


@pytest.mark.parametrize("mu", [-0.1, float("nan"), float("inf")])
def test_friction_coefficients(mu, square):
    with refused(r"mu = .* must be >= 0"):
        ff.Coulomb(mu)
    with refused(r"mu = .* must be >= 0"):
        ff.Coulomb(fem.Constant(square, mu))


def test_friction_must_be_scalar(square):
    with refused(r"scalar, its shape is \(2,\)"):
        ff.Coulomb(ufl.SpatialCoordinate(square))


@pytest.mark.mpi
@pytest.mark.parametrize("bad", [-0.25, float("nan")])
def test_friction_fields_are_checked_at_every_node(bad):
    side = raous(4, 4, 0.0, "probe_").contact.surface.mesh
    mu = fem.Function(fem.functionspace(side, ("Lagrange", 1)))
    model = raous(4, 4, 0.5, "field_")
    V = fem.functionspace(model.contact.surface.mesh, ("Lagrange", 1))
    mu = fem.Function(V)
    mu.interpolate(lambda x: np.where(x[0] > 0.035, bad, 0.5))
    model = field_model(model, mu)
    with refused(r">= 0 and finite at every contact node; it is (nan|-0\.25) at \(0\.0[34], 0"):
        model.solve()


def field_model(model, mu):
    """Exchange the friction of a Raous model."""
    contact = ff.Contact(model.contact.surface, PLANE, ff.Coulomb(mu))
    return with_contact(model, contact, "exchanged_", bcs=None)


@pytest.mark.parametrize(
    ("point", "normal", "match"),
    [
        ((0, 0), (0, 0), "has no direction"),
        ((0, 0), (0, float("nan")), "2 or 3 finite numbers"),
        ((0, 0, 0), (0, 1), "sequence of 2 finite numbers; it has 3"),
        ((0, float("inf")), (0, 1), "finite"),
    ],
)
def test_planes(point, normal, match):
    with refused(match):
        ff.RigidPlane(point, normal)


def test_plane_of_another_dimension(square):
    u, F = body(square)
    contact = ff.Contact(
        ff.ContactSurface(square, bottom(square), 1),
        ff.RigidPlane((0, 0, 0), (0, 0, 1)),
        ff.Coulomb(0.1),
    )
    with refused("2 components"):
        ff.FrictionalContactProblem(F, u, contact=contact, petsc_options_prefix="a_")


@pytest.mark.parametrize("E", [0.0, -1.0, float("nan")])
def test_moduli(E):
    with refused("Young's modulus"):
        ff.bulk.Elastic(E, 0.3)


@pytest.mark.parametrize("nu", [0.5, -1.0, 0.7, float("nan")])
def test_poisson_ratios(nu):
    with refused("Poisson's ratio"):
        ff.bulk.Elastic(1.0, nu)


@pytest.mark.parametrize("r_p", [0.0, -1.0, float("nan")])
def test_scales(r_p, square):
    with refused("r_p"):
        ff.Contact(ff.ContactSurface(square, bottom(square), 1), PLANE, ff.Coulomb(0.1), r_p=r_p)


@pytest.mark.quick
@pytest.mark.parametrize(
    "setting",
    [
        {"corrector": "newton"},
        {"ramp_nodes": "some"},
        {"ramp_sign": 0},
        {"tolerance": 0.0},
        {"tolerance": float("nan")},
        {"predictor_iterations": 0},
        {"smoothing": -1.0},
    ],
)
def test_settings(setting):
    with refused(next(iter(setting))):
        ff.StepSettings(**setting)


def problem(square, **changes):
    u, F = body(square)
    contact = ff.Contact(ff.ContactSurface(square, bottom(square), 1), PLANE, ff.Coulomb(0.1))
    arguments = {"F": F, "u": u, "contact": contact, "petsc_options_prefix": "bad_"} | changes
    return ff.FrictionalContactProblem(**arguments)


@pytest.mark.quick
def test_problems(square):
    u, F = body(square)
    scalar = fem.Function(fem.functionspace(square, ("Lagrange", 1)))
    with refused("prefix = '' must be a string that begins with a letter"):
        problem(square, petsc_options_prefix="")
    with refused("at least one Contact"):
        problem(square, contact=[])
    with refused("2 residuals F for 1 unknowns"):
        problem(square, F=[F, F], u=[u])
    with refused("1 components in 2 dimensions"):
        problem(square, u=scalar)
    trial = ufl.derivative(F, u)
    with refused("linear in one test function; this one has 2 arguments"):
        problem(square, F=trial, u=u)
    with refused("not in its unknown's space"):
        problem(square, F=F, u=fem.Function(fem.functionspace(square, ("Lagrange", 1, (2,)))))


def test_discontinuous_displacements(square):
    u, F = body(square, fem.Function(fem.functionspace(square, ("DG", 1, (2,)))))
    V = u.function_space
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1.0, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, ufl.TestFunction(V))
    with refused("is not continuous.*What works are vectors of continuous"):
        problem(square, F=F, u=u)


def test_other_mesh(square):
    other = mesh.create_unit_square(MPI.COMM_WORLD, 3, 3)
    u, F = body(other)
    with refused("another mesh"):
        problem(square, F=F, u=u)


def test_wrong_sign_of_the_residual(square):
    u, F = body(square)
    with refused("no positive stiffness"):
        problem(square, F=-F, u=u)


def test_contact_of_two_problems(square):
    contact = ff.Contact(ff.ContactSurface(square, bottom(square), 1), PLANE, ff.Coulomb(0.1))
    problem(square, contact=contact)
    with refused("already belongs to a problem"):
        problem(square, contact=contact)


@pytest.mark.mpi
def test_nan_load_is_named_before_the_solve():
    model = raous(4, 4, 0.5, "nan_")
    model.pressures[0].value = float("nan")
    with refused("start of step 1 is nan"):
        model.problem.solve()


@pytest.mark.mpi
def test_inverted_cells_are_named_before_the_solve():
    model = block("hexahedron", 0.3, "inverted_", energy="finite")
    model.problem.u.x.array[2::3] = (
        -3.0 * model.problem.u.function_space.tabulate_dof_coordinates()[:, 2]
    )
    with refused("inverted cells"):
        model.problem.solve()


@pytest.mark.mpi
def test_unheld_body_fails_with_advice():
    """No symmetry plane and no friction: the body may float sideways."""
    model = raous(4, 4, 0.0, "float_")
    contact = ff.Contact(model.contact.surface, PLANE, ff.Coulomb(0.0))
    loose = with_contact(model, contact, "loose_", bcs=None)
    with pytest.raises(ff.StepFailed, match="Try"):
        loose.solve()
    assert not np.any(model.problem.u.x.array)


def test_exact_reference_refuses_what_it_cannot_do():
    with refused("linear in u"):
        model = block("hexahedron", 0.3, "curved_", energy="finite", comm=MPI.COMM_SELF)
        model.move(0, 0, -0.05)
        model.problem.solve()
        ExactReference(model.problem).advance()
