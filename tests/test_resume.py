"""A script that is run again goes on where it was: event log, stops, ends."""

import csv
import os
import resource
import signal
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import fenicsx_friction as ff
from fenicsx_friction.files import step_table
from fenicsx_friction.loading.step_size import StepSize
from models import raous


@pytest.fixture
def folder(tmp_path):
    """A folder that all ranks share."""
    return Path(MPI.COMM_WORLD.bcast(str(tmp_path)))


@pytest.fixture(scope="module")
def model():
    return raous(4, 4, 0.5, "resume_")


@pytest.fixture
def begin(model):
    """Return what makes a stepper of the script, from a checkpoint if there is one."""

    def stepper(folder, **options):
        file, start = folder / "run.h5", 0.0
        model.problem.num_steps, model.problem.accepted = 0, []
        for f in (model.problem.u, model.problem.u_old, model.contact.c, model.contact.path):
            f.x.array[:] = 0.0
        if file.exists():
            start = ff.read_checkpoint(file, model.problem)["time"]
        options = {"end": 3.0, "step": 0.5, "events": folder / "events.csv"} | options
        return ff.LoadStepper(
            model.problem,
            lambda t: model.load(2.0 * np.sin(t) ** 2, 0.5 + 0.1 * t),
            start=start,
            progress=False,
            **options,
        )

    return stepper


def save(problem, folder, record):
    ff.write_checkpoint(folder / "run.h5", problem, {"time": record.time})


@pytest.mark.mpi
@pytest.mark.parametrize("killed", ["after the log", "within a row", "at the end"])
def test_events_of_steps_that_are_made_again_are_in_the_log_once(begin, model, folder, killed):
    (folder / "whole").mkdir(exist_ok=True)
    begin(folder / "whole").run()
    log = folder / "events.csv"
    steps = 0
    for record in begin(folder):
        steps += 1
        save(model.problem, folder, record) if steps < 4 or killed == "at the end" else None
        if steps == 5 and killed != "at the end":
            break
    MPI.COMM_WORLD.barrier()
    if killed == "within a row" and MPI.COMM_WORLD.rank == 0:
        os.truncate(log, log.stat().st_size - 3)
        with log.open("a") as file:
            file.write("\n1")  # of a row of step 12
    MPI.COMM_WORLD.barrier()
    records = begin(folder).run()
    assert len(records) == (0 if killed == "at the end" else 3)
    whole, resumed = ((folder / name / "events.csv").read_text() for name in ("whole", "."))
    assert resumed == whole
    steps_logged = [int(row[0]) for row in csv.reader(whole.splitlines()[1:])]
    assert max(steps_logged) > 4 and min(steps_logged) == 1


@pytest.mark.mpi
def test_another_file_is_not_taken_for_the_log(begin, model, folder):
    stepper = begin(folder)
    save(model.problem, folder, next(iter(stepper)))
    MPI.COMM_WORLD.barrier()
    for content in (b"a,b\n1,2\n", b"step,node,x,from,to\nnone,2\n", b"step,node\n", b"\xff\xfe\n"):
        if MPI.COMM_WORLD.rank == 0:
            (folder / "events.csv").write_bytes(content)
        MPI.COMM_WORLD.barrier()
        with pytest.raises(ff.ContactInputError, match=r"events = '.*events.csv'"):
            begin(folder)
        assert (folder / "events.csv").read_bytes() == content
        MPI.COMM_WORLD.barrier()


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["missing folder", "folder", "pipe", "device"])
def test_a_log_that_cannot_be_written_is_refused_on_all_ranks(begin, folder, kind):
    path = folder / "events"
    if MPI.COMM_WORLD.rank == 0:
        if kind == "folder":
            path.mkdir()
        elif kind == "pipe":
            os.mkfifo(path)
        elif kind == "device":
            path.symlink_to("/dev/full")
    MPI.COMM_WORLD.barrier()
    with pytest.raises(ff.ContactInputError, match=r"events = .*cannot be written"):
        begin(folder, events=path / "log.csv" if kind == "missing folder" else path)


@pytest.mark.mpi
def test_no_room_for_events_is_an_error_on_all_ranks_and_they_are_kept(begin, model, folder):
    """The step stays accepted, the log whole; the events are written once there is room."""
    (folder / "whole").mkdir(exist_ok=True)
    begin(folder / "whole").run()
    stepper, log = begin(folder), folder / "events.csv"
    record = next(iter(stepper))
    MPI.COMM_WORLD.barrier()
    before, limits = log.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    old = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        if MPI.COMM_WORLD.rank == 0:
            resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 10, limits[1]))
        with pytest.raises(ff.ContactInputError, match=r"events = .*cannot be written"):
            list(stepper)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, old)
    MPI.COMM_WORLD.barrier()
    assert log.read_bytes() == before
    assert stepper.time > record.time
    assert model.problem.num_steps > record.report.step
    MPI.COMM_WORLD.barrier()
    stepper.run()
    assert log.read_text() == (folder / "whole" / "events.csv").read_text()


@pytest.mark.mpi
def test_a_run_resumed_after_any_step_ends_as_the_whole_one(begin, model, folder):
    """With stops that are past by then, and at its end."""
    options = {"stops": [0.75, 1.5, 3.0]}
    (folder / "whole").mkdir(exist_ok=True)
    times = [record.time for record in begin(folder / "whole", **options)]
    u = model.problem.u.x.array.copy()
    seen = []
    for _ in range(len(times) + 2):
        for record in begin(folder, **options):
            save(model.problem, folder, record)
            seen.append(record.time)
            break
    assert seen == times
    assert abs(model.problem.u.x.array - u).max() <= 1e-12 * abs(u).max()


def test_a_path_without_length_has_no_steps():
    model = raous(2, 2, 0.5, "no_length_")
    for start, stops in ((1.0, []), (1.0, [0.5, 1.0]), (1.0 + 1e-15, [1.0]), (1.0 - 1e-15, [])):
        stepper = ff.LoadStepper(
            model.problem, pytest.fail, start=start, end=1.0, step=0.1, stops=stops
        )
        assert stepper.run() == []
        assert model.problem.num_steps == 0
    with pytest.raises(ff.ContactInputError, match=r"start = 1\.001 up"):
        ff.LoadStepper(model.problem, pytest.fail, start=1.001, end=1.0, step=0.1)


def sizes(start, end, step, stops=(), error=None):
    """Return the times of a path whose steps all succeed."""
    size, time, times = StepSize(start, end, step, None, None, stops, error, 12), start, []
    while not size.is_over(time):
        time = size.goal(time)
        times.append(time)
    return times


def test_times_that_differ_by_rounding_make_no_steps_of_rounding():
    third = 0.1 + 0.2  # 0.30000000000000004
    assert sizes(0.0, 0.3, 0.1, [third])[-1] == 0.3
    assert len(sizes(0.0, 0.3, 0.1, [third, 0.3])) == 3
    assert len(sizes(third, 1.0, 0.7, [0.3, third])) == 1
    assert len(sizes(0.3, 1.0, 0.7, [third])) == 1
    assert sizes(0.0, third, 1.0, [0.3]) == [third]
    assert len(sizes(0.0, 1.0, 1.0, [0.3, third])) == 2
    assert sizes(0.0, 1e-20, 1e-21)[-1] == 1e-20
    assert len(sizes(0.0, 1e-20, 1.0)) == 1


def test_error_control_resumes_on_a_path_shorter_than_its_step():
    assert sizes(0.99, 1.0, 0.1, error=1e-2) == [1.0]


def test_an_append_is_all_or_nothing(tmp_path, monkeypatch):
    path = tmp_path / "log"
    path.write_bytes(b"whole\n")
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (8, old[1]))
        with pytest.raises(OSError):
            step_table.append(path, b"half of it\n")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert path.read_bytes() == b"whole\n"
    step_table.append(path, b"next\n")
    assert path.read_bytes() == b"whole\nnext\n"
