"""A swept block for tests of the load stepper, and what they look at."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from models import tagged_facets


@dataclass
class Swept:
    """A 2D block held at its top, pressed and swept by a moving floor."""

    problem: ff.FrictionalContactProblem
    contact: ff.Contact
    motion: ff.RigidMotion
    stored: ufl.Form

    def loads(self, t: float) -> None:
        """Press, sweep, turn the floor a little."""
        self.motion.translation.value = [0.03 * t * (2.0 - t), 0.02 * t]
        self.motion.angle.value = 0.01 * t


def swept(prefix, mu=0.4, **settings) -> Swept:
    msh = mesh.create_rectangle(
        MPI.COMM_WORLD, [[0.0, 0.0], [1.0, 0.5]], [8, 3], mesh.CellType.quadrilateral
    )
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 0.5))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    energy = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E=100.0, nu=0.3))
    stored = ff.bulk.stored_energy(energy, ufl.dx)
    held = fem.locate_dofs_topological(V, 1, tags.find(2))
    motion = ff.RigidMotion(msh)
    floor = ff.RigidPlane((0.0, 0.0), (0.0, 1.0), motion=motion)
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1), floor, ff.Coulomb(mu))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(np.zeros(2), held, V)],
        petsc_options_prefix=prefix,
        settings=ff.StepSettings(**settings),
    )
    return Swept(problem, contact, motion, stored)


def fingerprint(problem) -> list[bytes]:
    """Return all values of a problem that may change in a step."""
    functions = [*problem.unknowns, problem.u_old]
    constants = [problem.dt]
    for k in problem.contacts:
        functions += [k.c, k.path, k.hint, k.c_stick, k.slipping, k.slip_scale, k.r]
        if (motion := k.obstacle.motion) is not None:
            constants += [motion.translation, motion._old_translation]
            constants += [motion.angle, motion._old_angle]
    values = [f.x.array.tobytes() for f in functions] + [c.value.tobytes() for c in constants]
    states = [a.tobytes() for s in problem.accepted for a in (s.gap, s.slip, s.c, s.limit)]
    slip = [k.slip_increment.tobytes() for k in problem.contacts]
    return [*values, *states, *slip, str(problem.num_steps).encode()]


def failing(problem, monkeypatch, fails):
    """Let ``solve`` do its work and fail all the same when ``fails(call)`` says so."""
    solve, calls = problem.solve, []

    def fail():
        calls.append(float(problem.dt.value))
        report = solve()
        if fails(len(calls)):
            raise ff.StepFailed("Made to fail; on purpose.", report)
        return report

    monkeypatch.setattr(problem, "solve", fail)
    return calls


def follow(points):
    """Return the way through points at times 0, 1, 2, ... as a function of time."""
    points = np.array(points)
    return lambda t: [np.interp(t, np.arange(len(points)), column) for column in points.T]
