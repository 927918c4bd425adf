"""A test that hangs, or fails on one rank only, is named and ends the run."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
PYTEST = [sys.executable, "-m", "pytest", "-o", "faulthandler_timeout=4"]
RANKS = ["mpirun", "-n", "2", *PYTEST, "-p", "no:xdist"]

TESTS = """
import time, pytest

@pytest.mark.parametrize("k", [7])
def test_hangs(k, comm):
    if comm.rank == comm.size - 1:
        time.sleep(10_000)

@pytest.mark.parametrize("k", [7])
def test_fails(k, comm):
    assert comm.rank == 0, "not the first rank"
    comm.Barrier()
"""


@pytest.fixture
def folder(tmp_path):
    """Two tests under this project's settings, but with little patience."""
    settings = (HERE / "conftest.py").read_text()
    assert settings.count("PATIENCE = 60.0") == 1
    (tmp_path / "conftest.py").write_text(settings.replace("PATIENCE = 60.0", "PATIENCE = 1.0"))
    shutil.copy(HERE.parent / "pyproject.toml", tmp_path)
    (tmp_path / "test_it.py").write_text(TESTS)
    return tmp_path


def output_of_failing(command, folder):
    done = subprocess.run([*command, "test_it.py"], cwd=folder, capture_output=True, text=True)
    assert done.returncode not in (0, 5), done.stdout + done.stderr
    return done.stdout + done.stderr


def test_hanging_test_is_named_by_its_worker(folder):
    output = output_of_failing([*PYTEST, "-n", "2", "-k", "hangs"], folder)
    assert "crashed while running 'test_it.py::test_hangs[7]'" in output


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
def test_hanging_rank_ends_all(folder):
    output = output_of_failing([*RANKS, "-k", "hangs"], folder)
    assert "test_it.py::test_hangs[7]: rank 0 waits for other ranks" in output
    assert "in test_hangs" in output  # where the last rank is


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
def test_failure_on_one_rank_ends_all(folder):
    output = output_of_failing([*RANKS, "-k", "fails"], folder)
    assert "test_it.py::test_fails[7]: rank 1 waits for other ranks" in output
    assert "not the first rank" in output
    assert "Timeout" not in output
