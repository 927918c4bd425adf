"""PETSc objects are destroyed in the program's order, the same on all ranks."""

import gc
import weakref

from mpi4py import MPI

import pytest

import fenicsx_friction as ff
from bodies import stack
from fenicsx_friction.laws import rows
from fenicsx_friction.loading import relaxation
from fenicsx_friction.solvers import condensing, newton
from models import raous
from test_relaxation import arch, path


@pytest.fixture
def alive(monkeypatch):
    """References to all solvers that are made; no garbage collector."""
    made = []

    def watch(where, name):
        class Watched(getattr(where, name)):
            def __init__(self, *args, **kwargs):
                super().__init__(*args, **kwargs)
                made.append(weakref.ref(self))

        monkeypatch.setattr(where, name, Watched)

    watch(newton, "NonlinearProblem")
    watch(condensing, "BoundaryNewton")
    watch(condensing, "CondensedBulk")
    gc.disable()
    yield lambda: [problem() is not None for problem in made]
    gc.enable()


def test_problem_goes_with_its_last_reference(alive):
    model = raous(4, 4, 1.0, "lifetime_")
    model.problem.solve()
    assert any(alive())
    del model
    assert not any(alive())


def test_stepper_keeps_nothing(alive):
    model = raous(4, 4, 1.0, "lifetime_stepper_")
    stepper = ff.LoadStepper(
        model.problem, lambda t, model=model: model.load(t, t), end=1.0, step=0.5
    )
    assert len(list(stepper)) == 2
    assert any(alive())
    del model, stepper
    assert not any(alive())


def test_failed_step_keeps_nothing(alive, monkeypatch):
    monkeypatch.setattr(rows, "projection_row", lambda s, c_t, limit, r, eps: r * s)

    def fail() -> bool:
        try:
            raous(4, 4, 1.0, "lifetime_failure_").problem.solve()
        except ff.StepFailed:
            return True
        return False

    assert fail()
    assert alive()
    assert not any(alive())


def test_pairs_keep_nothing(alive):
    model = stack(0.5, "lifetime_pairs_")
    model.move(0.0, 0.0, -0.01)
    model.problem.solve()
    assert any(alive())
    del model
    assert not any(alive())


@pytest.mark.parametrize("most", [100, 1])
def test_relaxation_keeps_nothing(alive, most, monkeypatch):
    """Neither one that finds the next equilibrium after failed increments, nor one that fails."""
    monkeypatch.setattr(relaxation, "MAX_INCREMENTS", most)

    def snap():
        problem, _, _, creep, loads = arch(MPI.COMM_WORLD, "lifetime_snap_", 0.2)
        try:
            return sum(record.relaxed for record in path(loads, problem, relaxation=creep))
        except ff.StepFailed:
            return -1

    assert (snap() > 0) == (most > 1)
    assert alive()
    assert not any(alive())
