# SPDX-License-Identifier: MIT
"""Bodies that forces drag over others: how far they slide, only springs on their backs say."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

import fenicsx_friction as ff
from bodies import box, joined, sides

#: Size of the base's faces (m), and what presses the block (Pa).
FACE, PRESSURE = 0.2, 20.0


def dragged(method, mu, faces, E, steps, name):
    """Press a block on a base, then drag it by 2 mu p: the springs stop it after some faces.

    Returns the mean way of its top (m), the mean shear there (Pa), and the forces of contact.
    """
    base, block = (
        box((0.0, 0.0), (4.0, 0.6), (20, 3), "quadrilateral"),
        box((0.5, 0.6), (1.3, 1.0), (4, 2), "quadrilateral"),
    )
    msh = joined(MPI.COMM_WORLD, base, block)
    tags = sides(msh, 1, (0.0, 0.6, 0.6, 1.0), 1e-7)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    young = fem.Function(fem.functionspace(msh, ("DG", 0)))
    young.interpolate(lambda x: np.where(x[1] > 0.6, *E))
    stored = ff.bulk.stored_energy(ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(young, 0.3)), ufl.dx)
    top = ufl.Measure("ds", domain=msh, subdomain_data=tags)(4)
    shear, spring = fem.Constant(msh, 0.0), mu * PRESSURE / (faces * FACE)
    pulls = shear - spring * u[0]
    F = ufl.derivative(stored, u, v) + PRESSURE * v[1] * top - pulls * v[0] * top
    surfaces = [ff.ContactSurface(msh, tags, tag, f"side {tag}") for tag in (1, 2)]
    obstacle = ff.DeformableObstacle(surfaces[1], method=method, close_gaps=1e-6)
    bottom = fem.locate_dofs_topological(V, 1, tags.find(3))
    problem = ff.FrictionalContactProblem(
        F, u, contact=ff.Contact(surfaces[0], obstacle, ff.Coulomb(mu)),
        bcs=[fem.dirichletbc(np.zeros(2), bottom, V)], petsc_options_prefix=name,
    )  # fmt: skip
    problem.solve()
    for part in np.arange(1, steps + 1) / steps:
        shear.value = 2.0 * mu * PRESSURE * part
        report = problem.solve()
    width = 0.8
    totals = [fem.assemble_scalar(fem.form(f * top)) / width for f in (u[0], pulls)]
    return [msh.comm.allreduce(t) for t in totals], report.contacts[0].force


SOFT_BLOCK, SOFT_BASE = (1e3, 1e5), (1e5, 1e3)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("method", "E"),
    [("mortar", SOFT_BLOCK), ("mortar", SOFT_BASE), ("node-to-face", SOFT_BLOCK)],
)
def test_a_block_slides_over_four_faces_in_one_step(method, E):
    """As far as in eight steps; what pulls it is what contact holds."""
    (way, pull), force = dragged(method, 0.1, 4, E, 1, "one_")
    (by_steps, _), _ = dragged(method, 0.1, 4, E, 8, "steps_")
    assert 0.7 < way < 0.9
    assert way == pytest.approx(by_steps, rel=0.01)
    assert force == pytest.approx([-pull * 0.8, PRESSURE * 0.8], rel=1e-6)
    assert pull / PRESSURE == pytest.approx(0.1, rel=0.06)
