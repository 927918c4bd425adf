# SPDX-License-Identifier: MIT
"""Watch the nodes of a step, to name those that change state again and again."""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain, groupby

import numpy as np
import numpy.typing as npt

from ..certificate.nodal_state import STATE_NAMES
from ..increment.system import ContactSystem
from ..solvers.report import SubstepReport
from ..surfaces.naming import NODES_NAMED, describe

#: Newton iterations that are recorded.
WATCHED_ITERATIONS = 12


class NodeWatch:
    """Records the states of the nodes in each Newton iteration, to name those that cycle.

    It records only the projection rows at ``eps = 0``: only their iterates have states.

    Args:
        problem: The problem to watch.
    """

    def __init__(self, problem: ContactSystem) -> None:
        self._problem = weakref.ref(problem)
        self._states: deque[npt.NDArray[np.int8]] = deque(maxlen=WATCHED_ITERATIONS)
        self._failed: SubstepReport | None = None
        self._failed_states: list[npt.NDArray[np.int8]] = []

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Watch the substeps run inside the context; forget those watched before."""
        problem = self._problem()
        assert problem is not None
        told = problem.monitor

        def tell(report: SubstepReport) -> None:
            self._finish(report)
            if told is not None:
                told(report)

        self._failed, self._failed_states = None, []
        problem.monitor, problem.projection.watch = tell, self._record
        try:
            yield
        finally:
            problem.monitor, problem.projection.watch = told, None

    def lines(self) -> list[str]:
        """Name the nodes that changed state again and again in the failed substep; collective."""
        problem = self._problem()
        if problem is None or self._failed is None:
            return []
        nodes = [(k, i) for k in problem.contacts for i in range(k.surface.num_owned)]
        rows = []
        for (k, i), states in zip(nodes, np.transpose(self._failed_states), strict=True):
            visited = [STATE_NAMES[state] for state, _ in groupby(states)]
            if len(visited) > 2:
                order = (-len(visited), problem.contacts.index(k), int(k.surface.nodes[i]))
                text = f"  {describe(k.surface, i)}: {' -> '.join(visited[-5:])}"
                rows.append((order, f"{text}, {len(visited) - 1} changes"))
        gathered = sorted(chain.from_iterable(problem.comm.allgather(rows)))
        if not gathered:
            return []
        head = (
            f"Cycling nodes: {len(gathered)}, states in the last {len(self._failed_states)} Newton "
            f"iterations ({self._failed.name}, {self._failed.reason}):"
        )
        return [head, *(text for _, text in gathered[:NODES_NAMED])]

    def _record(self, it: int) -> None:
        """Note the states of this rank's nodes: the Functions hold the iterate here; collective."""
        problem = self._problem()
        assert problem is not None
        if it == 0:
            self._states.clear()
        with np.errstate(all="ignore"):
            self._states.append(np.concatenate([s.states() for s in problem.nodal_states()]))

    def _finish(self, report: SubstepReport) -> None:
        """Keep the states of the first substep that cycled, or else of the first that failed."""
        if report.name != "projection" or report.eps > 0.0 or report.converged:
            return
        if self._failed is None or (report.reason == "CYCLE" and self._failed.reason != "CYCLE"):
            self._failed, self._failed_states = report, list(self._states)
