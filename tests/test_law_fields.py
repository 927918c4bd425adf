"""What laws, gaps and further equations may be made of: right values at the nodes, or an error."""

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from dragged import DEPTH, PRESSURE, dragged
from fenicsx_friction.base.literals import lifted_form
from models import tagged_facets

PRESSED, MOVED = (0.0, -DEPTH), (0.05, -DEPTH)


def slid(make_law, prefix):
    """Press a block and drag it until all nodes slide; return x, traction over pressure."""
    model = dragged(make_law, prefix)
    model.move(*PRESSED)
    assert model.move(*MOVED).certified
    x, pressure, traction, *_ = model.nodes()
    order = np.argsort(x[:, 0])
    return x[order, 0], (abs(traction[:, 0]) / pressure)[order]


def of_field(element, value, *, surface):
    """Return what makes a law whose coefficient is a field of an element."""

    def make(msh, contact_surface):
        where = contact_surface.submesh if surface else msh
        f = fem.Function(fem.functionspace(where, element))
        f.interpolate(value)
        return ff.Coulomb(f)

    return make


@pytest.mark.mpi
@pytest.mark.parametrize("surface", [True, False])
@pytest.mark.parametrize("element", [("Lagrange", 1), ("Lagrange", 2), ("DG", 0), ("DG", 1)])
def test_coefficients_of_any_element_have_their_values_at_the_nodes(element, surface):
    """Elements without a value at the nodes count with their mean over the facets round them."""
    x, mu = slid(
        of_field(element, lambda x: 0.2 + 0.1 * x[0], surface=surface),
        f"{element[0]}{element[1]}{surface}_",
    )
    right = 0.2 + 0.1 * x
    if element == ("DG", 0):  # the middle of the facet, or of two
        right[0], right[-1] = 0.2125, 0.2875
    assert mu == pytest.approx(right, rel=1e-9)


def test_a_closed_surface_has_as_many_facets_as_nodes():
    """A constant on each facet is not taken for a value at each node."""
    msh = mesh.create_unit_square(MPI.COMM_SELF, 3, 3, mesh.CellType.quadrilateral)
    tags = tagged_facets(msh, lambda x: np.full(x.shape[1], True))
    surface = ff.ContactSurface(msh, tags, 1)
    mu = fem.Function(fem.functionspace(surface.submesh, ("DG", 0)))
    assert mu.x.array.size == surface.num_owned
    mu.interpolate(lambda x: 0.1 + 0.2 * x[0])
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.0))
    contact = ff.Contact(surface, ff.RigidPlane((0, -1), (0, 1)), ff.Coulomb(mu))
    ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(top, fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1)))],
        petsc_options_prefix="closed_",
    )
    inside = np.isclose(surface.x[:, 1], 0.0) & (surface.x[:, 0] > 0.1) & (surface.x[:, 0] < 0.9)
    limits = contact.friction_at_unit_pressure()[inside]
    assert limits == pytest.approx(0.1 + 0.2 * surface.x[inside, 0], rel=1e-12)


def test_parts_of_mixed_and_vector_fields():
    def make(msh, _):
        f = fem.Function(fem.functionspace(msh, ("Lagrange", 1, (2,))))
        f.interpolate(lambda x: np.stack([0.2 + 0.1 * x[0], 5.0 + x[0]]))
        return ff.Coulomb(f.sub(0))

    x, mu = slid(make, "part_")
    assert mu == pytest.approx(0.2 + 0.1 * x, rel=1e-9)


def test_symmetric_tensors():
    def make(msh, _):
        element = basix.ufl.element("Lagrange", msh.basix_cell(), 1, shape=(2, 2), symmetry=True)
        f = fem.Function(fem.functionspace(msh, element))
        f.interpolate(
            fem.Expression(
                ufl.as_tensor([[0.2, 0.1], [0.1, 0.4]]) * (1.0 + ufl.SpatialCoordinate(msh)[0]),
                f.function_space.element.interpolation_points,
            )
        )
        return ff.Coulomb(f[0, 1])

    x, mu = slid(make, "symmetric_")
    assert mu == pytest.approx(0.1 * (1.0 + x), rel=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("what", ["gradient", "normal"])
def test_derivatives_and_normals_of_the_surface_are_refused(what, dim):
    def make(msh, surface):
        g = fem.Function(surface.S)
        parts = {"gradient": ufl.grad(g)[0], "normal": ufl.CellNormal(surface.submesh)[0]}
        return ff.Coulomb(abs(parts[what]))

    with pytest.raises(ff.ContactInputError, match="normals and derivatives there are not known"):
        dragged(make, f"refused{what}{dim}_", dim=dim)


@pytest.mark.parametrize("wrong", ["test function", "single precision"])
def test_what_has_no_values_here_is_refused(wrong):
    def make(msh, surface):
        if wrong == "test function":
            return ff.Coulomb(abs(ufl.TestFunction(surface.S)))
        half = mesh.create_rectangle(MPI.COMM_WORLD, [[0, 0], [1, 1]], [4, 2], dtype=np.float32)
        return ff.Coulomb(fem.Function(fem.functionspace(half, ("DG", 0)), dtype=np.float32))

    words = {"test function": "a test or trial function", "single precision": "of type float32"}
    with pytest.raises(ff.ContactInputError, match=words[wrong]):
        dragged(make, "valueless_")


# -- metrics -----------------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize(
    "entries",
    [
        [[0.0, 0.3], [-0.3, 0.0]],
        [[0.3, 0.2], [0.0, 0.3]],
        [[-0.3, 0], [0, -0.3]],
        [[0.3, 0], [0, 0]],
    ],
)
def test_a_metric_that_is_not_symmetric_and_positive_is_refused(entries):
    """Friction would drive the slip."""

    class Turning(ff.FrictionLaw):
        def limit(self, pressure, sliding):
            return pressure

        def metric(self, sliding):
            return ufl.as_matrix(entries)

    singular = np.linalg.det(entries) == 0.0 and entries[1][1] == 0
    words = "inverse of Turning.metric.* by zero" if singular else "symmetric and positive definite"
    with pytest.raises(ff.ContactInputError, match=f"(?i){words}"):
        dragged(lambda *_: Turning(), "turning_", dim=3).move(0.0, 0.0, -DEPTH)


# -- held obliquely ----------------------------------------------------------------------------


LAWS = {
    "Coulomb": lambda p, s: 0.3 * p,
    "film": lambda p, s: 20.0 * s.rate,
    "threshold": lambda p, s: 0.3 * ufl.max_value(p - 2.0, 0.0),
    "after a way": lambda p, s: p * s.path,
    "none": lambda p, s: 0.0 * p,
}


@pytest.mark.mpi
@pytest.mark.parametrize("name", LAWS)
def test_oblique_conditions_are_refused_whatever_friction_there_may_be(name):
    class Law(ff.FrictionLaw):
        def limit(self, pressure, sliding):
            return LAWS[name](pressure, sliding)

    msh = mesh.create_rectangle(
        MPI.COMM_WORLD, [[0, 0], [1, 1]], [4, 2], mesh.CellType.quadrilateral
    )
    msh.geometry.x[:, 1] += 0.75 * msh.geometry.x[:, 0]
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(x[1] - 0.75 * x[0], 0.0),
        lambda x: np.isclose(x[1] - 0.75 * x[0], 1.0),
    )
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    top.x.array[1::2] = -DEPTH
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.2))
    across = fem.locate_dofs_topological(V.sub(0), 1, tags.find(1))
    arguments = {
        "contact": ff.Contact(
            ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0, 0), (-0.6, 0.8)), Law()
        ),
        "bcs": [
            fem.dirichletbc(top, fem.locate_dofs_topological(V, 1, tags.find(2))),
            fem.dirichletbc(0.0, across, V.sub(0)),
        ],
        "petsc_options_prefix": f"oblique_{name.split()[0]}_",
    }
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    if name == "none":
        assert ff.FrictionalContactProblem(F, u, **arguments).solve().certified
    else:
        with pytest.raises(ff.ContactInputError, match="neither normal nor tangential"):
            ff.FrictionalContactProblem(F, u, **arguments)


# -- time and motion ---------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [-1.0, 0.0, np.nan, np.inf])
def test_a_step_without_length_is_refused(dt):
    model = dragged(lambda *_: ff.Coulomb(lambda p, s: 0.2 + 0.1 * s.rate), "time_")
    model.move(*PRESSED)
    model.problem.dt.value = dt
    with pytest.raises(ff.ContactInputError, match=r"problem\.dt = .*positive"):
        model.move(*MOVED)
    model.problem.dt.value = 1.0
    assert model.move(*MOVED).certified


def test_a_motion_belongs_to_one_problem():
    """Two would commit its positions one after the other, and the second see no slip."""
    model = dragged(lambda *_: ff.Coulomb(0.3), "owner_")
    problem, surface = model.problem, model.contact.surface
    msh = problem.u.function_space.mesh
    motion = ff.RigidMotion(msh)

    def with_motion(prefix):
        plane = ff.RigidPlane((0, 0), (0, 1), motion=motion)
        return ff.FrictionalContactProblem(
            problem.bulk,
            problem.u,
            contact=ff.Contact(surface, plane, ff.Coulomb(0.3)),
            bcs=problem.bcs,
            petsc_options_prefix=prefix,
        )

    first = with_motion("first_")
    with pytest.raises(ff.ContactInputError, match="RigidMotion of its own"):
        with_motion("second_")
    model.top.x.array[1::2] = -DEPTH
    for way in (0.0, 0.05):
        motion.translation.value = (way, 0.0)
        report = first.solve()
    assert report.contacts[0].force == pytest.approx((0.3 * PRESSURE, PRESSURE), rel=1e-9)
    del first
    with_motion("third_")  # the first one is gone


# -- residuals that are not finite -------------------------------------------------------------


def test_a_law_with_an_infinite_slope_is_named():
    class Root(ff.FrictionLaw):
        def limit(self, pressure, sliding):
            return ufl.sqrt(pressure)

    with pytest.raises(ff.ContactInputError, match="Root or its derivative is not finite"):
        dragged(lambda *_: Root(), "root_", solver="full").move(*PRESSED)
    model = dragged(lambda *_: Root(), "boundary_")  # needs no derivative of lifted conditions
    model.move(*PRESSED)
    assert model.move(*MOVED).certified
    _, pressure, traction, *_ = model.nodes()
    assert abs(traction[:, 0]) == pytest.approx(np.sqrt(pressure), rel=1e-9)


def test_an_obstacle_that_is_nowhere_is_named():
    model = dragged(lambda *_: ff.Coulomb(0.3), "nowhere_")
    motion = ff.RigidMotion(model.problem.u.function_space.mesh)
    plane = ff.RigidPlane((0, 0), (0, 1), motion=motion)
    problem = ff.FrictionalContactProblem(
        model.problem.bulk,
        model.problem.u,
        contact=ff.Contact(model.contact.surface, plane, ff.Coulomb(0.3)),
        bcs=model.problem.bcs,
        petsc_options_prefix="lost_",
    )
    motion.translation.value = (0.0, np.nan)
    with pytest.raises(ff.ContactInputError, match="gap of the RigidPlane of contact"):
        problem.solve()


# -- equations on the surface ------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("in_law", [False, True])
def test_an_unknown_of_the_surface(in_law):
    """Wear proportional to the pressure, with a number in its form; it may change the friction."""
    msh = mesh.create_rectangle(
        MPI.COMM_WORLD, [[0, 0], [1, 1]], [4, 2], mesh.CellType.quadrilateral
    )
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    surface = ff.ContactSurface(msh, tags, 1)
    w, q = fem.Function(surface.S, name="wear"), ufl.TestFunction(surface.S)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.0))
    contact = ff.Contact(
        surface, ff.RigidPlane((0, 0), (0, 1)), ff.Coulomb(0.1 + 0.04 * w if in_law else 0.3)
    )
    wear = (w - 0.25 * contact.c[0]) * q * ufl.dx(surface.submesh)
    problem = ff.FrictionalContactProblem(
        [ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v), wear],
        [u, w],
        contact=contact,
        bcs=[fem.dirichletbc(top, fem.locate_dofs_topological(V, 1, tags.find(2)))],
        petsc_options_prefix=f"wear{in_law}_",
        entity_maps=[surface.entity_map],
    )
    for x in (0.0, 0.05):
        top.x.array[:] = np.tile([x, -DEPTH], len(top.x.array) // 2)
        assert problem.solve().certified
    c, worn = contact.multipliers(), w.x.array[: surface.num_owned]
    assert worn == pytest.approx(0.25 * c[:, 0], rel=1e-9)
    mu = 0.1 + 0.04 * worn if in_law else 0.3
    assert abs(c[:, 1]) == pytest.approx(mu * c[:, 0], rel=1e-9)
    assert ff.check_jacobian(problem).error < 1e-5


def test_numbers_are_lifted_to_the_mesh_of_their_integral():
    msh = mesh.create_unit_square(MPI.COMM_SELF, 2, 2)
    other = mesh.create_unit_square(MPI.COMM_SELF, 2, 2)
    q, p = (ufl.TestFunction(fem.functionspace(m, ("Lagrange", 1))) for m in (msh, other))
    form = lifted_form(0.5 * q * ufl.dx)
    assert [c.ufl_domain() for c in form.constants()] == [msh.ufl_domain()]
    form = lifted_form(0.5 * p * ufl.dx)
    assert [c.ufl_domain() for c in form.constants()] == [other.ufl_domain()]
