# SPDX-License-Identifier: MIT
"""Faces that meet a plane of symmetry obliquely, with friction between two bodies."""

from itertools import count

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import box, joined, sides

E, NU, MU, STRAIN = 1000.0, 0.3, 0.6, 1e-3
numbers = count()


def roof(slope, method="node-to-face"):
    """Two layers between x = 0 and x = 1, where they may move along y only, on a slope.

    Returns the problem, and what squeezes them and moves both planes along.
    """
    parts = (box((0.0, low), (1.0, low + 2.0), (4, 6), "quadrilateral") for low in (0.0, 2.0))
    msh = joined(MPI.COMM_WORLD, *parts)
    tags = sides(msh, 1, (0.0, 2.0, 2.0, 4.0), 1e-6)
    x = msh.geometry.x
    x[:, 1] += slope * x[:, 0] * (1.0 - abs(x[:, 1] - 2.0) / 2.0)  # ends are level
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    down, along = fem.Constant(msh, 0.0), fem.Constant(msh, 0.0)
    W, bcs = [V.sub(0), V.sub(1)], []
    for axis, at, value in ((0, 0.0, along), (0, 1.0, along), (1, 0.0, 0.0), (1, 4.0, down)):
        facets = mesh.locate_entities_boundary(msh, 1, lambda x, k=axis, y=at: np.isclose(x[k], y))
        bcs.append(fem.dirichletbc(value, fem.locate_dofs_topological(W[axis], 1, facets), W[axis]))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "upper"),
        ff.DeformableObstacle(ff.ContactSurface(msh, tags, 2, "lower"), method=method),
        ff.Coulomb(MU),
    )
    problem = ff.FrictionalContactProblem(
        F, u, contact=contact, bcs=bcs, petsc_options_prefix=f"roof_{next(numbers)}_"
    )
    return problem, down, along


@pytest.mark.mpi
@pytest.mark.parametrize("slope", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("method", ["node-to-face", "mortar"])
def test_a_roof_that_sticks_is_as_stiff_as_one_body(slope, method):
    """Mirrored at x = 0, faces press straight down there: strains are even, as without a joint."""
    problem, down, _ = roof(slope, method)
    down.value = -4.0 * STRAIN
    report = problem.solve()
    assert report.certified
    assert report.contacts[0].open == report.contacts[0].slip == 0
    even = fem.Function(problem.u.function_space)
    even.interpolate(lambda x: np.stack([0.0 * x[0], -STRAIN * x[1]]))
    assert np.allclose(problem.u.x.array, even.x.array, rtol=0.0, atol=1e-9 * STRAIN)
    stiffness = E * (1.0 - NU) / ((1.0 + NU) * (1.0 - 2.0 * NU))
    assert report.contacts[0].force[1] == pytest.approx(stiffness * STRAIN, rel=1e-9)


@pytest.mark.mpi
def test_steeper_faces_and_conditions_that_move_are_refused():
    """There friction and reaction cannot be told apart."""
    with pytest.raises(ff.ContactInputError, match="neither normal nor tangential"):
        roof(1.2)
    problem, down, along = roof(0.5)
    down.value = -4.0 * STRAIN
    assert problem.solve().certified
    along.value = STRAIN
    with pytest.raises(ff.ContactInputError, match="neither normal nor tangential"):
        problem.solve()
