"""Wrong inputs as users write them, each with the words that its error must say."""

from functools import cached_property

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.verification.exact import ExactReference
from models import block, tagged_facets, with_contact

NAN, INF = float("nan"), float("inf")


class Setting:
    """An elastic square on a plane, of which a row changes one thing."""

    def __init__(self):
        self.mesh = mesh.create_unit_square(MPI.COMM_WORLD, 2, 2)
        self.tags = tagged_facets(
            self.mesh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0)
        )
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (2,)))
        self.u, self.v = fem.Function(self.V, name="u"), ufl.TestFunction(self.V)
        self.plane, self.law = ff.RigidPlane((0, 0), (0, 1)), ff.Coulomb(0.3)
        self.density = ff.bulk.small_strain_energy(self.u, ff.bulk.Elastic(1.0, 0.3))
        self.energy = ff.bulk.stored_energy(self.density, ufl.dx)
        self.F = ufl.derivative(self.energy, self.u, self.v)

    def surface(self, tag=1, name="contact", tags=None):
        return ff.ContactSurface(self.mesh, self.tags if tags is None else tags, tag, name)

    def contact(self, **changes):
        arguments = {"surface": self.surface(), "obstacle": self.plane, "friction": self.law}
        return ff.Contact(**(arguments | changes))

    def top(self):
        return fem.dirichletbc(
            np.array([0.0, -0.01]),
            fem.locate_dofs_topological(self.V, 1, self.tags.find(2)),
            self.V,
        )

    def problem(self, **changes):
        arguments = {
            "F": self.F,
            "u": self.u,
            "bcs": [self.top()],
            "petsc_options_prefix": "wrong_",
        }
        contact = changes.pop("contact") if "contact" in changes else self.contact()
        return ff.FrictionalContactProblem(**(arguments | {"contact": contact} | changes))

    def with_law(self, law):
        return self.problem(contact=self.contact(friction=law)).solve()

    def with_obstacle(self, obstacle):
        return self.problem(contact=self.contact(obstacle=obstacle)).solve()

    def with_mu(self, mu):
        return self.with_law(ff.Coulomb(mu))

    def with_gap(self, distance):
        return self.with_obstacle(ff.ImplicitObstacle(distance))

    def with_load(self, load):
        return self.problem(F=self.F - load).solve()

    def with_space(self, *element):
        """Take a displacement of another element."""
        u = fem.Function(fem.functionspace(self.mesh, *element))
        F = ufl.derivative(ufl.inner(u, u) * ufl.dx, u)
        return self.problem(F=F, u=u, bcs=[]).solve()

    def scalar(self, msh=None, value=0.3):
        f = fem.Function(fem.functionspace(msh or self.mesh, ("Lagrange", 1)))
        f.x.array[:] = value
        return f

    @property
    def other(self):
        """Another mesh."""
        return mesh.create_unit_square(MPI.COMM_WORLD, 3, 3)

    @property
    def other_tags(self):
        """Tags of an equal mesh, whose facets have the same numbers."""
        return Setting().tags

    @cached_property
    def vector(self):
        return fem.Function(self.V)


class NoLimit(ff.FrictionLaw):
    def limit(self, pressure, sliding):
        return None


class VectorLimit(ff.FrictionLaw):
    def limit(self, pressure, sliding):
        return sliding.x


class OneArgument(ff.FrictionLaw):
    def limit(self, pressure):
        return pressure


class WrongMetric(ff.Coulomb):
    def metric(self, sliding):
        return ufl.Identity(3)


class ScalarRow(ff.Coulomb):
    def row(self, s, c_t, limit, r, eps):
        return s[0]


class UnboundedAtZero(ff.FrictionLaw):
    def limit(self, pressure, sliding):
        return 0.1 * pressure**-0.1


class NoGap(ff.RigidObstacle):
    def shape(self, X):
        return None


def interval(s):
    msh = mesh.create_unit_interval(MPI.COMM_WORLD, 4)
    return ff.ContactSurface(msh, mesh.meshtags(msh, 0, np.array([0], np.int32), 1), 1)


def prisms(s):
    msh = mesh.create_unit_cube(MPI.COMM_WORLD, 1, 1, 1, mesh.CellType.prism)
    return ff.ContactSurface(msh, mesh.meshtags(msh, 2, np.array([0], np.int32), 1), 1)


def single_precision(s):
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 2, 2, dtype=np.float32)
    return ff.ContactSurface(msh, tagged_facets(msh, lambda x: np.isclose(x[1], 0.0)), 1)


def shell(s):
    import basix.ufl

    flat = basix.ufl.element("Lagrange", "triangle", 1, shape=(3,))
    x, cells = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])
    msh = mesh.create_mesh(MPI.COMM_SELF, cells, flat, x)
    return ff.ContactSurface(msh, mesh.meshtags(msh, 1, np.array([0], np.int32), 1), 1)


def in_3d(s, law):
    model = block("tetrahedron", 0.3, "wrong_", n=(1, 1, 1), comm=MPI.COMM_SELF)
    contact = ff.Contact(model.contact.surface, model.contact.obstacle, law)
    return with_contact(model, contact, "wrong_", bcs=None)


def part_of_a_space(s):
    W = fem.functionspace(s.mesh, ("Lagrange", 1, (2,)))
    return s.problem(u=fem.Function(W).sub(0))


def equal_space(s):
    V = fem.functionspace(s.mesh, ("Lagrange", 1, (2,)))
    dofs = fem.locate_dofs_topological(V, 1, s.tags.find(2))
    return s.problem(bcs=[fem.dirichletbc(np.zeros(2), dofs, V)]).solve()


def collapsed_space(s):
    W, _ = s.V.sub(1).collapse()
    dofs = fem.locate_dofs_topological(W, 1, s.tags.find(2))
    return s.problem(bcs=[fem.dirichletbc(0.0, dofs, W)]).solve()


def empty_condition(s):
    nothing = fem.dirichletbc(np.zeros(2), np.array([], dtype=np.int32), s.V)
    return s.problem(bcs=[s.top(), nothing]).solve()


def two_tags_of_one_number(s):
    other = tagged_facets(s.mesh, lambda x: np.isclose(x[0], 0.0), lambda x: np.isclose(x[0], 1.0))
    ds, other_ds = (ufl.Measure("ds", domain=s.mesh, subdomain_data=t) for t in (s.tags, other))
    return s.with_load(s.v[1] * ds(2) + s.v[1] * other_ds(2))


def ds(s, tags=None):
    return ufl.Measure("ds", domain=s.mesh, subdomain_data=s.tags if tags is None else tags)


def complex_function(s):
    return s.problem(u=fem.Function(s.V, dtype=np.complex128))


def audit(s, *arguments):
    return ff.EnergyAudit(s.problem(), *arguments)


def same_contact(s):
    contact = s.contact()
    return s.problem(contact=[contact, contact])


def pair(s, primary, search=None, secondary=None):
    obstacle = ff.DeformableObstacle(primary, search=search)
    return s.problem(contact=s.contact(obstacle=obstacle, surface=secondary or s.surface()))


def other_body(s):
    t = Setting()
    return pair(s, t.surface(2))


def sphere_around_a_node(s):
    return s.with_obstacle(ff.RigidSphere((0.5, 0.0), 0.25))


def moved(s, **arguments):
    return s.with_obstacle(
        ff.RigidPlane((0, 0), (0, 1), motion=ff.RigidMotion(s.mesh, **arguments))
    )


def mu_of_another_surface(s):
    other = s.surface(2)
    return s.with_mu(s.scalar(other.submesh))


def elastic_of_another_mesh(s):
    D = fem.functionspace(s.other, ("DG", 0))
    E = fem.Function(D)
    E.x.array[:] = 1.0
    density = ff.bulk.small_strain_energy(s.u, ff.bulk.Elastic(E, 0.3))
    return s.problem(F=ufl.derivative(ff.bulk.stored_energy(density, ufl.dx(s.mesh)), s.u, s.v))


def stress(s, degree):
    return ff.bulk.stored_energy(s.density, ufl.dx, degree=degree)


def quadrilateral_energy(degree):
    msh = mesh.create_unit_square(MPI.COMM_SELF, 1, 1, mesh.CellType.quadrilateral)
    u = fem.Function(fem.functionspace(msh, ("Lagrange", 1, (2,))))
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1.0, 0.3))
    return ff.bulk.stored_energy(density, ufl.dx, degree=degree)


def on_infinite_mu(s):
    mu = s.scalar()
    mu.x.array[np.isclose(mu.function_space.tabulate_dof_coordinates()[:, 0], 0.5)] = INF
    return s.with_mu(mu)


def reference(s):
    return ExactReference(None)
