# SPDX-License-Identifier: MIT
"""Settings for all tests: collective clean-up, one report for all MPI ranks."""

import gc
import sys
import time
from collections.abc import Iterator

from mpi4py import MPI
from petsc4py import PETSc

import hypothesis
import pytest

# Examples must be the same on every rank; compiling a form takes longer than any deadline.
hypothesis.settings.register_profile("project", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("project")

#: Seconds that a rank waits for the others at the end of a test before it ends them all.
PATIENCE = 120.0

# Apart from COMM_WORLD, so that waiting never matches a collective call inside a test.
_meeting = MPI.COMM_WORLD.Dup()


@pytest.fixture
def comm() -> MPI.Intracomm:
    """The communicator of all ranks."""
    return MPI.COMM_WORLD


@pytest.hookimpl(trylast=True)  # after the terminal reporter is there
def pytest_configure(config: pytest.Config) -> None:
    """Let only rank 0 report on the terminal, and no rank collect garbage when it likes.

    Tracebacks that tests hold keep PETSc objects in reference cycles, whose destruction is
    collective. (The package's own objects are in no cycle, see test_lifetime.py.)
    """
    if MPI.COMM_WORLD.size > 1:
        gc.disable()
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if MPI.COMM_WORLD.rank > 0 and reporter is not None:
        config.pluginmanager.unregister(reporter)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Name failures of the other ranks in one line each."""
    if report.failed and MPI.COMM_WORLD.rank > 0:
        crash = getattr(report.longrepr, "reprcrash", report.longrepr)
        print(f"\nrank {MPI.COMM_WORLD.rank}: {report.nodeid}: {crash}", file=sys.__stderr__)


@pytest.fixture(autouse=True)
def collect_garbage(request: pytest.FixtureRequest) -> Iterator[None]:
    """Run collective destructors on all ranks together, after every test.

    A test that failed on one rank only leaves the others waiting for it inside the test:
    the rank that failed ends the run then.
    """
    capture = request.config.pluginmanager.get_plugin("capturemanager")
    yield
    together = _meeting.Ibarrier()
    start = time.monotonic()
    while not together.Test():
        if time.monotonic() - start > PATIENCE:
            with capture.global_and_fixture_disabled():
                print(f"\n{request.node.nodeid}: another rank hangs", file=sys.stderr, flush=True)
            MPI.COMM_WORLD.Abort(1)
        time.sleep(1e-3)
    gc.collect()
    PETSc.garbage_cleanup(MPI.COMM_WORLD)
