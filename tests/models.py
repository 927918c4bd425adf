"""Small problems that several tests share."""

from dataclasses import dataclass

from mpi4py import MPI

import basix
import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff

#: Pressures of the Raous rectangle (Pa) and its side (m), see tests/data.
LATERAL, TOP, SIDE = 150e6, 50e6, 40e-3


@dataclass
class Raous:
    """The Raous rectangle; ``load`` sets the fractions of the two pressures."""

    problem: ff.FrictionalContactProblem
    contact: ff.Contact
    pressures: tuple[fem.Constant, fem.Constant]
    stored: ufl.Form
    loads: ufl.Form

    def load(self, lateral: float, top: float) -> None:
        self.pressures[0].value = lateral * LATERAL
        self.pressures[1].value = top * TOP


def tagged_facets(msh, *markers):
    """Tag boundary facets 1, 2, ... by geometrical markers."""
    fdim = msh.topology.dim - 1
    groups = [mesh.locate_entities_boundary(msh, fdim, marker) for marker in markers]
    facets = np.concatenate(groups)
    tags = np.repeat(np.arange(1, len(groups) + 1, dtype=np.int32), [len(g) for g in groups])
    order = np.argsort(facets)
    return mesh.meshtags(msh, fdim, facets[order], tags[order])


def raous(nx, ny, mu, prefix, *, bbar=False, comm=MPI.COMM_WORLD, unit=1.0, **settings) -> Raous:
    """Build the Raous rectangle; ``unit`` scales lengths (1e3: mm and N/mm² = 1e-6 Pa)."""
    side, pressure = SIDE * unit, unit**-2
    msh = mesh.create_rectangle(
        comm, [[0.0, 0.0], [side, side]], [nx, ny], mesh.CellType.quadrilateral
    )
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(x[1], 0.0),
        lambda x: np.isclose(x[0], 0.0),
        lambda x: np.isclose(x[1], side),
        lambda x: np.isclose(x[0], side),
    )
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    lateral, top = (fem.Constant(msh, p * pressure) for p in (LATERAL, TOP))
    ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
    loads = lateral * v[0] * ds(2) - top * v[1] * ds(3)
    steel = ff.bulk.Elastic(E=130e9 * pressure, nu=0.2)
    stored = ff.bulk.stored_energy(ff.bulk.small_strain_energy(u, steel), ufl.dx, bbar=bbar)
    held = fem.locate_dofs_topological(V.sub(0), 1, tags.find(4))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0.0, 0.0), (0.0, 1.0)), ff.Coulomb(mu)
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v) - loads,
        u,
        contact=contact,
        bcs=[fem.dirichletbc(0.0, held, V.sub(0))],
        petsc_options_prefix=prefix,
        settings=ff.StepSettings(**settings),
    )
    return Raous(problem, contact, (lateral, top), stored, loads)


@dataclass
class Block:
    """A 3D block on a rigid plane, its top moved by ``move``."""

    problem: ff.FrictionalContactProblem
    contact: ff.Contact
    top: fem.Function
    frame: np.ndarray
    stored: ufl.Form

    def move(self, x: float, y: float, z: float) -> None:
        """Prescribe the displacement of the top in the block's own axes."""
        displacement = np.array([x, y, z]) @ self.frame
        self.top.x.array[:] = np.tile(displacement, len(self.top.x.array) // 3)


def block(
    cell,
    mu,
    prefix,
    *,
    n=(4, 3, 2),
    energy="small",
    rotation=None,
    length=1.0,
    modulus=1000.0,
    comm=MPI.COMM_WORLD,
    linear_solver="auto",
    **settings,
) -> Block:
    """Build the block ``1.2 x 0.9 x 0.5``, ``nu = 0.3``, rotated with its plane.

    Args:
        length: Unit of length (m).
        modulus: Young's modulus (Pa).
    """
    size = (1.2, 0.9, 0.5)
    msh = mesh.create_box(comm, [[0.0] * 3, size], n, getattr(mesh.CellType, cell))
    tags = tagged_facets(msh, lambda x: np.isclose(x[2], 0.0), lambda x: np.isclose(x[2], size[2]))
    frame = np.eye(3) if rotation is None else np.asarray(rotation)
    offset = np.zeros(3) if rotation is None else np.array([0.3, -2.0, 5.0])
    msh.geometry.x[:] = length * (msh.geometry.x @ frame + offset)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    young = fem.Function(fem.functionspace(msh, ("DG", 0)))
    young.x.array[:] = modulus
    rubber = ff.bulk.Elastic(E=young, nu=0.3)
    density = {"small": ff.bulk.small_strain_energy, "finite": ff.bulk.neo_hooke_energy}[energy]
    stored = ff.bulk.stored_energy(density(u, rubber), ufl.dx)
    top = fem.Function(V, name="top")
    held = fem.locate_dofs_topological(V, 2, tags.find(2))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1),
        ff.RigidPlane(length * offset, frame[2]),
        ff.Coulomb(mu),
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(top, held)],
        petsc_options_prefix=prefix,
        linear_solver=linear_solver,
        settings=ff.StepSettings(**settings),
    )
    return Block(problem, contact, top, frame, stored)


def with_contact(model, contact, prefix, *, sign=1.0, **options):
    """Return another problem of a model's body, held as it is, with other contacts.

    Args:
        model: Anything with a ``problem``.
        contact: One contact or several.
        prefix: Prefix of the PETSc options.
        sign: Factor of the residual.
        options: Further arguments of the problem, or others in place of the model's.
    """
    problem = model.problem
    given = {"bcs": problem.bcs, "petsc_options_prefix": prefix} | options
    return ff.FrictionalContactProblem(sign * problem.bulk, problem.u, contact=contact, **given)


def rectangle_on(normal, comm=MPI.COMM_WORLD):
    """Return a unit square whose base (tag 1; the top is 2) lies on a plane through the origin."""
    msh = mesh.create_rectangle(comm, [[0, 0], [1, 1]], [4, 4], mesh.CellType.quadrilateral)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0))
    normal = np.asarray(normal) / np.linalg.norm(normal)
    along = np.array([normal[1], -normal[0]])
    msh.geometry.x[:, :2] = msh.geometry.x[:, :2] @ np.array([along, normal])
    return msh, tags


#: Top displacements: press, an L-shaped sweep, and back: stick, slip, turn and reversal.
L_PATH = [
    (0.0, 0.0, -0.01),
    (0.002, 0.0, -0.01),
    (0.012, 0.0, -0.01),
    (0.020, 0.0, -0.012),
    (0.020, 0.008, -0.012),
    (0.020, 0.016, -0.010),
    (0.016, 0.016, -0.010),
    (0.000, 0.016, -0.008),
    (0.000, 0.000, 0.001),
]


def by_place(f):
    """Return the owned values of a function on all ranks, ordered by the places of its dofs.

    Two equal meshes may be divided among three ranks in two ways. A dof has its place in the middle
    of its vertex, edge, face or cell, so that elements without points have places, too.
    """
    V = f.function_space
    msh, dofmap = V.mesh, V.dofmap
    corners = msh.geometry.x[msh.geometry.dofmaps[0]]
    places = np.zeros((len(f.x.array) // dofmap.bs, 3))
    for e, entities in enumerate(basix.topology(msh.basix_cell())):
        for i, vertices in enumerate(entities):
            dofs = dofmap.list[:, dofmap.dof_layout.entity_dofs(e, i)]
            places[dofs] = corners[:, vertices].mean(axis=1)[:, None]
    n = dofmap.index_map.size_local
    parts = msh.comm.allgather((np.round(places[:n], 9), f.x.array.reshape(-1, dofmap.bs)[:n]))
    x, values = (np.concatenate(list(column)) for column in zip(*parts, strict=True))
    return values[np.lexsort((*values.T, *x.T))]  # bodies that touch share places


def gathered(problem):
    """Return coordinates, tractions and displacements of the first contact's nodes, by x, y, z."""
    (contact, *_), comm = problem.contacts, problem.comm
    surface, d = contact.surface, problem.u.function_space.mesh.geometry.dim
    nodes = surface.parent_dofs(problem.u.function_space)[: surface.num_owned]
    u = problem.u.x.array.reshape(-1, d)[nodes]
    parts = comm.allgather((surface.x, contact.nodal().c, u))
    x, c, u = (np.concatenate(list(column)) for column in zip(*parts, strict=True))
    order = np.lexsort(np.round(x, 9).T[::-1])
    return x[order], c[order], u[order]
