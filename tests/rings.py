# SPDX-License-Identifier: MIT
"""A half ring that slides over a block, for tests and benchmarks of contact in 2D."""

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import box, joined
from models import tagged_facets


def half_ring(name, mu=0.3, method="mortar", refine=1, *, hole=False):
    """Press a half ring (radius 1, E = 1000) on a block (E = 100) much wider, both neo-Hookean.

    Args:
        name: Prefix of its options.
        mu: Coefficient of friction.
        method: How the ring meets the block.
        refine: Times as many cells in each direction.
        hole: Whether the two faces under the ring's middle are no part of the block's surface.

    Returns:
        The problem, and the displacement of the ring's ends, a Constant: they are 0.1 down.
    """
    ring = box((0.0, 0.0), (1.0, 1.0), (96 * refine, 4 * refine), "quadrilateral")
    angle, depth = np.pi * (1.0 + ring.geometry.x[:, 0]), ring.geometry.x[:, 1]
    radius = 1.0 - 0.2 * depth
    ring.geometry.x[:, :2] = np.column_stack([radius * np.cos(angle), 1.0 + radius * np.sin(angle)])
    block = box((-2.0, -1.0), (2.0, 0.0), (74 * refine, 8 * refine), "quadrilateral")
    msh = joined(MPI.COMM_SELF, block, ring)
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(np.hypot(x[0], x[1] - 1.0), 1.0) & (x[1] < 0.7),
        lambda x: np.isclose(x[1], 0.0) & ((abs(x[0]) > 1e-9) | (not hole)),
        lambda x: np.isclose(x[1], -1.0),
        lambda x: np.isclose(x[1], 1.0) & (abs(x[0]) < 1.01),
    )
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    young = fem.Function(fem.functionspace(msh, ("DG", 0)))
    middles = mesh.compute_midpoints(msh, 2, np.arange(len(young.x.array), dtype=np.int32))
    young.x.array[:] = np.where(middles[:, 1] > 0.0, 1000.0, 100.0)
    density = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(young, 0.3))
    top = fem.Constant(msh, np.zeros(2))
    held = [fem.locate_dofs_topological(V, 1, tags.find(tag)) for tag in (4, 3)]
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "ring"),
        ff.DeformableObstacle(ff.ContactSurface(msh, tags, 2, "block"), method=method),
        ff.Coulomb(mu),
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=contact,
        bcs=[
            fem.dirichletbc(top, held[0], V),
            fem.dirichletbc(np.zeros(2), held[1], V),
        ],
        petsc_options_prefix=name,
    )
    for depth in (0.025, 0.05, 0.075, 0.1):
        top.value[:] = (0.0, -depth)
        problem.solve()
    return problem, top
