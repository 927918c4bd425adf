"""The load stepper's error control: tolerances, limits, the same steps on all ranks."""

from mpi4py import MPI

import numpy as np
import pytest

from fenicsx_friction import LoadStepper, StepperFailed
from models import block, gathered, raous
from sweeps import fingerprint, follow


@pytest.fixture(scope="module")
def turning():
    """Step counts and final tractions of a partially slipping 3D history by tolerance."""
    results = {}

    def way(t):
        """Turn in a circle under a falling pressure."""
        return 0.004 * np.sin(t), 0.004 * (1.0 - np.cos(t)), -0.01 + 0.002 * t

    for error in (0.1, 1e-2, 1e-3, None):
        model = block("hexahedron", 0.4, f"turning_{error}_", n=(2, 2, 1))
        model.move(*way(0.0))
        model.problem.solve()
        size = 1.5 if error else 0.03
        stepper = LoadStepper(
            model.problem, lambda t, m=model: m.move(*way(t)), end=3.0, step=size, error=error
        )
        records = stepper.run()
        results[error] = records, gathered(model.problem)[1]
    return results


def test_tighter_tolerances_take_more_steps_and_come_nearer(turning):
    _, reference = turning[None]
    counts, errors = [], []
    for error in (0.1, 1e-2, 1e-3):
        records, c = turning[error]
        assert all(0.0 <= record.error <= error for record in records)
        assert records[-1].time == 3.0
        counts.append(len(records))
        errors.append(np.max(np.linalg.norm(c - reference, axis=1)) / np.max(abs(reference)))
    assert counts == sorted(set(counts))
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.01 < 0.05 < errors[0]


def test_error_control_gives_up_when_the_tolerance_cannot_be_met():
    model = block("hexahedron", 0.4, "strict_")
    way = follow([(0, 0, -0.01), (0.02, 0.0, -0.01), (0.02, 0.02, -0.01)])
    model.move(*way(0.0))
    model.problem.solve()
    before = fingerprint(model.problem)
    stepper = LoadStepper(
        model.problem,
        lambda t: model.move(*way(t)),
        end=2.0,
        step=0.5,
        smallest=0.2,
        error=1e-9,
    )
    with pytest.raises(StepperFailed, match="two half steps differ by") as failure:
        stepper.run()
    assert "allow a larger error" in failure.value.message
    assert "contact 'contact': 20 nodes" in failure.value.background
    assert fingerprint(model.problem) == before


@pytest.mark.mpi
def test_ranks_take_the_same_steps_as_one():
    times = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        model = raous(16, 16, 1.0, "ranks_", comm=comm)

        def loads(t, model=model):
            model.load(2.0 * min(t, 1.0 - t), min(1.0, 2.0 * t))

        stepper = LoadStepper(model.problem, loads, end=1.0, step=0.2, error=1e-2)
        times.append([record.time for record in stepper])
    assert times[0] == pytest.approx(times[1], rel=1e-6)
    assert len(set(MPI.COMM_WORLD.allgather(tuple(times[0])))) == 1
