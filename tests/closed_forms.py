"""Problems with closed forms: formulas, graded meshes and an indented block."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from models import tagged_facets

#: Young's modulus (MPa) and indenter radius (mm): the contact half-width is about 1 mm.
E, RADIUS = 1000.0, 100.0
#: From this Poisson's ratio on the block is made of mean-dilatation elements.
INCOMPRESSIBLE = 0.49


def ellipse(x, size):
    """Return ``sqrt(1 - x²/size²)`` inside ``size`` and zero outside."""
    return np.sqrt(np.maximum(1.0 - (x / size) ** 2, 0.0))


@dataclass(frozen=True)
class Hertz:
    """Hertz contact of an elastic half-space with a rigid cylinder (2D) or sphere (3D).

    K. L. Johnson, Contact Mechanics (1985), eqs. (4.43)-(4.45) for the line (force a unit length)
    and (4.22)-(4.24) for the point.
    """

    dim: int
    force: float
    nu: float

    @property
    def modulus(self) -> float:
        return E / (1.0 - self.nu**2)

    @property
    def a(self) -> float:
        """Half-width or radius of contact."""
        if self.dim == 2:
            return 2.0 * np.sqrt(self.force * RADIUS / (np.pi * self.modulus))
        return np.cbrt(0.75 * self.force * RADIUS / self.modulus)

    @property
    def p0(self) -> float:
        """Largest pressure."""
        line = 2.0 * self.force / (np.pi * self.a)
        return line if self.dim == 2 else 1.5 * self.force / (np.pi * self.a**2)

    def pressure(self, r):
        return self.p0 * ellipse(r, self.a)

    def stick(self, share: float) -> float:
        """Cattaneo-Mindlin stick half-width or radius under ``Q = share mu P``, Johnson 7.2."""
        return self.a * (1.0 - share) ** (1.0 / self.dim)

    def traction(self, r, mu: float, size: float):
        """Elliptic traction that slips to ``size``; Cattaneo-Mindlin is ``f(a) - f(c)``."""
        return mu * self.p0 * size / self.a * ellipse(r, size)


def graded(n: int, fine: float, far: float, growth: float):
    """Return positions from 0 with step ``1/n`` up to ``fine``, then growing up to ``far``."""
    even = np.arange(round(fine * n) + 1) / n
    steps = [growth / n]
    while sum(steps) < far - even[-1] - 0.5 * steps[-1]:
        steps.append(steps[-1] * growth)
    outer = np.cumsum(steps) / sum(steps)
    return np.concatenate([even, even[-1] + outer * (far - even[-1])])


def tensor_mesh(*axes, comm=MPI.COMM_WORLD) -> mesh.Mesh:
    """Return the quadrilateral or hexahedral grid with these positions on the axes."""
    cells = [len(axis) - 1 for axis in axes]
    corners = [[0.0] * len(axes), [float(n) for n in cells]]
    if len(axes) == 2:
        msh = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)
    else:
        msh = mesh.create_box(comm, corners, cells, mesh.CellType.hexahedron)
    for k, axis in enumerate(axes):
        msh.geometry.x[:, k] = axis[np.rint(msh.geometry.x[:, k]).astype(int)]
    return msh


@dataclass
class Indentation:
    """A block held at its bottom, pressed from above by a rigid obstacle."""

    problem: ff.FrictionalContactProblem
    contact: ff.Contact
    motion: ff.RigidMotion
    mu: fem.Constant
    nu: float
    copies: int

    def move(self, sideways: float, down: float) -> ff.StepReport:
        self.motion.translation.value[0] = sideways
        self.motion.translation.value[-1] = -down
        return self.problem.solve()

    def tractions(self) -> "Tractions":
        """Return the nodal tractions on all ranks."""
        surface = self.contact.surface
        area = surface.area.x.array[: surface.num_owned]
        states = self.problem.accepted[0].states()
        parts = (surface.x, area, self.contact.nodal_traction(), states)
        parts = self.problem.comm.allgather(parts)
        x, area, t, states = (np.concatenate(list(column)) for column in zip(*parts, strict=True))
        dim = t.shape[1]
        pressure = -t[:, -1]
        hertz = Hertz(dim, self.copies * float(area @ pressure), self.nu)
        r = np.linalg.norm(x[:, : dim - 1], axis=1)
        return Tractions(r, area, pressure, t[:, : dim - 1], states, hertz)


@dataclass(frozen=True)
class Tractions:
    """Nodal tractions on the block: distance from the axis, area, pressure, shear, state."""

    r: np.ndarray
    area: np.ndarray
    pressure: np.ndarray
    shear: np.ndarray
    states: np.ndarray
    hertz: Hertz

    @property
    def share(self) -> float:
        """Tangential over normal force."""
        return float(self.area @ self.shear[:, 0]) / float(self.area @ self.pressure)

    def norm(self, field) -> float:
        """Return the nodal L2 norm relative to that of Hertz's pressure."""
        size = self.area @ self.hertz.pressure(self.r) ** 2
        return float(np.sqrt(self.area @ field**2 / size))

    def largest(self, state: int) -> float:
        """Return the largest distance of a node in this state."""
        return float(np.max(self.r[self.states == state], initial=0.0))

    def smallest(self, state: int) -> float:
        """Return the smallest distance of a node in this state."""
        return float(np.min(self.r[self.states == state], initial=np.inf))


def indentation(
    dim: int, n: int, prefix: str, *, mu: float | None = None, nu: float, full_x: bool,
    far: float, growth: float, crowned: bool = False, degree: int = 1, surface_degree: int = 1,
) -> Indentation:  # fmt: skip
    """Build the block: ``n`` cells on the nominal half-width 1, symmetry where it holds.

    Args:
        dim: 2 or 3.
        n: Cells on the nominal half-width of contact.
        prefix: Prefix of the PETSc options.
        mu: Initial friction coefficient, ``None`` without friction.
        nu: Poisson's ratio; from :data:`INCOMPRESSIBLE` on with mean dilatation.
        full_x: No symmetry plane across the direction of shift.
        far: Half-width and height of the block.
        growth: Growth of the cells away from the contact.
        crowned: The block is curved and the obstacle is a plane, or else the other way round.
        degree: Of the displacement.
        surface_degree: Of the contact surface.
    """
    side, down = graded(n, 1.25, far, growth), -graded(n, 0.5, far, growth)[::-1]
    x = np.concatenate([-side[:0:-1], side]) if full_x else side
    msh = tensor_mesh(*[x, side][: dim - 1], down)
    fdim, last = dim - 1, dim - 1
    markers = [lambda x: np.isclose(x[last], 0.0), lambda x: np.isclose(x[last], -far)]
    planes = [k for k in range(dim - 1) if k > 0 or not full_x]
    markers += [lambda x, k=k: np.isclose(x[k], 0.0) for k in planes]
    tags = tagged_facets(msh, *markers)
    motion = ff.RigidMotion(msh)
    origin, up = np.zeros(dim), np.eye(dim)[last]
    obstacle: ff.RigidObstacle = ff.RigidSphere(RADIUS * up, RADIUS, motion=motion)
    if crowned:
        obstacle = ff.RigidPlane(origin, -up, motion=motion)
        X = msh.geometry.x
        X[:, last] -= np.sum(X[:, :last] ** 2, axis=1) / (2.0 * RADIUS) * (1.0 + X[:, last] / far)
    V = fem.functionspace(msh, ("Lagrange", degree, (dim,)))
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, nu))
    stored = ff.bulk.stored_energy(density, ufl.dx, bbar=nu >= INCOMPRESSIBLE)
    bottom = fem.locate_dofs_topological(V, fdim, tags.find(2))
    bcs = [fem.dirichletbc(np.zeros(dim), bottom, V)]
    for tag, k in enumerate(planes, start=3):
        held = fem.locate_dofs_topological(V.sub(k), fdim, tags.find(tag))
        bcs.append(fem.dirichletbc(0.0, held, V.sub(k)))
    coefficient = fem.Constant(msh, mu or 0.0)
    friction = ff.Frictionless() if mu is None else ff.Coulomb(coefficient)
    surface = ff.ContactSurface(msh, tags, 1, degree=surface_degree)
    contact = ff.Contact(surface, obstacle, friction)
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v), u, contact=contact, bcs=bcs, petsc_options_prefix=prefix
    )
    return Indentation(problem, contact, motion, coefficient, nu, 2 ** len(planes))
