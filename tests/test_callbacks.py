"""Exceptions of one rank, in functions of the user: raised on all ranks, nothing is half done."""

import pickle

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem

import fenicsx_friction as ff
from fenicsx_friction.base.collective import on_all_ranks, on_first_rank
from fenicsx_friction.increment.snapshot import ProblemSnapshot
from fenicsx_friction.loading import stepper as stepper_module
from fenicsx_friction.loading.failures import Inaccurate
from fenicsx_friction.loading.step_solver import SolvedStep
from models import raous

LAST = MPI.COMM_WORLD.size - 1


def on_last_rank(error):
    """Return what raises an error on the last rank only."""

    def work(*_):
        if MPI.COMM_WORLD.rank == LAST:
            raise error

    return work


class Stubborn(Exception):
    """Cannot be copied to another process."""

    def __init__(self, first, second):
        super().__init__(first)
        self.second = lambda: second


class Misleading(Exception):
    """Comes back from a copy as something else."""

    def __reduce__(self):
        return ValueError, self.args


FAILED = ff.StepFailed("made to fail", None)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (ZeroDivisionError("one"), ZeroDivisionError),
        (ff.ContactInputError("two"), ff.ContactInputError),
        (FAILED, ff.StepFailed),
        (KeyboardInterrupt(), KeyboardInterrupt),
        (SystemExit(3), SystemExit),
        (UnicodeDecodeError("utf-8", b"x", 0, 1, "why"), UnicodeDecodeError),
        (Stubborn("three", 3), Stubborn if LAST == 0 else RuntimeError),
        (Misleading("four"), Misleading if LAST == 0 else RuntimeError),
    ],
)
def test_all_ranks_raise_the_same_exception(comm, error, expected):
    """Whoever catches some kinds only must not go on alone; no rank waits for another."""
    with pytest.raises(expected) as raised:
        on_all_ranks(comm, on_last_rank(error))
    assert type(raised.value) is expected
    assert str(error) in str(raised.value)
    if comm.rank == LAST and expected is type(error):
        assert raised.value is error
    assert comm.allreduce(1) == comm.size


@pytest.mark.mpi
def test_the_first_of_several_exceptions_is_raised(comm):
    def work():
        if comm.rank == 0:
            raise KeyError("first")
        raise ff.StepFailed("second", None)

    with pytest.raises(KeyError, match="first"):
        on_all_ranks(comm, work)
    assert on_all_ranks(comm, lambda: comm.rank) == comm.rank
    assert on_first_rank(comm, lambda: comm.size) == (comm.size if comm.rank == 0 else None)
    with pytest.raises(KeyError, match="first"):
        on_first_rank(comm, work)


# -- the stepper ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def model():
    return raous(4, 4, 0.5, "callbacks_")


def state(problem):
    """Return all values of a problem that may change in a step."""
    (contact,) = problem.contacts
    functions = [*problem.unknowns, problem.u_old, contact.c, contact.path, contact.hint]
    values = [f.x.array.tobytes() for f in functions] + [contact.slip_increment.tobytes()]
    return [*values, problem.num_steps, len(problem.accepted), float(problem.dt.value)]


@pytest.mark.mpi
@pytest.mark.parametrize("error", [ZeroDivisionError("mine"), KeyboardInterrupt("mine")])
@pytest.mark.parametrize("where", ["loads", "update"])
@pytest.mark.parametrize("doubling", [None, 0.5])
def test_a_callback_that_raises_on_one_rank(model, where, error, doubling):
    """All raise it, at the last accepted step, with the loads and settings of before."""
    problem, seen, calls = model.problem, [], []
    settings = problem.settings

    def loads(t):
        seen.append(t)
        model.load(t, t)
        if where == "loads" and t > 0.6:
            on_last_rank(error)()

    def update():
        calls.append(problem.num_steps)
        if where == "update" and seen[-1] > 0.6:
            on_last_rank(error)()

    stepper = ff.LoadStepper(problem, loads, end=1.0, step=0.25, error=doubling, update=update)
    before = state(problem)
    with pytest.raises(type(error), match="mine"):
        for _ in stepper:
            before = state(problem)
    assert state(problem) == before
    assert 0.0 < stepper.time <= 0.6 and seen[-1] == stepper.time
    assert problem.settings is settings
    assert problem.monitor is None
    assert calls
    where = "nowhere"
    assert stepper.run()[-1].time == 1.0


@pytest.mark.mpi
def test_update_may_reject_a_step(model):
    """By StepFailed, on one rank."""
    problem = model.problem

    def update():
        if float(problem.dt.value) > 0.2:
            on_last_rank(ff.StepFailed("Too long", None))()

    stepper = ff.LoadStepper(
        problem, lambda t: model.load(t, t), end=1.0, step=0.3, update=update, easy=0
    )
    records = stepper.run()
    assert records[0].failed[0].reason == "Too long"
    assert max(record.step for record in records) <= 0.2


@pytest.mark.mpi
@pytest.mark.parametrize("steps", [1, 2])
def test_loads_that_fail_when_a_half_step_is_handed_out(model, steps):
    """The state of each half is put back: not only while solving can loads fail."""
    problem, audit = model.problem, ff.EnergyAudit(model.problem, model.stored, model.loads)
    handed, after, failing = [], [], True

    def loads(t):
        after.append(t)
        model.load(t, t)
        # Solved as whole, half, half; then handed out as half, half.
        if failing and len(after) == 3 + steps:
            on_last_rank(ArithmeticError("late"))()

    stepper = ff.LoadStepper(problem, loads, end=1.0, step=1.0, error=1e9, audit=audit)
    before = state(problem)
    with pytest.raises(ArithmeticError, match="late"):
        for record in stepper:
            handed.append(record)
            before = state(problem)
    assert len(handed) == steps - 1
    assert state(problem) == before
    assert stepper.time == (0.0 if steps == 1 else 0.5)
    failing = False
    handed += stepper.run()
    assert [record.time for record in handed][-1] == 1.0
    whole = sum((r.energy for r in handed[1:]), handed[0].energy)
    assert abs(whole.external_work) > 0.0
    assert audit._energy == pytest.approx(whole.stored, rel=1e-6, abs=1e-3 * abs(whole.stored))


def test_an_audit_that_is_interrupted_forgets_what_it_added(model, monkeypatch):
    """Of the increments of one step, in the middle of them."""
    model.load(0.5, 0.5)
    model.problem.solve()
    audit, calls = ff.EnergyAudit(model.problem, model.stored, model.loads), []
    audit._step -= 1  # as if the last step had come after
    stepper = ff.LoadStepper(
        model.problem, lambda t: model.load(t, t), end=1.0, step=1.0, audit=audit
    )
    audited, before = ff.EnergyAudit.update, dict(vars(audit))

    def update(self):
        if calls:
            raise KeyboardInterrupt
        calls.append(audited(self))
        return calls[-1]

    monkeypatch.setattr(ff.EnergyAudit, "update", update)
    state_now = ProblemSnapshot(model.problem)
    solved = SolvedStep(1.0, 1.0, None, (state_now, state_now))
    with pytest.raises(KeyboardInterrupt):
        stepper._solver.audited(solved)
    assert len(calls) == 1
    assert all(vars(audit)[name] is value for name, value in before.items())


@pytest.fixture(autouse=True)
def fresh(model):
    """Start each test from the same state."""
    kept = ProblemSnapshot(model.problem)
    yield
    kept.restore()


@pytest.mark.mpi
@pytest.mark.parametrize("leave", ["failure", "input", "interrupt"])
def test_settings_are_as_they_were_however_the_solve_ends(model, leave, monkeypatch):
    problem, settings = model.problem, model.problem.settings
    asked = []

    def solve():
        asked.append(problem.settings.raise_on_uncertified)
        raise {
            "failure": FAILED,
            "input": ff.ContactInputError("no"),
            "interrupt": KeyboardInterrupt(),
        }[leave]

    monkeypatch.setattr(problem, "solve", solve)
    monkeypatch.setattr(problem, "settings", ff.StepSettings(raise_on_uncertified=False))
    settings = problem.settings
    stepper = ff.LoadStepper(problem, lambda t: model.load(t, t), end=1.0, step=0.5, smallest=0.2)
    with pytest.raises((ff.StepperFailed, ff.ContactInputError, KeyboardInterrupt)):
        stepper.run()
    assert set(asked) == {True}
    assert problem.settings is settings


# -- failures in other processes --------------------------------------------------------------


def test_failures_can_be_pickled(model):
    """With the report and whatever attributes, as a pool of processes does."""
    model.problem.settings = ff.StepSettings(tolerance=1e-300)
    try:
        with pytest.raises(ff.StepperFailed) as failure:
            ff.LoadStepper(
                model.problem, lambda t: model.load(t, t), end=1.0, step=0.5, smallest=0.4
            ).run()
    finally:
        model.problem.settings = ff.StepSettings()
    error, cause = failure.value, failure.value.__cause__
    inaccurate = Inaccurate(0.5, 0.1, error.report)
    for original in (error, cause, inaccurate):
        for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
            copy = pickle.loads(pickle.dumps(original, protocol))
            assert type(copy) is type(original)
            assert str(copy) == str(original) != ""
            assert copy.report == error.report
            assert vars(copy) == vars(original)
    assert isinstance(error.report, ff.StepReport)
    assert error.failed and error.time == 0.0
    assert isinstance(cause, ff.StepFailed)


@pytest.mark.mpi
def test_a_gone_terminal_ends_no_run(model, monkeypatch):
    """The bar is rank 0's alone: its exceptions would leave the others waiting."""
    from rich.console import Console

    class Gone:
        encoding = "utf-8"

        def write(self, text):
            raise OSError(5, "Input/output error")

        def flush(self):
            raise OSError(5, "Input/output error")

        def isatty(self):
            return True

    terminal = Console(file=Gone(), force_terminal=True)
    monkeypatch.setattr(stepper_module, "find_terminal", lambda: terminal)
    stepper = ff.LoadStepper(model.problem, lambda t: model.load(t, t), end=1.0, step=0.5)
    assert len(stepper.run()) == 2


def test_history_is_put_back_when_update_fails(model):
    V = model.problem.u.function_space
    sums = fem.Function(V)

    def update():
        sums.x.array[:] += 1.0
        if sums.x.array[0] > 1.5:
            raise ZeroDivisionError("after the change")

    stepper = ff.LoadStepper(
        model.problem,
        lambda t: model.load(t, t),
        end=1.0,
        step=0.5,
        update=update,
        history=[sums],
    )
    with pytest.raises(ZeroDivisionError):
        stepper.run()
    assert np.all(sums.x.array == 1.0)
    assert stepper.time == 0.5
