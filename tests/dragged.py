"""Blocks pressed on a plane and dragged, and the laws of friction they meet."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from models import tagged_facets

#: With nu = 0 the normal force is E times the pressed depth, whatever friction does.
E, DEPTH = 1000.0, 0.01
PRESSURE = E * DEPTH


@dataclass
class Dragged:
    """A block of side 1 on a plane, its top moved."""

    problem: ff.FrictionalContactProblem
    contact: ff.Contact
    top: fem.Function
    law: ff.FrictionLaw

    def move(self, *displacement):
        """Move the top to a displacement and solve."""
        self.top.x.array[:] = np.tile(displacement, len(self.top.x.array) // len(displacement))
        return self.problem.solve()

    def nodes(self):
        """Return positions, pressures, tractions along the tangents, paths and slips, of all ranks.

        Slips are the global vectors of the last step.
        """
        surface, comm = self.contact.surface, self.problem.comm
        n, d = surface.num_owned, surface.mesh.geometry.dim
        c = self.contact.c.x.array.reshape(-1, d)[:n]
        path, slip = self.contact.path.x.array[:n], self.contact.slip_increment
        parts = comm.allgather((surface.x, c[:, 0], c[:, 1:], path, slip))
        return [np.concatenate(column) for column in zip(*parts, strict=True)]


def dragged(make_law, prefix, *, dim=2, comm=MPI.COMM_WORLD, **settings) -> Dragged:
    """Build the block; ``make_law(msh, surface)`` makes its law."""
    if dim == 2:
        kind = mesh.CellType.quadrilateral
        msh = mesh.create_rectangle(comm, [[0, 0], [1, 1]], [4, 2], kind)
    else:
        msh = mesh.create_box(comm, [[0] * 3, [1] * 3], [2, 2, 1], mesh.CellType.hexahedron)
    up = dim - 1
    tags = tagged_facets(msh, lambda x: np.isclose(x[up], 0), lambda x: np.isclose(x[up], 1))
    V = fem.functionspace(msh, ("Lagrange", 1, (dim,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, 0.0))
    surface = ff.ContactSurface(msh, tags, 1)
    law, normal = make_law(msh, surface), np.eye(dim)[up]
    contact = ff.Contact(surface, ff.RigidPlane(np.zeros(dim), normal), law)
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(top, fem.locate_dofs_topological(V, up, tags.find(2)))],
        petsc_options_prefix=prefix,
        settings=ff.StepSettings(**settings),
    )
    return Dragged(problem, contact, top, law)


def on_mesh(msh, value):
    """Interpolate a function of ``x`` on the mesh of the body."""
    f = fem.Function(fem.functionspace(msh, ("Lagrange", 1)))
    f.interpolate(value)
    return f


def on_surface(surface, value):
    """Interpolate a function of ``x`` on the submesh of the contact facets."""
    f = fem.Function(surface.S)
    f.interpolate(value)
    return f


def user_law(msh, surface):
    """A law of a user: a limit and nothing else."""

    class Saturating(ff.FrictionLaw):
        def limit(self, pressure, sliding):
            return 4.0 * (1.0 - ufl.exp(-0.3 * pressure / 4.0))

    return Saturating()


def constant(msh, value):
    return fem.Constant(msh, float(value))


DT = 0.5
#: Name: law, and its limit of position, pressure, path and slip rate in NumPy.
LAWS = {
    "frictionless": (lambda m, s: ff.Frictionless(), lambda x, p, path, v: 0 * p),
    "constant": (lambda m, s: ff.Coulomb(constant(m, 0.2)), lambda x, p, path, v: 0.2 * p),
    "functions": (
        lambda m, s: ff.Coulomb(
            on_mesh(m, lambda x: 0.1 + 0.2 * x[0]), adhesion=on_surface(s, lambda x: x[0])
        ),
        lambda x, p, path, v: x[:, 0] + (0.1 + 0.2 * x[:, 0]) * p,
    ),
    "field": (
        lambda m, s: ff.Coulomb(0.1 + 0.2 * ufl.sin(ufl.SpatialCoordinate(m)[0]) ** 2),
        lambda x, p, path, v: (0.1 + 0.2 * np.sin(x[:, 0]) ** 2) * p,
    ),
    "surface function": (
        lambda m, s: ff.Coulomb(on_surface(s, lambda x: 0.3 - 0.2 * x[0])),
        lambda x, p, path, v: (0.3 - 0.2 * x[:, 0]) * p,
    ),
    "pressure": (
        lambda m, s: ff.Coulomb(lambda p, sliding: 0.4 / (1.0 + p / 20.0)),
        lambda x, p, path, v: 0.4 / (1.0 + p / 20.0) * p,
    ),
    "slip weakening": (
        lambda m, s: ff.Coulomb(lambda p, sliding: 0.2 + 0.2 * ufl.exp(-sliding.path / 0.05)),
        lambda x, p, path, v: (0.2 + 0.2 * np.exp(-path / 0.05)) * p,
    ),
    "rate": (
        lambda m, s: ff.Coulomb(lambda p, sliding: 0.2 + 0.5 * sliding.rate),
        lambda x, p, path, v: (0.2 + 0.5 * v) * p,
    ),
    "cap and adhesion": (
        lambda m, s: ff.Coulomb(0.2, adhesion=constant(m, 1.0), cap=constant(m, 3.1)),
        lambda x, p, path, v: np.minimum(1.0 + 0.2 * p, 3.1),
    ),
    "Tresca": (lambda m, s: ff.Coulomb(0.0, adhesion=2.5), lambda x, p, path, v: 0 * p + 2.5),
    "user": (user_law, lambda x, p, path, v: 4.0 * (1.0 - np.exp(-0.3 * p / 4.0))),
}
