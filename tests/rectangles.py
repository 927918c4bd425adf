"""A rectangle or box with contact on its sides, for tests of obstacles."""

import math
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh
from scipy.spatial.transform import Rotation

import fenicsx_friction as ff
from models import tagged_facets

#: A skew axis.
AXIS = np.array([1.0, 2.0, 2.0]) / 3.0


def turned(angle, d):
    """Return the rotation matrix of a motion about ``AXIS`` (3D) or z (2D)."""
    if d == 2:
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[c, -s], [s, c]])
    return Rotation.from_rotvec(angle * AXIS).as_matrix()


def body(
    make, prefix, *, low, high, n, turn=None, energy="finite", traction=None, comm=None,
    degree=1, simplices=False, held=None,
):  # fmt: skip
    """Build a rectangle or box; surfaces: 1 bottom, 3 left, 5 both.

    ``make(msh, surfaces)`` returns the contacts; the top, or where ``held`` says so, is held by the
    Function ``top`` unless there are loads: ``traction`` (top, right), pressures.
    """
    d, comm = len(low), comm or MPI.COMM_WORLD
    create = mesh.create_rectangle if d == 2 else mesh.create_box
    kinds = ("triangle", "tetrahedron") if simplices else ("quadrilateral", "hexahedron")
    msh = create(comm, [list(low), list(high)], n, mesh.CellType[kinds[d - 2]])
    up = d - 1
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(x[up], low[up]),
        held or (lambda x: np.isclose(x[up], high[up])),
        lambda x: np.isclose(x[0], low[0]),
        lambda x: np.isclose(x[0], high[0]),
    )
    facets = np.sort(np.concatenate([tags.find(1), tags.find(3)]))
    corner = mesh.meshtags(msh, up, facets, np.full(len(facets), 5, dtype=np.int32))
    turn = np.eye(d) if turn is None else turn
    msh.geometry.x[:, :d] = msh.geometry.x[:, :d] @ turn.T
    V = fem.functionspace(msh, ("Lagrange", degree, (d,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    density = {"finite": ff.bulk.neo_hooke_energy, "small": ff.bulk.small_strain_energy}[energy]
    stored = ff.bulk.stored_energy(density(u, ff.bulk.Elastic(1000.0, 0.3)), ufl.dx)
    F, bcs, loads = ufl.derivative(stored, u, v), [], []
    if traction is None:
        bcs = [fem.dirichletbc(top, fem.locate_dofs_topological(V, up, tags.find(2)))]
    else:
        ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
        loads = [fem.Constant(msh, float(value)) for value in traction]
        F += loads[0] * v[up] * ds(2) + loads[1] * v[0] * ds(4)
    surfaces = {tag: ff.ContactSurface(msh, tags, tag, name=f"side {tag}") for tag in (1, 3)}
    surfaces[5] = ff.ContactSurface(msh, corner, 5, name="corner")
    contacts = make(msh, surfaces)
    problem = ff.FrictionalContactProblem(
        F, u, contact=contacts, bcs=bcs, petsc_options_prefix=prefix
    )
    x0 = V.tabulate_dof_coordinates()[:, :d]

    def place(rotation, translation=0.0):
        """Move the top as a rigid body: ``x -> rotation x + translation``."""
        top.x.array[:] = (x0 @ np.asarray(rotation).T + translation - x0).ravel()

    return SimpleNamespace(
        problem=problem, contacts=contacts, contact=contacts[0], place=place, x=x0, u=u, loads=loads
    )


def everywhere(problem, contact, array):
    """Gather nodal values of all ranks, ordered by the reference coordinates of the nodes."""
    parts = problem.comm.allgather((contact.surface.x, array))
    x, gathered = (np.concatenate(list(column)) for column in zip(*parts, strict=True))
    return gathered[np.lexsort(np.round(x, 7).T[::-1])]


def tractions(model, contact=None):
    """Return the traction vectors of a contact's nodes."""
    contact = contact or model.contact
    return everywhere(model.problem, contact, contact.nodal_traction())


def on_floor(mu):
    """Make the contact of the bottom with the floor, at rest."""
    return lambda msh, surfaces: [
        ff.Contact(surfaces[1], ff.RigidPlane((0.0, 0.0), (0.0, 1.0)), ff.Coulomb(mu))
    ]


SQUARE = {"low": (0.0, 0.0), "high": (1.0, 0.5), "n": [6, 3]}
PATH = [(0.0, -0.02), (0.02, -0.02), (0.1, -0.03), (0.3, -0.03), (0.25, -0.03)]
