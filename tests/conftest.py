# SPDX-License-Identifier: MIT
"""Settings for all tests: collective clean-up, one report for all MPI ranks."""

import faulthandler
import gc
import os
import sys
import time
from collections.abc import Generator, Iterator
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import hypothesis
import numpy as np
import pytest

# Examples must be the same on every rank; compiling a form takes longer than any deadline.
hypothesis.settings.register_profile("project", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("project")

#: Seconds at the end of a test after which a rank tells that it waits for the others, and, if it
#: failed (they may wait for it inside the test), ends them all. A hang is ended by pytest's
#: ``faulthandler_timeout``.
PATIENCE = 60.0

# Ranks that a test starts share the cores with other tests: who waits lets them work.
if MPI.COMM_WORLD.size == 1:
    os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")

FAILURE = pytest.StashKey[str]()

# Apart from COMM_WORLD, so that waiting never matches a collective call inside a test.
_meeting = MPI.COMM_WORLD.Dup()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add an option of these tests."""
    text = (
        "run at most so many variations of a test, evenly chosen, the first and the last with them"
    )
    parser.addoption("--variations", type=int, help=text)


@pytest.hookimpl(trylast=True)  # after the marks have chosen
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is for one rank, on several, and variations, if asked to."""
    if MPI.COMM_WORLD.size > 1:
        alone = [item for item in items if item.get_closest_marker("serial")]
        config.hook.pytest_deselected(items=alone)
        items[:] = [item for item in items if item not in alone]
    most = config.getoption("variations")
    if not most:
        return
    variations: dict[str, list[pytest.Item]] = {}
    for item in items:
        variations.setdefault(item.nodeid.split("[")[0], []).append(item)
    chosen = {
        item
        for found in variations.values()
        for item in (found[i] for i in np.linspace(0, len(found) - 1, most).round().astype(int))
    }
    config.hook.pytest_deselected(items=[item for item in items if item not in chosen])
    items[:] = [item for item in items if item in chosen]


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


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """End a process, too, that hangs when MPI is finalised."""
    limit = float(config.getini("faulthandler_timeout"))
    faulthandler.dump_traceback_later(limit, file=sys.__stderr__, exit=True)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Name failures of the other ranks in one line each."""
    if report.failed and MPI.COMM_WORLD.rank > 0:
        crash = getattr(report.longrepr, "reprcrash", report.longrepr)
        print(f"\nrank {MPI.COMM_WORLD.rank}: {report.nodeid}: {crash}", file=sys.__stderr__)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, Any]:
    """Keep the text of a failure."""
    report = yield
    if report.failed:
        item.stash[FAILURE] = report.longreprtext
    return report


@pytest.fixture(autouse=True)
def collect_garbage(request: pytest.FixtureRequest) -> Iterator[None]:
    """Run collective destructors on all ranks together, after every test.

    A test that failed on one rank only leaves the others waiting for it inside the test:
    the rank that failed ends the run then. What has survived a collection is left out of the next
    ones: modules and UFL's caches are large, and would be searched again after every test.
    """
    yield
    _wait_for_all_ranks(request.node, request.config.pluginmanager.get_plugin("capturemanager"))
    gc.collect()
    gc.freeze()
    PETSc.garbage_cleanup(MPI.COMM_WORLD)


def _wait_for_all_ranks(test: pytest.Item, capture: Any) -> None:
    """Wait until all ranks are here, however slow they are."""
    together, start, told = _meeting.Ibarrier(), time.monotonic(), False
    while not together.Test():
        if not told and time.monotonic() - start > PATIENCE:
            told, failure = True, test.stash.get(FAILURE, None)
            with capture.global_and_fixture_disabled():
                print(
                    f"\n{test.nodeid}: rank {MPI.COMM_WORLD.rank} waits for other ranks.",
                    f"It failed: {failure}" if failure else "",
                    file=sys.__stderr__,
                    flush=True,
                )
            if failure:
                MPI.COMM_WORLD.Abort(1)
        time.sleep(1e-3)
