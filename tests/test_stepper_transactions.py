"""The load stepper goes back: over failed, tried and cut steps, bit for bit."""

import numpy as np
import pytest
from dolfinx import fem

from fenicsx_friction import LoadStepper, StepperFailed
from fenicsx_friction.increment.snapshot import ProblemSnapshot
from models import by_place, gathered, raous
from sweeps import failing, fingerprint, swept


@pytest.mark.mpi
def test_snapshot_goes_back_over_accepted_steps_bit_for_bit():
    model = swept("snapshot_")
    stepper = LoadStepper(model.problem, model.loads, end=1.0, step=0.2)
    steps = iter(stepper)
    next(steps), next(steps)
    kept, before = ProblemSnapshot(model.problem), fingerprint(model.problem)
    next(steps), next(steps)
    assert sum(a != b for a, b in zip(before, fingerprint(model.problem), strict=True)) > 10
    kept.restore()
    assert fingerprint(model.problem) == before
    # And the same way again gives the same.
    model.loads(0.6)
    assert model.problem.solve().certified


@pytest.mark.mpi
@pytest.mark.parametrize(("error", "call"), [(None, 1), (1e9, 1), (1e9, 2), (1e9, 3)])
def test_failure_leaves_the_last_accepted_step_bit_for_bit(error, call, monkeypatch):
    """Also after whole and half steps that had been committed on trial."""
    model = swept("rollback_")
    model.loads(0.2)
    model.problem.solve()
    before, settings = fingerprint(model.problem), model.problem.settings
    per_attempt = 1 if error is None else call
    calls = failing(model.problem, monkeypatch, lambda n: n % per_attempt == 0)
    stepper = LoadStepper(
        model.problem, model.loads, start=0.2, end=1.0, step=0.4, smallest=0.1, error=error
    )
    with pytest.raises(StepperFailed, match=r"Made to fail") as failure:
        stepper.run()
    assert fingerprint(model.problem) == before
    assert model.problem.settings is settings
    assert model.problem.monitor is None
    assert stepper.time == failure.value.time == 0.2
    assert [f.step for f in failure.value.failed] == pytest.approx([0.4, 0.2, 0.1])
    assert len(calls) == 3 * per_attempt


@pytest.mark.mpi
def test_other_exceptions_leave_the_last_accepted_step_too():
    model = swept("exception_")

    def loads(t):
        model.loads(t)
        if t > 0.5 and model.problem.comm.rank == 0:  # on one rank only
            raise ZeroDivisionError("user's mistake")

    stepper, states = LoadStepper(model.problem, loads, end=1.0, step=0.25), []
    with pytest.raises((ZeroDivisionError, RuntimeError), match="user's mistake"):
        for _ in stepper:
            states.append(fingerprint(model.problem))
    assert len(states) == 2
    assert fingerprint(model.problem) == states[-1]


@pytest.mark.mpi
def test_cut_steps_equal_fixed_steps_of_the_same_sizes(monkeypatch):
    model = swept("cut_")
    failing(model.problem, monkeypatch, lambda n: n in (2, 3, 6))
    records = LoadStepper(model.problem, model.loads, end=1.0, step=0.25).run()
    assert [len(record.failed) for record in records][:2] == [0, 2]
    assert sum(len(record.failed) for record in records) == 3
    assert records[1].failed[0].reason == "Made to fail"
    assert records[1].step == pytest.approx(0.0625)
    fixed = swept("fixed_")
    for record in records:
        fixed.loads(record.time)
        fixed.problem.solve()
    (_, c, u), (_, c_fixed, u_fixed) = gathered(model.problem), gathered(fixed.problem)
    assert c == pytest.approx(c_fixed, abs=1e-9 * np.max(abs(c_fixed)))
    assert u == pytest.approx(u_fixed, abs=1e-9 * np.max(abs(u_fixed)))
    assert model.problem.num_steps == fixed.problem.num_steps == len(records)


def test_uncertified_reports_are_failures_whatever_the_settings(monkeypatch):
    model = raous(4, 4, 1.0, "settings_", raise_on_uncertified=False, tolerance=1e-300)
    stepper = LoadStepper(
        model.problem, lambda t: model.load(t, t), end=1.0, step=0.1, smallest=0.05
    )
    with pytest.raises(StepperFailed, match="no certified solution"):
        stepper.run()
    assert model.problem.num_steps == 0
    assert model.problem.settings.raise_on_uncertified is False


def test_functions_of_the_user_are_history_too(monkeypatch):
    model = swept("history_")
    steps = fem.Function(fem.functionspace(model.problem.u.function_space.mesh, ("DG", 0)))

    def count():
        steps.x.array[:] += 1.0

    failing(model.problem, monkeypatch, lambda n: n == 5)  # the second half of the second step
    stepper = LoadStepper(
        model.problem, model.loads, end=1.0, step=0.5, error=1e9, history=[steps], update=count
    )
    for record in stepper:
        assert np.all(steps.x.array == record.report.step)


@pytest.mark.mpi
def test_a_loop_may_be_left_and_taken_up_again():
    model, whole = swept("left_"), swept("whole_")
    times = []
    stepper = LoadStepper(model.problem, model.loads, end=1.0, step=0.5, error=1e9)
    for record in stepper:
        times.append(record.time)
        assert float(model.motion.angle.value) == 0.01 * record.time  # in the middle of a pair
        break
    times += [record.time for record in stepper]
    assert times == [
        r.time for r in LoadStepper(whole.problem, whole.loads, end=1.0, step=0.5, error=1e9)
    ]
    assert by_place(model.problem.u) == pytest.approx(by_place(whole.problem.u), abs=1e-12)
