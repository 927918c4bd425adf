"""Coordinates and stresses that round: faint loads, tilted planes, models far from the origin."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import stack
from fenicsx_friction.equations.noise import rounding_errors
from models import tagged_facets
from pressed import Half
from rectangles import body, turned
from test_rigid_bodies import platen

STEEL, DENSITY, SIDE, ANGLE = 2e11, 7800.0, 0.1, 0.5


def on_an_incline(prefix, *, density, origin=(0.0, 0.0), gravity=9.81, implicit=False, mu=0.7):
    """Return a steel block of 0.1 m on an incline, held by friction alone, and its weight (N/m)."""
    turn = turned(ANGLE, 2)
    msh = mesh.create_rectangle(MPI.COMM_WORLD, [[0.0, 0.0], [SIDE, SIDE]], [8, 8])
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0))
    msh.geometry.x[:, :2] = msh.geometry.x[:, :2] @ turn.T + origin
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    weight = fem.Constant(msh, np.array([0.0, -DENSITY * gravity]))
    stored = ff.bulk.stored_energy(density(u, ff.bulk.Elastic(STEEL, 0.3)), ufl.dx)
    F = ufl.derivative(stored, u, v) - ufl.inner(weight, v) * ufl.dx
    plane = ff.RigidPlane(origin, turn[:, 1])
    if implicit:
        normal, point = (ufl.as_vector([*map(float, a)]) for a in (turn[:, 1], origin))
        plane = ff.ImplicitObstacle(lambda X: ufl.dot(normal, X - point))
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1), plane, ff.Coulomb(mu))
    problem = ff.FrictionalContactProblem(F, u, contact=contact, petsc_options_prefix=prefix)
    return problem, np.array([0.0, DENSITY * gravity * SIDE**2])


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("name", "gravity", "origin", "implicit"),
    [
        ("small_strain", 9.81, (0.0, 0.0), False),
        ("small_strain", 1e-5, (0.0, 0.0), False),
        ("small_strain", 9.81, (1e5, 2e5), False),
        ("small_strain", 9.81, (0.0, 0.0), True),
        ("neo_hooke", 9.81, (0.0, 0.0), False),
    ],
)
def test_friction_holds_the_weight_of_a_block(name, gravity, origin, implicit):
    density = getattr(ff.bulk, f"{name}_energy")
    prefix = f"weight{name}{gravity:g}{origin[0]:g}{implicit}_"
    problem, weight = on_an_incline(
        prefix, density=density, gravity=gravity, origin=origin, implicit=implicit
    )
    report = problem.solve()
    assert report.certified and report.iterations < 10
    rounding = 1e-16 * np.linalg.norm(origin) / SIDE
    force = np.array(report.contacts[0].force)
    assert np.linalg.norm(force - weight) < (1e-9 + 10.0 * rounding) * weight[1]


@pytest.mark.parametrize(("name", "implicit"), [("small_strain", True), ("neo_hooke", False)])
def test_too_faint_a_load_is_said_to_be_so_at_once(name, implicit):
    density = getattr(ff.bulk, f"{name}_energy")
    problem, _ = on_an_incline(f"faint{name}_", density=density, gravity=1e-2, implicit=implicit)
    with pytest.raises(ff.StepFailed, match="too faint to be resolved: the rounding of") as failed:
        problem.solve()
    assert failed.value.report.iterations < 20  # no other way to solve it is tried
    first = str(failed.value).splitlines()[0]  # the residual itself may be below the tolerance
    assert ("are too faint" in first) == (failed.value.report.certificate.excess <= 1.0)


def test_residual_tells_its_rounding_errors():
    """Of finite strain they are those of the stiffness, of small strain those of the stresses."""
    noise = []
    for density in (ff.bulk.small_strain_energy, ff.bulk.neo_hooke_energy):
        problem, weight = on_an_incline("noise_", density=density)
        problem.solve()
        kept = problem.u.x.array.copy()
        (errors,) = rounding_errors([problem.u], lambda p=problem: [p.balance.momentum()])
        noise.append(np.max(errors) / weight[1])
        assert np.array_equal(kept, problem.u.x.array)
    assert noise[0] < 1e-13
    assert 1e-10 < noise[1] < 1e-7


@pytest.mark.mpi
@pytest.mark.parametrize(("origin", "slack"), [(0.0, 1e-9), (1e4, 1e-7)])
def test_bodies_that_meet_far_from_the_origin_at_an_angle(origin, slack):
    """Faint loads, too: the rounding of coordinates is no gap and no slip of theirs."""
    turn, forces = turned(0.4, 2), []
    for k, warp in enumerate((lambda x: x, lambda x: turn @ x + origin)):
        model = stack(
            0.3,
            f"far{k}{origin:g}_",
            cell="quadrilateral",
            upper=(4, 3),
            lower=(3, 3),
            top=((0.0, 1.0), (1.0, 2.0)),
            base=((-0.5, 0.0), (1.5, 1.0)),
            energy="small",
            warp=warp,
        )
        axes = turn if k else np.eye(2)
        for x, y in ((0.0, -1e-4), (1e-3, -1e-4)):
            model.move(*(axes @ [x, y]))
            report = model.problem.solve()
            assert report.certified and report.iterations < 15
        forces.append(axes.T @ report.contacts[0].force)
    assert forces[0][0] == pytest.approx(-0.3 * forces[0][1], rel=1e-3)  # it slides
    assert forces[1] == pytest.approx(forces[0], rel=slack)


@pytest.mark.mpi
def test_plane_that_moves_far_from_the_origin_presses_as_the_body_does():
    forces = []
    for moves in (False, True):
        origin = np.array([1e4, -3e4])
        problem, _ = on_an_incline(
            f"moves{moves}_", density=ff.bulk.small_strain_energy, origin=origin, gravity=0.0
        )
        msh, u = problem.u.function_space.mesh, problem.u
        motion = ff.RigidMotion(msh, center=origin)
        contact = ff.Contact(
            problem.contacts[0].surface,
            ff.RigidPlane(origin, turned(ANGLE, 2)[:, 1], motion=motion),
            ff.Coulomb(0.3),
        )
        V = u.function_space
        top = fem.Function(V)
        local = (V.tabulate_dof_coordinates()[:, :2] - origin) @ turned(ANGLE, 2)
        held = np.flatnonzero(np.isclose(local[:, 1], SIDE, atol=1e-6)).astype(np.int32)
        problem = ff.FrictionalContactProblem(
            problem.bulk,
            u,
            contact=contact,
            bcs=[fem.dirichletbc(top, held)],
            petsc_options_prefix=f"moved{moves}_",
        )
        way = turned(ANGLE, 2) @ [1e-6, -1e-6]
        if moves:
            motion.translation.value = -way
        else:
            top.x.array[:] = np.tile(way, len(top.x.array) // 2)
        report = problem.solve()
        assert report.certified and report.iterations < 10
        forces.append(np.array(report.contacts[0].force))
    assert forces[1] == pytest.approx(forces[0], rel=1e-9)
    assert np.linalg.norm(forces[0]) > 1e4


@pytest.mark.parametrize("way", [0.0, 1e-17, 1e-10, 1e-5])
@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-4])
def test_a_body_at_finite_strain_that_carries_nothing_moves_freely(way, angle):
    """All its forces are rounding, of the size of the stiffness."""
    problem, _ = on_an_incline(f"idle{way:g}{angle:g}_", density=ff.bulk.neo_hooke_energy)
    V, X = problem.u.function_space, problem.u.function_space.tabulate_dof_coordinates()[:, :2]
    top = fem.Function(V)
    held = np.flatnonzero((X @ turned(ANGLE, 2))[:, 1] > SIDE - 1e-6).astype(np.int32)
    plane = ff.RigidPlane(-0.01 * turned(ANGLE, 2)[:, 1], turned(ANGLE, 2)[:, 1])
    contact = ff.Contact(problem.contacts[0].surface, plane, ff.Coulomb(0.3))
    stored = ff.bulk.neo_hooke_energy(problem.u, ff.bulk.Elastic(STEEL, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(stored, ufl.dx), problem.u, ufl.TestFunction(V))
    problem = ff.FrictionalContactProblem(
        F,
        problem.u,
        contact=contact,
        bcs=[fem.dirichletbc(top, held)],
        petsc_options_prefix=f"free{way:g}{angle:g}_",
    )
    top.x.array[:] = (X @ turned(angle, 2).T - X + way).ravel()
    report = problem.solve()
    assert report.certified and report.iterations < 6
    assert report.contacts[0].force == (0.0, 0.0)
    error = problem.u.x.array - top.x.array.reshape(-1)
    assert np.max(abs(error)) < 1e-13


@pytest.mark.parametrize("far", [100.0, 1e4, 5e5])
def test_a_plane_that_turns_about_a_far_point(far):
    """Given by a point at the origin, turned by 0.5 rad about a pivot at the block."""
    forces = []
    for point in (0.0, far):
        problem, _ = on_an_incline(
            f"pivot{far:g}{point:g}_",
            density=ff.bulk.small_strain_energy,
            origin=(far, 0.0),
            gravity=0.0,
        )
        V, axes = problem.u.function_space, turned(ANGLE, 2)
        motion = ff.RigidMotion(V.mesh, center=(far, 0.0))
        plane = ff.RigidPlane((point, -1.0), (0.0, 1.0), motion=motion)
        contact = ff.Contact(problem.contacts[0].surface, plane, ff.Coulomb(0.3))
        local = (V.tabulate_dof_coordinates()[:, :2] - [far, 0.0]) @ axes
        held = np.flatnonzero(np.isclose(local[:, 1], SIDE, atol=1e-6)).astype(np.int32)
        top = fem.Function(V)
        problem = ff.FrictionalContactProblem(
            problem.bulk,
            problem.u,
            contact=contact,
            bcs=[fem.dirichletbc(top, held)],
            petsc_options_prefix=f"turns{far:g}{point:g}_",
        )
        motion.angle.value, motion.translation.value[:] = ANGLE, axes @ [0.0, 1.0]
        top.x.array[:] = np.tile(axes @ [0.0, -1e-6], len(top.x.array) // 2)
        report = problem.solve()
        assert report.certified and report.iterations < 10
        forces.append(np.array(report.contacts[0].force))
    assert forces[0] == pytest.approx(forces[1], rel=1e-6)
    assert np.linalg.norm(forces[0]) > 1e4


def test_a_belt_that_has_travelled_far_rubs_as_before():
    """Only what it has moved along its normal rounds gaps: nothing."""
    model = body(belt, "belt_", low=(0.0, 0.0), high=(SIDE, SIDE), n=(4, 4), energy="small")
    model.place(np.eye(2), [0.0, -1e-6])
    for travel in (0.0, 1.0, 1e3, 1e5):
        model.contact.obstacle.motion.translation.value[0] = travel
        report = model.problem.solve()
        assert report.certified and report.iterations < 10
    tangential, normal = report.contacts[0].force
    assert tangential == pytest.approx(0.3 * normal, rel=1e-9)


def belt(msh, surfaces):
    """A plane that is to move along itself."""
    plane = ff.RigidPlane((0.0, 0.0), (0.0, 1.0), motion=ff.RigidMotion(msh))
    return [ff.Contact(surfaces[1], plane, ff.Coulomb(0.3))]


@pytest.mark.mpi
@pytest.mark.parametrize("energy", ["small", "finite"])
def test_an_unloaded_body_may_wait(energy):
    """Tractions of the size of what stresses round are nothing, in each of the idle steps."""
    model = Half(f"waits_{energy}_", platen, mu=0.3, energy=energy)
    given = model.body.given.value
    for x, y in ((0.0, -0.05), (0.02, -0.05), *[(0.02, 0.0)] * 8, (0.02, 0.1), (0.02, 0.1)):
        given[:2] = x, y
        assert model.problem.solve().certified
        if y >= 0.0:
            assert np.max(abs(model.u.x.array)) < 1e-12
