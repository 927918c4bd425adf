"""The short demos of the tutorials run as scripts, and their results are right."""

import re

import numpy as np
import pytest

import fenicsx_friction as ff
from demo_runs import DEMOS, rows, run


def numbers_of(text):
    return [float(found) for found in re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?", text)]


def test_a_ball_under_a_force_is_hertz(tmp_path):
    done = run(DEMOS / "demo_indenter.py", "--cells", 8, "--output", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    table = rows(tmp_path / "bodies.csv")
    assert [float(row["force_y"]) for row in table] == pytest.approx([50, 100, 200, 400], rel=1e-9)
    modulus = 200e9 / (1.0 - 0.3**2)
    for row in table:
        force, depth = float(row["force_y"]), -float(row["translation_y"])
        assert 4.0 / 3.0 * modulus * np.sqrt(10e-3) * depth**1.5 == pytest.approx(force, rel=0.02)
    pressure = ff.plot.fields(tmp_path, "surface", -1)["pressure"]
    a = np.cbrt(0.75 * 400.0 * 10e-3 / modulus)
    assert np.max(pressure) == pytest.approx(1.5 * 400.0 / (np.pi * a**2), rel=0.02)
    assert (tmp_path / "indenter.png").stat().st_size > 10_000


def test_two_bodies_from_gmsh_are_hertz_and_mindlin(tmp_path):
    size = 0.2e-3
    done = run(DEMOS / "demo_two_bodies.py", "--size", size, "--output", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    *_, last = rows(tmp_path / "contacts.csv")
    P, Q = float(last["force_y"]), abs(float(last["force_x"]))
    a = np.sqrt(4.0 * P * 50e-3 / (np.pi * 10e6 / 2.0 / (1.0 - 0.3**2)))
    grid = ff.plot.fields(tmp_path, "cylinder/side", -1)
    x, pressure, state = grid.points[:, 0], grid["pressure"], np.rint(grid["state"])
    assert np.max(pressure) == pytest.approx(2.0 * P / (np.pi * a), rel=0.02)
    assert np.max(abs(x[state != ff.OPEN])) == pytest.approx(a, abs=size)
    c = a * np.sqrt(1.0 - Q / (0.4 * P))
    assert 0.6 < c / a < 0.9  # neither all sticks nor all slips
    assert np.ptp(x[state == ff.STICK]) / 2.0 == pytest.approx(c, abs=size)
    assert all((tmp_path / f"{k}.png").stat().st_size > 10_000 for k in ("tractions", "bodies"))


def test_a_long_history_goes_on_after_an_interrupt(tmp_path):
    """A cycle beyond it as without; a settled loop has the area of the work of friction."""
    script, whole, parts = DEMOS / "demo_long_history.py", tmp_path / "whole", tmp_path / "parts"
    for folder, until in ((whole, 2.3), (parts, 1.3), (parts, 9)):
        done = run(script, "--until", until, "--output", folder)
        assert done.returncode == 0, done.stdout + done.stderr
    one, other = (ff.plot.table(folder) for folder in (whole, parts))
    assert "From time 1.3" in done.stdout
    steps = len(one["time"])
    assert 2.3 <= one["time"][-1] < 2.4
    for column in ("time", "force_x", "frictional_work", "stored"):
        assert other[column][:steps] == pytest.approx(one[column], rel=1e-9, abs=1e-9)
    told = [numbers_of(line)[1:] for line in done.stdout.splitlines() if "Cycle" in line]
    assert told[1] == pytest.approx(told[2], rel=1e-6)  # settled
    assert told[2][0] == pytest.approx(told[2][1], rel=0.01)
    assert told[0][0] > told[0][1]  # the first cycle begins without shear and stores some
    work, stored, friction, defect = (
        np.sum(other[k]) for k in ("external_work", "stored", "dissipation", "defect")
    )
    assert work == pytest.approx(stored + friction + defect, rel=1e-12)
    assert abs(defect) < 0.01 * work
    assert (parts / "events.csv").read_text().startswith((whole / "events.csv").read_text())
    assert (parts / "history.png").stat().st_size > 10_000


def test_a_large_model_costs_as_its_mesh(tmp_path):
    """Hertz's force, but that the block is small and held; iterations hardly grow."""
    done = run(DEMOS / "demo_large_model.py", "--cells", 10, 16, "--output", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    coarse, fine = (numbers_of(line) for line in done.stdout.splitlines())
    displacements, force, shear, stick, slip, newton, krylov = fine[1:8]
    assert displacements == 3 * 17**3
    assert 1.0 < force < 1.1
    assert 0.0 < shear < 0.3 and min(stick, slip) > 0
    assert newton < krylov < 1.5 * coarse[7]
    assert all((tmp_path / f"{k}.png").stat().st_size > 10_000 for k in ("cost", "surface"))
