# SPDX-License-Identifier: MIT
"""Events: nodes that open, stick or slip where they did not in the step before."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .certificate import OPEN, NodalState
from .collective import on_first_rank
from .diagnosis import STATE_NAMES
from .problem import FrictionalContactProblem


@dataclass(frozen=True)
class Event:
    """A node whose state an accepted step changed.

    Attributes:
        step: Number of the step.
        contact: Name of the contact surface.
        node: Global number of the node on the contact surface.
        x: Reference coordinates of the node (m).
        before: ``open``, ``stick`` or ``slip`` after the step before, ``open`` before the first.
        after: The state now.
    """

    step: int
    contact: str
    node: int
    x: tuple[float, ...]
    before: str
    after: str


def find_events(problem: FrictionalContactProblem, before: Sequence[NodalState]) -> list[Event]:
    """Return the changes of state in the last accepted step, on all ranks; collective.

    Args:
        problem: The problem.
        before: ``problem.accepted`` of the step before; empty before the first step.

    Returns:
        The events by contact and node.
    """
    local = []
    for index, (k, now) in enumerate(zip(problem.contacts, problem.accepted, strict=True)):
        new = now.states()
        old = before[index].states() if before else np.full_like(new, OPEN)
        d = k.surface.mesh.geometry.dim
        for i in np.flatnonzero(old != new):
            x = tuple(float(value) for value in k.surface.x[i][:d])
            names = STATE_NAMES[old[i]], STATE_NAMES[new[i]]
            event = Event(problem.num_steps, k.surface.name, int(k.surface.nodes[i]), x, *names)
            local.append((index, event.node, event))
    found = [entry for part in problem.comm.allgather(local) for entry in part]
    return [event for *_, event in sorted(found, key=lambda entry: entry[:2])]


class EventLog:
    """Writes events to a CSV file: ``step,node,x,from,to``.

    ``x`` holds the coordinates separated by spaces. With several contacts a sixth column,
    ``contact``, names the surface that counts the nodes. A problem that has made steps already
    continues the file; otherwise it starts anew. The file is complete after every step.

    Args:
        path: The file.
        problem: The problem.
    """

    def __init__(self, path: str | Path, problem: FrictionalContactProblem) -> None:
        self.path, self._comm = Path(path), problem.comm
        self._columns = ["step", "node", "x", "from", "to"]
        if len(problem.contacts) > 1:
            self._columns.append("contact")
        continued = problem.num_steps > 0

        def start() -> None:
            """Write the header unless there is one."""
            if not (continued and self.path.exists() and self.path.stat().st_size > 0):
                with self.path.open("w", newline="") as file:
                    csv.writer(file, lineterminator="\n").writerow(self._columns)

        on_first_rank(self._comm, start)

    def write(self, events: Sequence[Event]) -> None:
        """Append events; collective."""
        rows = [
            [e.step, e.node, " ".join(f"{x:.10g}" for x in e.x), e.before, e.after, e.contact]
            for e in events
        ]

        def append() -> None:
            """Write the rows; closing the file flushes it."""
            with self.path.open("a", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerows(row[: len(self._columns)] for row in rows)

        if rows:
            on_first_rank(self._comm, append)
