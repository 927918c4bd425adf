# SPDX-License-Identifier: MIT
"""Steps that start where the last one points to: fewer solves, the same states."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

import fenicsx_friction as ff
from bodies import box, joined, sides
from fenicsx_friction.increment import trial
from fenicsx_friction.increment.snapshot import ProblemSnapshot
from models import by_place

#: Way of the top (m): down, along, back again, up.
PRESSED = [(0.0, -0.004 * k) for k in range(1, 5)]
DRAGGED = [(0.006 * k, -0.016) for k in range(1, 6)]
BACK = [(0.03 - 0.006 * k, -0.016) for k in range(1, 6)]
RAISED = [(0.0, -0.016 + 0.004 * k) for k in range(1, 6)]
PATH = PRESSED + DRAGGED + BACK + RAISED


def rubber_block(name, method="mortar", **settings):
    """Return the problem of a block on a base, both of rubber, and what makes a step."""
    base = box((0.0, 0.0), (2.0, 0.5), (9, 3), "quadrilateral")
    block = box((0.52, 0.5), (1.22, 1.0), (5, 3), "quadrilateral")
    msh = joined(MPI.COMM_WORLD, base, block)
    tags = sides(msh, 1, (0.0, 0.5, 0.5, 1.0), 1e-7)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    rubber = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(100.0, 0.3))
    ground, top = (fem.Function(V) for _ in range(2))
    bcs = [
        fem.dirichletbc(f, fem.locate_dofs_topological(V, 1, tags.find(tag)))
        for f, tag in ((ground, 3), (top, 4))
    ]
    surfaces = [ff.ContactSurface(msh, tags, tag, f"side {tag}") for tag in (1, 2)]
    obstacle = ff.DeformableObstacle(surfaces[1], method=method)
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(rubber, ufl.dx), u, v),
        u,
        contact=ff.Contact(surfaces[0], obstacle, ff.Coulomb(0.4)),
        bcs=bcs,
        petsc_options_prefix=name,
        settings=ff.StepSettings(**settings),
    )

    def step(x, y):
        top.x.array[:] = np.tile([x, y], len(top.x.array) // 2)
        return problem.solve()

    return problem, step


def pressed_block(name):
    """Return the same after three steps down: the next one goes on as they did."""
    problem, step = rubber_block(name)
    for way in PRESSED[:3]:
        step(*way)
    return problem, step


def run(name, path, method="mortar", **settings):
    """Go along a path; return the forces of the steps, their solves, and the problem."""
    problem, step = rubber_block(name, method, **settings)
    reports = [step(*way) for way in path]
    forces = np.array([r.contacts[0].force for r in reports])
    return forces, [r.iterations for r in reports], problem


@pytest.mark.mpi
@pytest.mark.parametrize("method", ["mortar", "node-to-face"])
def test_it_saves_solves_and_changes_nothing(method):
    """Press, drag, drag back and raise: the same forces with a third fewer solves."""
    plain, before, other = run("plain_", PATH, method, extrapolation=False)
    forces, now, problem = run("along_", PATH, method)
    assert abs(forces - plain).max() < 1e-8 * abs(plain).max()
    assert abs(by_place(problem.u) - by_place(other.u)).max() < 1e-8
    straight = np.r_[2:4, 6:9, 11:14]  # where the path goes on as in the step before
    assert np.sum(np.take(now, straight)) <= 0.75 * np.sum(np.take(before, straight))
    assert sum(now) < sum(before)


@pytest.mark.mpi
@pytest.mark.parametrize("rate", [1e6, -1e-1, 1e308, np.inf, np.nan])
def test_a_way_to_nowhere_is_not_taken(rate):
    """Rates that lead away from balance, or to no numbers at all, change nothing."""
    path = PRESSED + DRAGGED[:1]
    expected, solves, reference = run("straight_", path, extrapolation=False)
    problem, step = rubber_block("astray_")
    for k, way in enumerate(path):
        for f in problem.rates:
            f.x.array[:] = rate
        assert step(*way).iterations == solves[k]
    assert abs(by_place(problem.u) - by_place(reference.u)).max() < 1e-13
    assert abs(expected[-1]).max() > 0.0


@pytest.mark.mpi
def test_a_start_that_leads_nowhere_loses_no_step(monkeypatch):
    """Where Newton's method fails from there, the step is solved as if it had not been tried."""
    expected, _, reference = run("usual_", PRESSED, extrapolation=False, fallbacks=0)

    def far_off(system):
        system.u.x.array[:] += 10.0 * np.cos(np.arange(len(system.u.x.array)))
        return True

    monkeypatch.setattr(trial, "extrapolate", far_off)
    forces, _, problem = run("nowhere_", PRESSED, fallbacks=0)
    assert abs(forces - expected).max() < 1e-10 * abs(expected).max()
    assert abs(by_place(problem.u) - by_place(reference.u)).max() < 1e-12


@pytest.mark.mpi
@pytest.mark.parametrize("dt", [1e-310, 1e308])
def test_lengths_of_steps_at_the_ends_of_numbers(dt, tmp_path):
    """Rates that overflow lead nowhere, and a checkpoint can be written."""
    problem, step = rubber_block("ends_")
    path = MPI.COMM_WORLD.bcast(tmp_path / "state.h5")
    for way, length in zip(PRESSED, (1.0, dt, dt, 1.0), strict=True):
        problem.dt.value = length
        assert step(*way).certificate.solved
        ff.write_checkpoint(path, problem)


@pytest.mark.mpi
def test_the_start_of_the_user_is_kept():
    """Values that the user gives the displacement are the start, those of held dofs aside."""
    problem, step = pressed_block("start_")
    kept = ProblemSnapshot(problem)
    onward = step(*PRESSED[3]).iterations
    found = problem.u.x.array.copy()
    for changed, same in ((1e-9, False), (0.0, True)):
        kept.restore()
        free = np.setdiff1d(np.arange(len(found)), problem.constrained_dofs)
        problem.u.x.array[free] += changed
        problem.u.x.array[problem.constrained_dofs] *= 1.01
        assert (step(*PRESSED[3]).iterations == onward) is same
        assert abs(problem.u.x.array - found).max() < 1e-10


@pytest.mark.mpi
def test_a_step_of_another_length_starts_as_far_on():
    """A step of half the time goes half as far: the start is that of half the load."""
    problem, step = pressed_block("half_")
    kept = ProblemSnapshot(problem)
    (x, y), (_, end) = PRESSED[2], PRESSED[3]
    solves = []
    for dt in (1.0, 0.5):
        kept.restore()
        problem.dt.value = dt
        solves.append(step(x, (y + end) / 2.0).iterations)
    assert solves[1] < solves[0]
    assert abs(problem.rates[0].x.array).max() > 0.0


@pytest.mark.mpi
def test_a_run_that_is_resumed_takes_the_same_starts(tmp_path):
    """The rates are in the checkpoint: the next steps are the same."""
    path = MPI.COMM_WORLD.bcast(tmp_path / "state.h5")
    problem, step = pressed_block("whole_")
    ff.write_checkpoint(path, problem)
    solves = [step(*way).iterations for way in PRESSED[3:] + DRAGGED]
    again, step = rubber_block("resumed_")
    ff.read_checkpoint(path, again)
    kept = ProblemSnapshot(again)
    assert [step(*way).iterations for way in PRESSED[3:] + DRAGGED] == solves
    assert abs(by_place(again.u) - by_place(problem.u)).max() < 1e-13
    kept.restore()
    for f in again.rates:  # without them the next step takes longer
        f.x.array[:] = 0.0
    assert step(*PRESSED[3]).iterations > solves[0]


def test_settings_say_what_is_wrong():
    with pytest.raises(ff.ContactInputError, match="extrapolation = 1 must be"):
        ff.StepSettings(extrapolation=1)
