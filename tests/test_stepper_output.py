"""What the load stepper tells: energy audit, event log, display."""

import csv
import io
import sys

from mpi4py import MPI

import numpy as np
import pytest
from rich.console import Console

from fenicsx_friction.loading import stepper as stepper_module
from fenicsx_friction.loading.energy import EnergyAudit
from fenicsx_friction.loading.progress import find_terminal
from fenicsx_friction.loading.stepper import LoadStepper
from models import block, raous
from sweeps import follow, swept


@pytest.mark.quick
@pytest.mark.mpi
def test_audit_sees_each_half_step_once_and_no_trial():
    model, plain = swept("audit_"), swept("plain_")
    stepper = LoadStepper(
        model.problem,
        model.loads,
        end=1.0,
        step=0.5,
        error=0.2,
        audit=EnergyAudit(model.problem, model.stored),
    )
    records = stepper.run()
    audit = EnergyAudit(plain.problem, plain.stored)
    for record in records:
        plain.loads(record.time)
        plain.problem.solve()
        expected = audit.update()
        scale = abs(expected.external_work) + 1e-3 * abs(expected.stored)
        for name in ("external_work", "stored", "dissipation", "defect"):
            value = getattr(record.energy, name)
            assert value == pytest.approx(getattr(expected, name), abs=1e-6 * scale)
    assert sum(record.energy.dissipation for record in records) > 0.0


#: Up, press, slide, a little back, up: times 0 to 4.
SEQUENCE = [(0, 0, 0.01), (0, 0, -0.01), (0.05, 0, -0.01), (0.0495, 0, -0.01), (0.05, 0, 0.01)]


@pytest.mark.quick
@pytest.mark.mpi
def test_event_log_of_stick_slip_stick_and_lift(tmp_path):
    model = block("hexahedron", 0.6, "events_", n=(2, 1, 1))
    path = MPI.COMM_WORLD.bcast(tmp_path) / "events.csv"
    way = follow(SEQUENCE)
    stepper = LoadStepper(
        model.problem, lambda t: model.move(*way(t)), end=4.0, step=1.0, events=path
    )
    handed_out = []
    for record in stepper:
        handed_out += record.events
        MPI.COMM_WORLD.barrier()
        with path.open(newline="") as file:  # complete after each step
            rows = list(csv.reader(file))
        assert rows[0] == ["step", "node", "x", "from", "to"]
        assert len(rows) == 1 + len(handed_out)
        MPI.COMM_WORLD.barrier()
    written = [(int(row[0]), int(row[1]), row[3], row[4]) for row in rows[1:]]
    assert written == [(e.step, e.node, e.before, e.after) for e in handed_out]
    assert written == sorted(written, key=lambda row: row[:2])
    states = ["open", "stick", "slip", "stick", "open"]
    for node in range(6):
        of_node = [row for row in written if row[1] == node]
        assert [row[0] for row in of_node] == [1, 2, 3, 4]
        assert [row[2] for row in of_node] == states[:-1]
        assert [row[3] for row in of_node] == states[1:]
    corners = {tuple(float(x) for x in row[2].split()) for row in rows[1:]}
    assert {tuple(np.round(x, 9)) for x in corners} == {
        (x, y, 0.0) for x in (0.0, 0.6, 1.2) for y in (0.0, 0.9)
    }


def test_a_later_stepper_continues_the_event_log(tmp_path):
    model = block("hexahedron", 0.6, "later_", n=(2, 1, 1))
    path, way = tmp_path / "events.csv", follow(SEQUENCE)
    path.write_text("of an earlier run\n")
    for start in (0.0, 2.0):
        stepper = LoadStepper(
            model.problem,
            lambda t: model.move(*way(t)),
            start=start,
            end=start + 2.0,
            step=1.0,
            events=path,
        )
        stepper.run()
    lines = path.read_text().splitlines()
    assert lines[0] == "step,node,x,from,to"
    assert [line.split(",")[0] for line in lines[1:]] == [
        str(k) for k in (1, 2, 3, 4) for _ in "6nodes"
    ]


@pytest.mark.parametrize("shown", [True, False])
def test_progress_is_shown_only_when_wanted(shown, monkeypatch):
    model, screen = raous(4, 4, 0.5, "display_"), io.StringIO()
    terminal = Console(file=screen, force_terminal=True, width=120)
    monkeypatch.setattr(stepper_module, "find_terminal", lambda: terminal)
    stepper = LoadStepper(
        model.problem, lambda t: model.load(t, t), end=1.0, step=0.5, progress=shown
    )
    stepper.run()
    assert ("step 2 to 1: 0.5 in" in screen.getvalue()) == shown
    assert ("100%" in screen.getvalue()) == shown


def test_progress_is_shown_on_terminals_only_and_only_with_rich(monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")  # counts as a terminal for rich
    assert find_terminal() is not None
    monkeypatch.delenv("FORCE_COLOR")
    with monkeypatch.context() as changed:
        changed.setattr(sys, "stdout", io.StringIO())
        assert find_terminal() is None
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setitem(sys.modules, "rich.console", None)  # as if not installed
    assert find_terminal() is None
    model = raous(4, 4, 0.5, "plain_")
    assert len(LoadStepper(model.problem, lambda t: model.load(t, t), end=1.0, step=0.5).run()) == 2
