"""Two deformable bodies on one mesh, for tests of contact between them."""

from dataclasses import dataclass

from mpi4py import MPI

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff


def joined(comm, *parts):
    """Join meshes made on MPI.COMM_SELF to one without connecting them."""
    domain = basix.ufl.element("Lagrange", parts[0].basix_cell(), 1, shape=(parts[0].geometry.dim,))
    nodes, cells, start = [], [], 0
    for part in parts:
        nodes.append(part.geometry.x[:, : part.geometry.dim])
        cells.append(part.geometry.dofmaps[0] + start)
        start += len(nodes[-1])
    x, table = np.concatenate(nodes), np.concatenate(cells).astype(np.int64)
    if comm.rank > 0:
        x, table = x[:0], table[:0]
    return mesh.create_mesh(comm, table, domain, x)


def box(low, high, n, cell):
    """A rectangle or box on MPI.COMM_SELF."""
    kind = getattr(mesh.CellType, cell)
    make = mesh.create_rectangle if len(n) == 2 else mesh.create_box
    return make(MPI.COMM_SELF, [low, high], n, kind)


@dataclass
class Stack:
    """A block on a base; ``move`` prescribes the top, ``turn`` turns base and top together."""

    problem: ff.FrictionalContactProblem
    contact: ff.Contact
    top: fem.Function
    bottom: fem.Function
    stored: ufl.Form
    tags: mesh.MeshTags

    def move(self, *displacement):
        d = len(displacement)
        self.top.x.array[:] = np.tile(displacement, len(self.top.x.array) // d)


def stack(
    mu,
    prefix,
    *,
    cell="hexahedron",
    upper=(3, 3, 2),
    lower=(2, 2, 2),
    top=((0.0, 0.0, 1.0), (1.0, 1.0, 2.0)),
    base=((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    E=1000.0,
    nu=0.3,
    energy="finite",
    comm=MPI.COMM_WORLD,
    search=None,
    hold=None,
    warp=None,
    obstacle=None,
    linear_solver="auto",
    method="node-to-face",
    close_gaps=None,
    degree=1,
    all_round=False,
    **settings,
) -> Stack:
    """Build a block on a base; lengths (m), ``E`` (Pa) of both or of the block and the base.

    Args:
        hold: Further prescribed components: (marker, component) pairs, held at zero.
        warp: Moves the nodes, ``(3, n)`` to the same.
        obstacle: Obstacle in place of the base's surface.
        method: How the bodies meet.
        close_gaps: Gaps up to this (m) count as closed at the start.
        degree: Of the displacement.
        all_round: The sides of block and base are parts of the surfaces, too.
    """
    d = len(upper)
    msh = joined(comm, box(*base, lower, cell), box(*top, upper, cell))
    up = d - 1
    level = top[0][up]
    eps = 1e-6 * (top[1][up] - level)
    tags = sides(msh, up, (base[0][up], base[1][up], level, top[1][up]), eps, all_round)
    if warp is not None:
        msh.geometry.x[:, :d] = warp(msh.geometry.x[:, :d].T).T
    V = fem.functionspace(msh, ("Lagrange", degree, (d,)))
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    moduli = np.broadcast_to(E, 2)
    D0 = fem.functionspace(msh, ("DG", 0))
    young = fem.Function(D0)
    mid = mesh.compute_midpoints(msh, d, np.arange(len(young.x.array), dtype=np.int32))
    young.x.array[:] = np.where(mid[:, up] > level, moduli[0], moduli[1])
    rubber = ff.bulk.Elastic(E=young, nu=nu)
    density = {"small": ff.bulk.small_strain_energy, "finite": ff.bulk.neo_hooke_energy}[energy]
    stored = ff.bulk.stored_energy(density(u, rubber), ufl.dx)
    moved, bottom = fem.Function(V, name="top"), fem.Function(V, name="bottom")
    bcs = [
        fem.dirichletbc(moved, fem.locate_dofs_topological(V, d - 1, tags.find(4))),
        fem.dirichletbc(bottom, fem.locate_dofs_topological(V, d - 1, tags.find(3))),
    ]
    for marker, component in hold or []:
        W = V.sub(component)
        facets = mesh.locate_entities_boundary(msh, d - 1, marker)
        bcs.append(fem.dirichletbc(0.0, fem.locate_dofs_topological(W, d - 1, facets), W))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "secondary"),
        obstacle
        or ff.DeformableObstacle(
            ff.ContactSurface(msh, tags, 2, "primary"),
            search=search,
            method=method,
            close_gaps=close_gaps,
        ),
        ff.Coulomb(mu) if not isinstance(mu, ff.FrictionLaw) else mu,
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v),
        u,
        contact=contact,
        bcs=bcs,
        petsc_options_prefix=prefix,
        linear_solver=linear_solver,
        settings=ff.StepSettings(**settings),
    )
    return Stack(problem, contact, moved, bottom, stored, tags)


def sides(msh, up, levels, eps, all_round=False):
    """Tag the block's bottom 1, the base's top 2, the base's bottom 3 and the block's top 4.

    Args:
        msh: Base and block, not yet warped.
        up: The axis that points from the base to the block.
        levels: The base's bottom and top, the block's bottom and top.
        eps: Tolerance (m).
        all_round: The sides of the bodies are 1 and 2, too.
    """
    _, primary, secondary, _ = levels
    tdim = msh.topology.dim
    facets = mesh.locate_entities_boundary(msh, tdim - 1, lambda x: np.full(x.shape[1], True))
    msh.topology.create_connectivity(tdim - 1, tdim)
    owner = msh.topology.connectivity(tdim - 1, tdim)
    cells = np.array([owner.links(f)[0] for f in facets], dtype=np.int32)
    # Facets at the same place are told apart by the bodies of their cells.
    below = mesh.compute_midpoints(msh, tdim, cells)[:, up] < (primary + secondary) / 2.0
    mid = mesh.compute_midpoints(msh, tdim - 1, facets)[:, up]
    at_low, at_primary, at_secondary, at_high = (np.isclose(mid, a, atol=eps) for a in levels)
    values = np.select([at_low, at_high, below], [3, 4, 2], default=1).astype(np.int32)
    chosen = at_low | at_high | at_primary | at_secondary | all_round
    return mesh.meshtags(msh, tdim - 1, facets[chosen], values[chosen])
