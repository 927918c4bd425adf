"""Wrong arguments of the load stepper: errors that name argument, value and cure, on all ranks."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem

import fenicsx_friction as ff
from models import raous

NAN, INF = float("nan"), float("inf")
#: Values that are no numbers, and what the message says of them.
NO_NUMBERS = ["0.1", [0.1], np.array([0.1]), {}, 1j, True]
CASES = [
    *((name, value) for name in ("start", "end", "step") for value in (NAN, INF, None)),
    *((name, v) for name in ("start", "end", "step", "smallest", "largest") for v in NO_NUMBERS),
    *((name, value) for name in ("smallest", "largest", "error") for value in (NAN, INF, 0.0, -1)),
    ("step", 0.0),
    ("step", -0.1),
    ("error", "small"),
    ("error", True),
    *(("easy", value) for value in (NAN, INF, None, -1, 2.5, "12", True)),
    *(("stops", value) for value in (None, 0.5, "0.5", [0.5, NAN], [INF], ["a"], [None], [[0.5]])),
    *(("loads", value) for value in (None, 1.0, "t", [1.0], lambda: None, lambda t, u: None)),
    *(("update", value) for value in (1.0, "t", [1.0], lambda t: None)),
    *(("history", value) for value in (None, 1.0, "u", [1.0], [None], [[1.0]], np.zeros(3))),
    *(("audit", value) for value in (True, "yes", 1.0, ff.EnergyAudit)),
    *(("relaxation", value) for value in (True, "yes", 1.0, ff.ViscousRelaxation)),
    *(("events", value) for value in (1.0, True, "", ["a.csv"], "/proc/no/events.csv", b"a.csv")),
    *(("progress", value) for value in (None, "no", 1)),
    *(("problem", value) for value in (None, "problem", 1.0, ff.FrictionalContactProblem)),
]


@pytest.fixture(scope="module")
def model():
    return raous(2, 2, 0.5, "input_")


@pytest.mark.mpi
@pytest.mark.parametrize(("name", "value"), CASES)
def test_wrong_arguments_are_refused_by_name(model, name, value):
    arguments = {"problem": model.problem, "loads": lambda t: None, "end": 1.0, "step": 0.1}
    settings, steps = model.problem.settings, model.problem.num_steps
    with pytest.raises(ff.ContactInputError) as error:
        ff.LoadStepper(**(arguments | {name: value}))
    message = str(error.value)
    assert (
        message.startswith(f"{name} = ")
        or (name == "stops" and message.startswith("stops["))
        or (name == "history" and message.startswith("history["))
    )
    assert any(word in message for word in ("must be", "give", "Give", "cannot be called as"))
    assert model.problem.settings is settings and model.problem.num_steps == steps


@pytest.mark.mpi
def test_a_wrong_number_on_one_rank_is_one_on_all(model):
    comm = model.problem.comm
    step = NAN if comm.rank == comm.size - 1 else 0.1
    with pytest.raises(ff.ContactInputError, match="step = nan"):
        ff.LoadStepper(model.problem, lambda t: None, end=1.0, step=step)


def test_what_is_a_number_in_other_clothes_is_taken(model, tmp_path):
    """NumPy's numbers, constants' values, arrays of stops, paths, one Function for a list."""
    stepper = ff.LoadStepper(
        model.problem,
        lambda t, scale=1.0: model.load(t, t * scale),
        start=np.float32(0.0),
        end=np.int64(1),
        step=np.array(0.5),
        stops=np.linspace(0.0, 1.0, 5),
        history=model.problem.u_old,
        events=Path(tmp_path) / "events.csv",
        progress=np.bool_(False),
    )
    assert [r.time for r in stepper] == [0.25, 0.5, 0.75, 1.0]


def test_relaxation_of_something_else_is_refused():
    for u in (None, "u", 1.0, [fem.Function]):
        with pytest.raises(ff.ContactInputError, match=r"u = .*the displacement"):
            ff.ViscousRelaxation(u)


@pytest.mark.mpi
def test_an_audit_of_another_problem_is_refused(model):
    other = raous(2, 2, 0.5, "other_")
    audit = ff.EnergyAudit(other.problem, other.stored, other.loads)
    with pytest.raises(ff.ContactInputError, match=r"audit = .* of another problem"):
        ff.LoadStepper(model.problem, lambda t: None, end=1.0, step=0.1, audit=audit)
    assert MPI.COMM_WORLD.allreduce(1) == MPI.COMM_WORLD.size
