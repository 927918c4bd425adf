"""Bodies whose surface meets itself: a column of blocks, and a tube that is crushed flat."""

from dataclasses import dataclass

from mpi4py import MPI

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import box, joined
from models import by_place

#: Between the blocks of a column (m).
GAP = 1e-4


@dataclass
class Model:
    """A problem whose plates or ends are moved by ``move``."""

    problem: ff.FrictionalContactProblem
    move: object

    def solve(self, *position):
        self.move(*position)
        return self.problem.solve()

    def by_place(self):
        return by_place(self.problem.u)


def stored(u, energy=ff.bulk.neo_hooke_energy, E=100.0):
    return ff.bulk.stored_energy(energy(u, ff.bulk.Elastic(E=E, nu=0.3)), ufl.dx)


def column(
    d,
    prefix,
    *,
    pairs=None,
    mu=0.3,
    n=4,
    widths=(1.0, 1.0, 1.0),
    height=1.0,
    gap=GAP,
    all_round=False,
) -> Model:
    """Build three blocks on each other, with one surface or with contacts of two each.

    Args:
        pairs: Secondary and primary face of each contact, counted from 1 at the bottom; ``None``
            for one surface that meets itself.
        widths: Of the blocks, from below (m).
        all_round: Whether that surface has bottom and top of the column, too, which are held.
    """
    cell = "quadrilateral" if d == 2 else "hexahedron"
    lows = [k * (height + gap) for k in range(3)]
    parts = [
        box([0.0] * (d - 1) + [z], [w] * (d - 1) + [z + height], [n] * (d - 1) + [2], cell)
        for z, w in zip(lows, widths, strict=True)
    ]
    msh, fdim = joined(MPI.COMM_WORLD, *parts), d - 1
    msh.topology.create_connectivity(fdim, d)
    facets = np.sort(mesh.exterior_facet_indices(msh.topology))
    middle = mesh.compute_midpoints(msh, fdim, facets)[:, d - 1]
    levels = [level for low in lows for level in (low, low + height)]
    values = np.zeros(len(facets), dtype=np.int32)
    for tag, level in enumerate(levels, 1):
        values[abs(middle - level) < GAP / 9.0] = tag
    ends = mesh.meshtags(msh, fdim, facets, values)
    if pairs is None:
        values = np.where(all_round | ((values != 1) & (values != 6)), 9, values).astype(np.int32)
    tags = mesh.meshtags(msh, fdim, facets[values > 0], values[values > 0])
    V = fem.functionspace(msh, ("Lagrange", 1, (d,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    held = [fem.locate_dofs_topological(V, fdim, ends.find(tag)) for tag in (1, 6)]
    bcs = [fem.dirichletbc(fem.Function(V), held[0]), fem.dirichletbc(top, held[1])]
    springs = ufl.inner(u, v) * ufl.dx(metadata={"quadrature_degree": 2})  # hold the middle block

    def meets(secondary, primary):
        obstacle = ff.DeformableObstacle(face(primary), method="node-to-face")
        return ff.Contact(face(secondary), obstacle, ff.Coulomb(mu))

    def face(tag):
        return ff.ContactSurface(msh, tags, tag, f"face{tag}")

    if pairs is None:
        contacts = [ff.Contact(face(9), ff.SelfContact(), ff.Coulomb(mu))]
    else:
        contacts = [meets(*pair) for pair in pairs]
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored(u), u, v) + springs,
        u,
        bcs=bcs,
        contact=contacts,
        petsc_options_prefix=prefix,
    )

    def move(*way):
        top.x.array[:] = np.tile(way, len(top.x.array) // d)

    return Model(problem, move)


def ring(n, layers, thickness, *, half, cell="quadrilateral", unit=1.0, turn=0.0):
    """Mesh a ring of outer radius 1, or its upper half, times a unit and turned."""
    along = n // 2 + 1 if half else n
    angles = 2.0 * np.pi * np.arange(along) / n
    radii = 1.0 - thickness * np.arange(layers, -1, -1) / layers
    x = np.array([[r * np.cos(a), r * np.sin(a)] for a in angles for r in radii])
    i, j = np.meshgrid(np.arange(n // 2 if half else n), np.arange(layers), indexing="ij")
    here, there = i * (layers + 1) + j, (i + 1) % along * (layers + 1) + j
    cells = np.stack([here, here + 1, there, there + 1], axis=-1).reshape(-1, 4)
    if cell == "triangle":
        cells = np.concatenate([cells[:, [0, 1, 2]], cells[:, [1, 3, 2]]])
    c, s = np.cos(turn), np.sin(turn)
    x = unit * x @ np.array([[c, s], [-s, c]])
    if MPI.COMM_WORLD.rank > 0:
        x, cells = x[:0], cells[:0]
    domain = basix.ufl.element("Lagrange", cell, 1, shape=(2,))
    return mesh.create_mesh(MPI.COMM_WORLD, cells.astype(np.int64), domain, x)


def tube(
    prefix, *, half=False, n=24, layers=1, thickness=0.15, mu=0.5, unit=1.0, turn=0.0,
    cell="quadrilateral", degree=1, energy=ff.bulk.neo_hooke_energy, E=100.0, search=None,
    self_contact=True, all_round=False, **options,
) -> Model:  # fmt: skip
    """Build a tube between two rigid plates, or its upper half on the plane of symmetry.

    ``move(c)`` brings each plate closer to the plane of symmetry by ``c`` radii. The plates are
    frictional, the plane is not; the inner surface meets itself with ``mu``.

    Args:
        prefix: Of the PETSc options.
        half: Whether to build the upper half.
        n: Elements round the whole tube.
        layers: Elements through the wall.
        self_contact: Whether the inner surface may meet itself,
        all_round: and the outer one, too, as one surface with it.
    """
    c, s = np.cos(turn), np.sin(turn)
    across, up = np.array([c, s]), np.array([-s, c])
    msh = ring(n, layers, thickness, half=half, cell=cell, unit=unit, turn=turn)
    msh.topology.create_connectivity(1, 2)
    facets = np.sort(mesh.exterior_facet_indices(msh.topology))
    middle = mesh.compute_midpoints(msh, 1, facets)[:, :2] / unit
    height, radius = middle @ up, np.linalg.norm(middle, axis=1) / np.cos(np.pi / n)
    values = np.where(radius < 1.0 - thickness / 2.0, 1, np.where(height > 0.0, 2, 3))
    if half:
        values[abs(height) < 1e-9] = 4
    tags = mesh.meshtags(msh, 1, facets, values.astype(np.int32))
    V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    F, bcs = ufl.derivative(stored(u, energy, E), u, v), []
    u_x, v_x = (ufl.dot(w, ufl.as_vector(across)) for w in (u, v))
    weak = 1e-5 * E / unit**2  # holds the tube sideways, where it could roll
    F += weak * u_x * v_x * ufl.dx(metadata={"quadrature_degree": 2})
    plates = [ff.RigidMotion(msh), ff.RigidMotion(msh)]

    def face(tag):
        return ff.ContactSurface(msh, tags, tag, ("", "inside", "top", "bottom")[tag])

    def plate(tag, sign, motion):
        obstacle = ff.RigidPlane(sign * unit * up, -sign * up, motion=motion)
        return ff.Contact(face(tag), obstacle, ff.Coulomb(0.3))

    contacts = [plate(2, 1.0, plates[0])]
    if half:
        W = V.sub(1)
        cut = fem.locate_dofs_topological(W, 1, tags.find(4))
        bcs = [fem.dirichletbc(0.0, cut, W)]
        contacts.append(ff.Contact(face(1), ff.RigidPlane((0, 0), (0, 1)), ff.Frictionless()))
    else:
        contacts.append(plate(3, -1.0, plates[1]))
    if self_contact and not half:
        everything = mesh.meshtags(msh, 1, facets, np.ones_like(values, dtype=np.int32))
        surface = ff.ContactSurface(msh, everything, 1, "all round") if all_round else face(1)
        contacts.append(ff.Contact(surface, ff.SelfContact(search=search), ff.Coulomb(mu)))
    problem = ff.FrictionalContactProblem(
        F, u, bcs=bcs, contact=contacts, petsc_options_prefix=prefix, **options
    )

    def move(c):
        for motion, sign in zip(plates, (-1.0, 1.0), strict=True):
            motion.translation.value[:] = sign * c * unit * up

    return Model(problem, move)
