# SPDX-License-Identifier: MIT
"""Loads near the rounding of displacements: right, or refused, never lost with a certificate."""

from itertools import count

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from models import tagged_facets

E, WIDTH, HEIGHT = 1000.0, 1.0, 0.5
numbers = count()


def column(nu, moved, mixed):
    """A block on a plane without friction, to be moved along, then pressed evenly.

    Returns the problem, its displacement along, and the Constant of its strain.
    """
    msh = mesh.create_rectangle(
        MPI.COMM_WORLD, [[0.0, 0.0], [WIDTH, HEIGHT]], [4, 2], mesh.CellType.triangle
    )
    ends = ((1, 0.0), (1, HEIGHT), (0, 0.0))
    tags = tagged_facets(msh, *(lambda x, k=k, at=at: np.isclose(x[k], at) for k, at in ends))
    V, Q = (fem.functionspace(msh, e) for e in (("Lagrange", 2, (2,)), ("Lagrange", 1)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    strain, along = fem.Constant(msh, 0.0), fem.Constant(msh, 0.0)
    forms, unknowns, small = [], [u], ufl.sym(ufl.grad(u))
    if mixed:
        p, q = fem.Function(Q), ufl.TestFunction(Q)
        bulk = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
        stress = E / (1.0 + nu) * small - p * ufl.Identity(2)
        forms, unknowns = [(ufl.div(u) + p / bulk) * q * ufl.dx], [u, p]
        F = ufl.inner(stress, ufl.grad(v)) * ufl.dx
    else:
        density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, nu))
        F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    dofs = [fem.locate_dofs_topological(V.sub(k), 1, tags.find(t)) for k, t in ((0, 3), (1, 2))]
    bcs = [fem.dirichletbc(along, dofs[0], V.sub(0))]
    if moved:
        top = fem.Constant(msh, 0.0)
        bcs.append(fem.dirichletbc(top, dofs[1], V.sub(1)))
    else:
        ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
        F += E / (1.0 - nu**2) * strain * v[1] * ds(2)
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0.0, 0.0), (0.0, 1.0)), ff.Frictionless()
    )
    problem = ff.FrictionalContactProblem(
        [F, *forms], unknowns, contact=contact, bcs=bcs,
        petsc_options_prefix=f"faint_{next(numbers)}_",
    )  # fmt: skip

    def press(x, value):
        along.value, strain.value = x, value
        if moved:
            top.value = -value * HEIGHT

    return problem, press


@pytest.mark.mpi
@pytest.mark.parametrize("moved", [False, True], ids=["loaded", "moved"])
@pytest.mark.parametrize(
    ("nu", "mixed", "x", "strain"),
    [
        (0.3, False, 1.0, 1e-11),  # flew away by 2000 widths, and its load was lost
        (0.3, True, 1.0, 1e-11),
        (0.49999, True, 0.1, 1e-12),
        (0.49999, True, 1.0, 1e-11),
        (0.49999, True, 10.0, 1e-10),
        (0.499999, True, 1.0, 1e-9),
        (0.4999999, True, 0.01, 1e-10),
        (0.3, False, 1e3, 1e-10),
        (0.3, True, 1e3, 1e-10),
    ],
)
def test_a_load_near_rounding_is_carried_or_refused(nu, mixed, x, strain, moved):
    """Not moved along, the block carries the same load to nine digits."""
    exact = E / (1.0 - nu**2) * strain * WIDTH
    problem, press = column(nu, moved, mixed)
    press(0.0, strain)
    assert problem.solve().contacts[0].normal_force == pytest.approx(exact, rel=1e-9)
    problem, press = column(nu, moved, mixed)
    press(x, strain)
    try:
        force = problem.solve().contacts[0].normal_force
    except ff.StepFailed:
        assert np.all(problem.u.x.array == 0.0)
    else:
        assert force == pytest.approx(exact, rel=1e-8)


@pytest.mark.mpi
@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize(("x", "strain"), [(30.0, 3e-13), (100.0, 1e-13), (1e4, 1e-10)])
def test_a_load_below_rounding_is_refused(mixed, x, strain):
    """It need not balance: any force of contact was certified."""
    problem, press = column(0.3, False, mixed)
    press(x, strain)
    with pytest.raises(ff.StepFailed, match="forces too faint"):
        problem.solve()
    assert np.all(problem.u.x.array == 0.0)
    press(x, 0.0)  # without load it may go so far
    assert problem.solve().certified
    press(2.0 * x, 1e-5 * x)
    assert problem.solve().certified
    press(x, 1e-5 * x * np.sin(np.pi))  # the end of a cycle
    assert problem.solve().certified
