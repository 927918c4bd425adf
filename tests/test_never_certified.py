"""Wrong models as users write them: each ends in an error or a warning, never in a certificate."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import stack
from models import block, tagged_facets, with_contact

pytestmark = pytest.mark.mpi
PRESSED = -0.01


def pressed_block(
    *,
    element=("Lagrange", 1, (2,)),
    cell="quadrilateral",
    change_mesh=lambda msh: None,
    condition=lambda V: V,
    contact_tags=lambda tags: tags,
    load=None,
    obstacle=None,
    friction=0.3,
    prefix="never_",
):
    """A unit square on a plane, its top pressed down; returns the force."""
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4, getattr(mesh.CellType, cell))
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(x[1], 0.0),
        lambda x: np.isclose(x[1], 1.0),
        lambda x: np.isclose(x[0], 0.0),
    )
    change_mesh(msh)
    V = fem.functionspace(msh, element)
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    if load is not None:
        F -= load(msh, tags, v)
    W = condition(V)
    top = fem.Function(W)
    top.x.array[1::2] = PRESSED
    dofs = fem.locate_dofs_topological(W, 1, tags.find(2))
    contact = ff.Contact(
        ff.ContactSurface(msh, contact_tags(tags), 1),
        obstacle(msh) if obstacle else ff.RigidPlane((0, 0), (0, 1)),
        ff.Coulomb(friction) if isinstance(friction, float) else friction(msh),
    )
    problem = ff.FrictionalContactProblem(
        F, u, contact=contact, bcs=fem.dirichletbc(top, dofs), petsc_options_prefix=prefix
    )
    report = problem.solve()
    assert report.certificate.certified
    return report.contacts[0].force[1]


def refused(match):
    return pytest.raises(ff.ContactInputError, match=match)


def test_the_right_model_is_certified():
    """Its force lies between those of a free and of a confined block in plane strain."""
    assert 10.99 < pressed_block() < 13.46


# -- elements ------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_higher_displacements(cell, degree):
    """By collocation at the vertices the force was 5 to 20 % too small."""
    force = pressed_block(element=("Lagrange", degree, (2,)), cell=cell)
    assert 10.99 < force < pressed_block(cell=cell)


def test_one_gauss_point_a_cell():
    """Hourglass modes carry no force: the block would rest on nothing."""
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 2, 2, mesh.CellType.quadrilateral)
    u = fem.Function(fem.functionspace(msh, ("Lagrange", 1, (2,))))
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.3))
    with refused("could deform without energy"):
        ff.bulk.stored_energy(density, ufl.dx, degree=1)


# -- conditions and loads ------------------------------------------------------------------------


def test_a_condition_on_an_equal_space():
    with refused(r"bcs\[0\] is on a space that is none of the unknowns'"):
        pressed_block(condition=lambda V: fem.functionspace(V.mesh, ("Lagrange", 1, (2,))))


def test_a_condition_without_dofs():
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 2, 2)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1.0, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, ufl.TestFunction(V))
    nowhere = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 5.0))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0, 0), (0, 1)), ff.Coulomb(0.3)
    )
    with refused(r"bcs\[0\] has no dofs on any rank"):
        ff.FrictionalContactProblem(
            F,
            u,
            contact=contact,
            bcs=fem.dirichletbc(np.zeros(2), nowhere, V),
            petsc_options_prefix="nowhere_",
        )


@pytest.mark.parametrize(
    ("load", "match"),
    [
        (lambda msh, t, v: v[0] * ufl.Measure("ds", msh, subdomain_data=t)(8), "would be lost"),
        (lambda msh, t, v: v[0] * ufl.ds(3), "without subdomain_data"),
    ],
)
def test_loads_that_would_be_lost(load, match):
    with refused(match):
        pressed_block(load=load)


# -- meshes --------------------------------------------------------------------------------------


def test_tags_of_another_mesh():
    """Its facets have the same numbers as other facets of this boundary."""

    def of_another(tags):
        other = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4, mesh.CellType.quadrilateral)
        return mesh.meshtags(other, 1, tags.indices, tags.values)

    with refused("tags are those of another mesh"):
        pressed_block(contact_tags=of_another)


def test_a_motion_of_another_mesh():
    def obstacle(msh):
        other = mesh.create_unit_square(MPI.COMM_WORLD, 1, 1)
        return ff.RigidPlane((0, 0), (0, 1), motion=ff.RigidMotion(other))

    with refused("made with another mesh"):
        pressed_block(obstacle=obstacle)


def test_friction_of_another_mesh():
    def friction(msh):
        other = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4)
        mu = fem.Function(fem.functionspace(other, ("Lagrange", 1)))
        mu.x.array[:] = 0.3
        return ff.Coulomb(mu)

    with refused("of another mesh"):
        pressed_block(friction=friction)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_a_folded_mesh(cell):
    def fold(msh):
        x = msh.geometry.x
        x[np.isclose(x[:, 0], 0.5) & np.isclose(x[:, 1], 0.5), 0] = 1.3

    with refused(r"Cell \d+ .*(inverted|folded)"):
        pressed_block(cell=cell, change_mesh=fold)


# -- two bodies ----------------------------------------------------------------------------------


def test_a_primary_surface_on_another_mesh():
    lower = stack(0.3, "lower_", cell="quadrilateral", **SQUARES)
    with refused("on another mesh than the secondary"):
        stack(
            0.3,
            "upper_",
            cell="quadrilateral",
            obstacle=ff.DeformableObstacle(lower.contact.obstacle.primary),
            **SQUARES,
        )


def test_a_surface_that_meets_itself():
    model = stack(0.3, "once_", cell="quadrilateral", **SQUARES)
    surface = model.contact.surface
    contact = ff.Contact(surface, ff.DeformableObstacle(surface), ff.Coulomb(0.3))
    with refused("facets in common"):
        with_contact(model, contact, "itself_")


SQUARES = {
    "upper": (2, 2),
    "lower": (2, 2),
    "top": ((0.0, 1.0), (1.0, 2.0)),
    "base": ((0.0, 0.0), (1.0, 1.0)),
}


# -- obstacles without a normal ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("obstacle", "match"),
    [
        (lambda msh: ff.ImplicitObstacle(lambda X: X[1] ** 2), "ImplicitObstacle .* no normal at"),
        (lambda msh: ff.ImplicitObstacle(lambda X: 0.0), "does not depend on the point"),
        (lambda msh: ff.RigidSphere((0.5, 0.0), 0.1), r"RigidSphere .* at node \(0.5, 0, 0\)"),
    ],
)
def test_obstacles_without_a_normal(obstacle, match):
    """They are named, not the loads."""
    with refused(match):
        pressed_block(obstacle=obstacle)


class Weakening(ff.FrictionLaw):
    """Friction that turns negative once the node has slid far."""

    def limit(self, pressure, sliding):
        return (0.3 - 30.0 * sliding.path) * pressure


class Driving(ff.FrictionLaw):
    """A law of its own row that pushes along the slip."""

    def limit(self, pressure, sliding):
        return 0.3 * pressure

    def row(self, s, c_t, limit, r, eps):
        return c_t - limit * s / ufl.sqrt(ufl.dot(s, s) + 1e-20)


@pytest.mark.parametrize(
    ("law", "match"),
    [
        (Weakening(), "no certified solution"),
        pytest.param(Driving(), "limit or the dissipation is negative", marks=pytest.mark.mpi),
    ],
)
def test_friction_that_drives(law, match):
    model = block("hexahedron", 0.3, f"drives_{type(law).__name__}_")
    contact = ff.Contact(model.contact.surface, model.contact.obstacle, law)
    problem = with_contact(model, contact, f"law_{type(law).__name__}_")
    model.move(0.0, 0.0, -0.01)
    with pytest.raises(ff.StepFailed, match=match):
        problem.solve()
        model.move(0.05, 0.0, -0.01)
        problem.solve()


# -- a corner between rough obstacles --------------------------------------------------------------

#: Where the floor and the wall go (m).
JAMMING = [
    ((0.0, 0.01), (0.0, 0.0)),
    ((0.01, 0.01), (-0.003, 0.0)),
    ((0.03, 0.012), (-0.01, 0.005)),
    ((-0.03, 0.012), (-0.01, -0.02)),
    ((0.0, -0.01), (0.01, 0.0)),
]


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore:Step .* has at least 2 certified solutions")
@pytest.mark.parametrize("solver", ["auto", "full"])
@pytest.mark.parametrize(("mu", "E", "size"), [(20.0, 1e3, 1.0), (2.0, 1e-6, 1e6), (2.0, 1e3, 1.0)])
def test_a_corner_that_jams_hides_no_penetration(mu, E, size, solver):
    """A node on floor and wall can carry any pair of tractions where ``mu**2 > 1``.

    Of 1e11 times Young's modulus, they were the scale of all that was measured. Whether such a pair
    is found as a second solution depends on rounding.
    """
    msh = mesh.create_rectangle(
        MPI.COMM_WORLD, [[0.0, 0.0], [size, size]], [16, 4], mesh.CellType.quadrilateral
    )
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(x[1], 0.0),
        lambda x: np.isclose(x[1], size),
        lambda x: np.isclose(x[0], size) & (x[1] <= 0.51 * size),
    )
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, 0.3))
    motions = [ff.RigidMotion(msh), ff.RigidMotion(msh)]
    planes = [
        ff.RigidPlane((0.0, 0.0), (0.0, 1.0), motion=motions[0]),
        ff.RigidPlane((1.001 * size, 0.0), (-1.0, 0.0), motion=motions[1]),
    ]
    contacts = [
        ff.Contact(ff.ContactSurface(msh, tags, tag, name), plane, ff.Coulomb(mu))
        for tag, name, plane in zip((1, 3), ("floor", "wall"), planes, strict=True)
    ]
    held = fem.locate_dofs_topological(V, 1, tags.find(2))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=contacts,
        bcs=fem.dirichletbc(np.zeros(2), held, V),
        petsc_options_prefix="jam_",
        settings=ff.StepSettings(solver=solver, raise_on_uncertified=False),
    )
    certified = 0
    for places in JAMMING:
        for motion, place in zip(motions, places, strict=True):
            motion.translation.value = size * np.array(place)
        report = problem.solve()
        if not report.certified:
            continue
        certified += 1
        for k in contacts:
            tractions = abs(k.multipliers()).max(initial=0.0)
            assert np.min(k.pairing.gaps(), initial=0.0) > -1e-9 * size
            assert tractions < 100.0 * E
    assert certified >= 3
