"""The load stepper: exact times, hard problems, messages."""

from mpi4py import MPI

import numpy as np
import pytest

import fenicsx_friction as ff
from fenicsx_friction import LoadStepper, StepperFailed
from fenicsx_friction.increment import advance as step
from models import L_PATH, block, raous
from sweeps import follow

# -- times ---------------------------------------------------------------------------------------


@pytest.mark.quick
@pytest.mark.mpi
def test_steps_end_exactly_at_stops_and_end():
    model = raous(4, 4, 0.5, "stops_")
    stops, seen = (1.0 / 3.0, 0.5, 0.7000000000000001), []
    stepper = LoadStepper(
        model.problem,
        lambda t: (seen.append(t), model.load(t, t)),
        end=1.0,
        start=0.1,
        step=0.1,
        stops=stops,
    )
    records = stepper.run()
    times = [record.time for record in records]
    assert set(stops) <= set(times)
    assert times[-1] == 1.0 == stepper.time
    assert times == sorted(times) == seen
    assert np.allclose(np.diff([0.1, *times]), [record.step for record in records])
    assert max(record.step for record in records) <= 0.1 * (1 + 1e-6)
    assert len(times) == 3 + 2 + 2 + 3  # no slivers
    assert [record.report.step for record in records] == list(range(1, len(times) + 1))
    assert all(len(set(MPI.COMM_WORLD.allgather(t))) == 1 for t in times)


def test_tenths_make_ten_steps():
    """Sums of 0.1 miss 1.0 by rounding; no eleventh step of 1e-16 must follow."""
    model = raous(4, 4, 0.5, "tenths_")
    records = LoadStepper(model.problem, lambda t: model.load(t, t), end=1.0, step=0.1).run()
    assert len(records) == 10
    assert float(model.problem.dt.value) == records[-1].step == pytest.approx(0.1)


def test_steps_grow_when_easy_and_not_beyond_the_largest():
    model = raous(4, 4, 0.5, "grow_")
    stepper = LoadStepper(
        model.problem, lambda t: model.load(t, t), end=1.0, step=0.1, largest=0.2, stops=[0.11]
    )
    steps = [record.step for record in stepper]
    assert steps[:3] == pytest.approx([0.1, 0.01, 0.15])  # a stop does not make steps small
    assert max(steps) == pytest.approx(0.2)
    model = raous(4, 4, 0.5, "no_ease_")
    stepper = LoadStepper(
        model.problem, lambda t: model.load(t, t), end=1.0, step=0.25, largest=1.0, easy=0
    )
    assert [record.step for record in stepper] == [0.25] * 4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"end": -1.0}, "path"),
        ({"largest": 0.01}, "smallest <= step"),
        ({"smallest": 0.2}, "smallest <= step"),
        ({"stops": [0.5, 2.0]}, r"\[0.5, 2.0\] must not go beyond the end, 1.0: 2.0 does"),
    ],
)
def test_impossible_paths_are_refused(arguments, message):
    model = raous(2, 2, 0.5, "refused_")
    with pytest.raises(ff.ContactInputError, match=message):
        LoadStepper(model.problem, lambda t: None, **({"end": 1.0, "step": 0.1} | arguments))


# -- hard problems -------------------------------------------------------------------------------


def test_hard_sweep_fails_at_once_and_passes_in_cut_steps():
    """A finite-strain block squeezed by 3/4 of its height while swept by more than it."""
    model = block("hexahedron", 2.0, "hard_", energy="finite", fallbacks=0)
    way = np.array([0.6, 0.0, -0.38])
    stepper = LoadStepper(
        model.problem, lambda t: model.move(*(t * way)), end=1.0, step=1.0, smallest=1e-2
    )
    records = stepper.run()
    assert len(records) > 1
    assert records[0].failed
    assert all(record.report.certified for record in records)
    held = model.problem.constrained_dofs
    values = np.zeros_like(model.problem.u.x.array)
    model.problem.bcs[0].set(values)
    assert model.problem.u.x.array[held] == pytest.approx(values[held], abs=1e-12)


@pytest.mark.mpi
def test_cycling_nodes_are_named_with_their_states(monkeypatch):
    """Full Newton steps alone cycle at mu = 20."""
    for ladder in ("FALLBACKS", "CONDENSED_FALLBACKS"):
        monkeypatch.setattr(step, ladder, ())
    model = raous(16, 16, 20.0, "cycling_")
    stepper = LoadStepper(
        model.problem, lambda t: model.load(3 * t, t / 2), end=1.0, step=1.0, smallest=1.0
    )
    with pytest.raises(StepperFailed, match=r"Cycling nodes: \d+, states in the last") as failure:
        stepper.run()
    lines = str(failure.value).splitlines()
    named = [line for line in lines if "changes" in line]
    assert len(named) == 5
    assert all("of 'contact' at (" in line and " -> " in line for line in named)
    assert len(set(MPI.COMM_WORLD.allgather(str(failure.value)))) == 1


@pytest.mark.quick
def test_failure_is_explained():
    model = raous(4, 4, 1.0, "explained_")
    stepper = LoadStepper(
        model.problem, lambda t: model.load(3 * t, 1 - 2 * t), end=1.0, step=0.5, smallest=0.2
    )
    with pytest.raises(StepperFailed) as failure:
        stepper.run()
    message = str(failure.value)
    assert "No step from time 0.5 was accepted, down to 0.2" in message
    assert "step 0.5: Step 2 has no certified solution" in message
    assert "Dominant residual: " in message
    assert "of 'contact' at (" in message
    assert "Smaller steps did not help" in message
    assert "Try a smaller load step" not in message
    assert isinstance(failure.value.report, ff.StepReport)
    # It is no dead end: other loads go on from the last accepted step.
    stepper = LoadStepper(
        model.problem, lambda t: model.load(1.5 - t, t), start=0.5, end=1.0, step=0.25
    )
    assert [record.report.step for record in stepper] == [2, 3]


def test_a_long_path_returns_to_where_nothing_touches():
    """The L-shaped sweep of the other tests, with interpolated steps."""
    model, way = block("hexahedron", 0.3, "l_path_"), follow([(0, 0, 0), *L_PATH])
    stepper = LoadStepper(
        model.problem, lambda t: model.move(*way(t)), end=float(len(L_PATH)), step=0.5
    )
    records = stepper.run()
    assert len(records) == 2 * len(L_PATH)
    assert records[-1].report.contacts[0].stick == records[-1].report.contacts[0].slip == 0
