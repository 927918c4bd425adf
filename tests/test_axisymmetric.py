# SPDX-License-Identifier: MIT
"""Axisymmetric contact: patch test, Hertz, shrink fit, totals of rings, errors."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import joined
from models import tagged_facets

HEXAHEDRON = mesh.CellType.hexahedron
E, NU = 1000.0, 0.3


def graded(n, ratio, length):
    """Points from 0 to a length, the first cell smaller than the last by a ratio."""
    steps = np.geomspace(1.0, ratio, n)
    return np.concatenate([[0.0], np.cumsum(steps)]) / np.sum(steps) * length


def half_plane(r, z, cell="quadrilateral"):
    """A mesh of a half-plane between given radii and heights."""
    kind = getattr(mesh.CellType, cell)
    msh = mesh.create_rectangle(
        MPI.COMM_WORLD, [(0.0, 0.0), (1.0, 1.0)], [len(r) - 1, len(z) - 1], kind
    )
    x = msh.geometry.x
    for axis, places in enumerate((r, z)):
        x[:, axis] = np.interp(x[:, axis], np.linspace(0.0, 1.0, len(places)), places)
    return msh


class Body:
    """An elastic body of revolution that meets obstacles from above; its bottom is held in z."""

    def __init__(self, name, msh, obstacle, degree=1, mu=0.0, nodes=1, axis=True):
        height = msh.comm.allreduce(np.max(msh.geometry.x[:, 1], initial=-np.inf), MPI.MAX)
        low = msh.comm.allreduce(np.min(msh.geometry.x[:, 1], initial=np.inf), MPI.MIN)
        tags = tagged_facets(msh, lambda x: np.isclose(x[1], height))
        V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        density = ff.bulk.small_strain_energy(self.u, ff.bulk.Elastic(E, NU), axisymmetric=True)
        energy = ff.bulk.stored_energy(density, ufl.dx, degree=2 * degree + 2, axisymmetric=True)
        F = ufl.derivative(energy, self.u, v)
        zero = fem.Constant(msh, 0.0)
        bcs = []
        on_axis = [(0, lambda x: x[0] < 1e-12)] if axis else []
        for component, place in ((1, lambda x: np.isclose(x[1], low)), *on_axis):
            facets = mesh.locate_entities_boundary(msh, 1, place)
            dofs = fem.locate_dofs_topological(V.sub(component), 1, facets)
            bcs.append(fem.dirichletbc(zero, dofs, V.sub(component)))
        surface = ff.ContactSurface(msh, tags, 1, "top", degree=nodes, axisymmetric=True)
        law = ff.Coulomb(mu) if mu else ff.Frictionless()
        self.contact = ff.Contact(surface, obstacle(msh), law)
        self.problem = ff.FrictionalContactProblem(
            F, self.u, contact=self.contact, bcs=bcs, petsc_options_prefix=name
        )


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize(
    ("cell", "degree"),
    [("quadrilateral", 1), ("triangle", 1), ("quadrilateral", 2), ("triangle", 2)],
)
def test_uniform_pressure_is_exact(cell, degree):
    """A bar between lubricated plates: the true pressure at each node, the force of the ring."""
    r = graded(5, 3.0, 0.7)
    motions = []

    def plate(msh):
        motions.append(ff.RigidMotion(msh))
        return ff.RigidPlane((0.0, 1.0), (0.0, -1.0), motion=motions[0])

    body = Body(f"bar_{cell}{degree}_", half_plane(r, graded(3, 2.0, 1.0), cell), plate, degree)
    motions[0].translation.value[1] = -0.01
    report = body.problem.solve()
    pressure = body.contact.nodal().c[:, 0]
    assert np.allclose(pressure, E * 0.01, rtol=1e-10)
    force = report.contacts[0].force[1]
    assert force == pytest.approx(-E * 0.01 * np.pi * 0.7**2, rel=1e-10)
    assert report.contacts[0].moment == (0.0,)


def test_without_the_radius_the_pressure_would_be_wrong(monkeypatch):
    """The mutation: areas without circumference."""
    monkeypatch.setattr("fenicsx_friction.surfaces.surface.circumference", lambda msh: 1.0)
    motions = []

    def plate(msh):
        motions.append(ff.RigidMotion(msh))
        return ff.RigidPlane((0.0, 1.0), (0.0, -1.0), motion=motions[0])

    body = Body("mutant_", half_plane(np.linspace(0, 1, 5), np.linspace(0, 1, 3)), plate)
    motions[0].translation.value[1] = -0.01
    body.problem.solve()
    assert not np.allclose(body.contact.nodal().c[:, 0], E * 0.01, rtol=0.1)


def hertz(name, n, degree=1, nodes=1, size=1.0):
    """A ball of radius 1 pressed on a half-space by a force, its contact radius a = 0.05."""
    a, R = 0.05, 1.0
    modulus = E / (1.0 - NU**2)
    force = 4.0 / 3.0 * modulus * a**3 / R
    h = a / n
    inner = np.arange(0.0, 2.0 * a + h / 2, h)
    outer = graded(int(14 + n / 2), 60.0, size - inner[-1]) + inner[-1]
    r = np.concatenate([inner, outer[1:]])
    z = -np.concatenate([inner, outer[1:]])[::-1]
    bodies = []

    def ball(msh):
        bodies.append(ff.RigidBody(msh, center=(0.0, R)))
        return ff.RigidSphere((0.0, R), R, motion=bodies[0])

    model = Body(name, half_plane(r, z), ball, degree, nodes=nodes)
    bodies[0].given.value[1] = -0.5 * a**2 / R
    model.problem.solve()
    bodies[0].free = ("y",)
    bodies[0].force.value[1] = -force
    report = model.problem.solve()
    nodal = model.contact.nodal()
    comm, x = model.problem.comm, model.contact.surface.x[:, 0]
    p0 = 3.0 * force / (2.0 * np.pi * a**2)
    exact = p0 * np.sqrt(np.maximum(1.0 - (x / a) ** 2, 0.0))
    peak = comm.allreduce(np.max(nodal.c[:, 0], initial=0.0), MPI.MAX)
    error, norm = comm.allreduce(
        np.array([np.sum(nodal.area * (nodal.c[:, 0] - exact) ** 2), np.sum(nodal.area * exact**2)])
    )
    return report, force, peak / p0 - 1.0, np.sqrt(error / norm)


def test_hertz_ball():
    """The peak within 0.5 % at a/20; pressing by the force of the ring."""
    report, force, peak, profile = hertz("ball_", 20)
    assert report.contacts[0].force[1] == pytest.approx(-force, rel=1e-9)
    assert report.bodies[0].force == pytest.approx((0.0, force), rel=1e-9)
    assert report.bodies[0].moment == (0.0,)
    assert abs(peak) < 5e-3
    assert profile < 0.035


def test_shrink_fit():
    """A ring over a ring, overlap delta: Lame's pressure, second order in the mesh."""
    inner, fit, outer, delta = 0.5, 1.0, 1.6, 1e-3
    errors = []
    for n in (4, 8):
        z = np.linspace(0.0, 0.25, 2)
        parts = [
            half_plane(np.linspace(*ends, n + 1), z)
            for ends in ((inner, fit + delta / 2), (fit - delta / 2, outer))
        ]
        msh = joined(MPI.COMM_SELF, *parts)
        tags = tagged_facets(
            msh,
            lambda x: np.isclose(x[0], fit + delta / 2),
            lambda x: np.isclose(x[0], fit - delta / 2),
        )
        V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        u, v = fem.Function(V), ufl.TestFunction(V)
        density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU), axisymmetric=True)
        energy = ff.bulk.stored_energy(density, ufl.dx, degree=3, axisymmetric=True)
        ends = mesh.locate_entities_boundary(
            msh, 1, lambda x: np.isclose(x[1], 0.0) | np.isclose(x[1], 0.25)
        )
        dofs = fem.locate_dofs_topological(V.sub(1), 1, ends)
        surfaces = [
            ff.ContactSurface(msh, tags, tag, name, axisymmetric=True)
            for tag, name in ((1, "shaft"), (2, "hub"))
        ]
        contact = ff.Contact(surfaces[0], ff.DeformableObstacle(surfaces[1]), ff.Frictionless())
        problem = ff.FrictionalContactProblem(
            ufl.derivative(energy, u, v),
            u,
            contact=contact,
            bcs=[fem.dirichletbc(fem.Constant(msh, 0.0), dofs, V.sub(1))],
            petsc_options_prefix=f"shrink_{n}_",
        )
        assert problem.solve().certified
        modulus = E / (1.0 - NU**2)
        hub, shaft = (
            (a**2 + b**2) / (b**2 - a**2) + sign * NU / (1.0 - NU)
            for a, b, sign in ((fit, outer, 1.0), (inner, fit, -1.0))
        )
        exact = modulus * delta / fit / (hub + shaft)
        pressure = contact.nodal().c[:, 0]
        assert np.ptp(pressure) < 1e-9 * exact
        errors.append(abs(pressure[0] / exact - 1.0))
    assert errors[1] < 5e-3
    assert errors[0] / errors[1] > 3.0


def test_the_same_in_three_dimensions():
    """A cone pressed into the mouth of a tube with friction: a quarter of it in 3D, within 1 %."""
    depth, mu, n, around = 0.02, 0.3, 6, 16
    r, z = np.linspace(0.5, 1.0, n + 1), np.linspace(0.0, 0.6, n + 1)

    def cone(msh):
        def gap(X):
            radius = ufl.sqrt(sum(X[i] ** 2 for i in range(len(X) - 1)))
            return (X[len(X) - 1] - 0.6 - (radius - 0.5) * 0.8) / np.sqrt(1.64)

        motions.append(ff.RigidMotion(msh))
        return ff.ImplicitObstacle(lambda X: -gap(X), motion=motions[-1])

    motions = []
    ring = Body("tube_", half_plane(r, z), cone, mu=mu, axis=False)
    msh = mesh.create_box(MPI.COMM_WORLD, [(0, 0, 0), (1, 1, 1)], [n, around, n], HEXAHEDRON)
    x = msh.geometry.x
    radius, angle = 0.5 + 0.5 * x[:, 0], 0.5 * np.pi * x[:, 1]
    x[:] = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.6 * x[:, 2]])
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    bcs = []
    for axis, place in ((2, 2), (0, 0), (1, 1)):
        facets = mesh.locate_entities_boundary(msh, 2, lambda x, i=place: np.isclose(x[i], 0.0))
        dofs = fem.locate_dofs_topological(V.sub(axis), 2, facets)
        bcs.append(fem.dirichletbc(fem.Constant(msh, 0.0), dofs, V.sub(axis)))
    top = mesh.locate_entities_boundary(msh, 2, lambda x: np.isclose(x[2], 0.6))
    tags = mesh.meshtags(msh, 2, np.sort(top), np.full(len(top), 1, dtype=np.int32))
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1), cone(msh), ff.Coulomb(mu))
    solid = ff.FrictionalContactProblem(
        F, u, contact=contact, bcs=bcs, petsc_options_prefix="solid_"
    )
    for motion in motions:
        motion.translation.value[-1] = -depth
    flat, full = ring.problem.solve().contacts[0], solid.solve().contacts[0]
    assert flat.slip + flat.stick > 0
    assert 4.0 * full.force[2] == pytest.approx(flat.force[1], rel=0.01)


@pytest.mark.parametrize(
    ("low", "options", "message"),
    [
        ((-0.5, 0.0), {}, r"nodes at the radius x = -0\.5"),
        ((0.0, 0.0), {"degree": 2}, "have none on the axis"),
        ((0.0, 0.0), {"axisymmetric": 1}, "must be True or False"),
    ],
)
def test_wrong_rings(low, options, message):
    msh = mesh.create_rectangle(MPI.COMM_SELF, [low, (1.0, 1.0)], [2, 2])
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 1.0))
    with pytest.raises(ff.ContactInputError, match=message):
        ff.ContactSurface(msh, tags, 1, **{"axisymmetric": True, **options})


def test_a_ring_in_three_dimensions_is_refused():
    msh = mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1)
    msh.topology.create_connectivity(2, 3)
    facets = mesh.exterior_facet_indices(msh.topology)[:1]
    tags = mesh.meshtags(msh, 2, facets, np.ones(1, dtype=np.int32))
    with pytest.raises(ff.ContactInputError, match="mesh in 2D"):
        ff.ContactSurface(msh, tags, 1, axisymmetric=True)


def test_bodies_move_along_the_axis_only():
    def ball(msh):
        body = ff.RigidBody(msh, center=(0.0, 2.0), free=("x", "y"))
        return ff.RigidSphere((0.0, 2.0), 1.0, motion=body)

    body = Body("sideways_", half_plane(np.linspace(0, 1, 3), np.linspace(0, 1, 3)), ball)
    with pytest.raises(ff.ContactInputError, match="along the axis"):
        body.problem.solve()
