"""Several contacts of one body, and starts that are open, touch or overlap."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.verification.jacobian import check_jacobian
from models import by_place, tagged_facets
from rectangles import SQUARE, body, on_floor, tractions

FLOOR = ff.RigidPlane((0.0, 0.0), (0.0, 1.0))
WALL = ff.RigidPlane((0.0, 0.0), (1.0, 0.0))


def two_surfaces(mu):
    """Make the contacts of floor and wall; the corner node belongs to the floor alone."""

    def make(msh, s):
        tags = tagged_facets(msh, lambda x: np.isclose(x[0], 0.0) & (x[1] > 0.1))
        return [
            ff.Contact(s[1], FLOOR, ff.Coulomb(mu)),
            ff.Contact(ff.ContactSurface(msh, tags, 1, "left"), WALL, ff.Coulomb(mu)),
        ]

    return make


def one_surface(msh, s):
    """Make the contacts of one surface with both obstacles, at the corner node, too."""
    return [ff.Contact(s[5], side, ff.Frictionless()) for side in (FLOOR, WALL)]


def separate(msh, s):
    """Make the same contacts, of a surface each."""
    return [ff.Contact(s[k], side, ff.Frictionless()) for k, side in ((1, FLOOR), (3, WALL))]


@pytest.mark.mpi
@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a_block_in_a_corner_is_in_equilibrium_by_two_contacts(mu):
    """Held by contact alone, pushed by two pressures: 1 m at 20 Pa on top, 0.5 m at 10 Pa."""
    model = body(two_surfaces(mu), "corner_", traction=(20.0, 10.0), energy="small", **SQUARE)
    for top, right in ((20.0, 10.0), (20.0, 2.0), (40.0, 30.0)):
        for load, value in zip(model.loads, (top, right), strict=True):
            load.value = value
        report = model.problem.solve()
        assert report.certified
        forces = np.array([totals.force for totals in report.contacts])
        assert forces.sum(axis=0) == pytest.approx((right / 2, top), rel=1e-9)
        if mu == 0.0:
            assert forces == pytest.approx(np.array([[0.0, top], [right / 2, 0.0]]), abs=1e-8)
        else:
            assert abs(forces[0, 0]) > 0.1
            assert forces[1, 1] != 0.0
    assert check_jacobian(model.problem).error < 1e-6


@pytest.mark.mpi
def test_one_surface_with_two_obstacles_equals_two_surfaces():
    """The multipliers of the corner node have other areas, its forces are the same."""
    forces, moved = [], []
    for make in (one_surface, separate):
        model = body(make, "shared_", traction=(20.0, 10.0), energy="small", **SQUARE)
        report = model.problem.solve()
        assert report.certified
        forces.append(np.array([totals.force for totals in report.contacts]))
        moved.append(by_place(model.u))
    assert forces[0] == pytest.approx(np.array([[0.0, 20.0], [5.0, 0.0]]), abs=1e-8)
    assert forces[1] == pytest.approx(forces[0], abs=1e-8)
    assert moved[1] == pytest.approx(moved[0], abs=1e-11)


@pytest.mark.mpi
def test_what_one_obstacle_pins_does_not_bind_the_contact_with_the_other():
    """Both contacts of one surface share its nodes.

    A node of the right side, whose ``u_x`` is held, takes no part in the contact with a wall
    there; with the floor it does.
    """
    msh = mesh.create_rectangle(
        MPI.COMM_WORLD, [[0, 0], [1, 0.5]], [6, 3], mesh.CellType.quadrilateral
    )
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0) | np.isclose(x[0], 1.0))
    surface = ff.ContactSurface(msh, tags, 1)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    rubber = ff.bulk.Elastic(1000.0, 0.0)
    stored = ff.bulk.stored_energy(ff.bulk.small_strain_energy(u, rubber), ufl.dx)
    bcs = []
    for k, value, at in ((1, -0.01, 0.5), (0, 0.0, 1.0)):
        side = mesh.locate_entities_boundary(msh, 1, lambda x, k=k, at=at: np.isclose(x[k], at))
        dofs = fem.locate_dofs_topological(V.sub(k), 1, side)
        bcs.append(fem.dirichletbc(value, dofs, V.sub(k)))
    wall = ff.RigidPlane((1.0, 0.0), (-1.0, 0.0))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v),
        u,
        contact=[ff.Contact(surface, side, ff.Coulomb(0.3)) for side in (FLOOR, wall)],
        bcs=bcs,
        petsc_options_prefix="pins_",
    )
    report = problem.solve()
    assert report.certified
    assert report.contacts[0].force == pytest.approx((0.0, 20.0), abs=1e-8)


# -- initial states --------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("start", [0.05, 0.0, -0.015])
def test_open_touching_and_overlapping_starts_reach_the_same_solution(start):
    """An initial overlap is no history: the first step closes it, as if the body were pressed."""
    model = body(
        lambda msh, s: [
            ff.Contact(s[1], ff.RigidPlane((0.0, -start), (0.0, 1.0)), ff.Coulomb(0.4))
        ],
        "start_",
        energy="small",
        **SQUARE,
    )
    report = model.problem.solve()  # the loads of the start: none
    assert report.certified
    assert report.contacts[0].open == (7 if start > 0.0 else 0)
    assert (report.contacts[0].force[1] > 0.0) == (start < 0.0)
    model.place(np.eye(2), (0.0, -0.02 - start))
    report = model.problem.solve()
    reference = body(on_floor(0.4), "reference_", energy="small", **SQUARE)
    if start < 0.0:  # the overlap was pressed first, then the rest
        reference.place(np.eye(2), (0.0, start))
        reference.problem.solve()
    reference.place(np.eye(2), (0.0, -0.02))
    reference.problem.solve()
    expected = tractions(reference)
    assert tractions(model) == pytest.approx(expected, abs=1e-9 * np.max(abs(expected)))
