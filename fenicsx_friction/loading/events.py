# SPDX-License-Identifier: MIT
"""Events: nodes that open, stick or slip where they did not in the step before."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..base.validators import instance
from ..certificate.nodal_state import OPEN, STATE_NAMES, NodalState
from ..files.step_table import StepTable
from ..problem import FrictionalContactProblem


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
    ``contact``, names the surface whose node numbers are meant. A resumed problem, which has made
    steps already, continues the file: it drops rows of later steps, which will be made again.
    Otherwise the file is started anew. The file is complete after every step.

    Args:
        path: The file.
        problem: The problem.

    Raises:
        ContactInputError: On all ranks, if the file cannot be written, or the one to be continued
            is not an event log of such a problem.
    """

    def __init__(self, path: str | os.PathLike[str], problem: FrictionalContactProblem) -> None:
        instance(problem, FrictionalContactProblem, "problem", "a FrictionalContactProblem")
        if not isinstance(path, str):
            instance(path, os.PathLike, "events", "the name of a file")
        columns = ["step", "node", "x", "from", "to"]
        if len(problem.contacts) > 1:
            columns.append("contact")
        self._width = len(columns)
        self._table = StepTable(Path(path), columns, problem.comm, "events")
        self._table.start(problem.num_steps + 1)

    def write(self, events: Sequence[Event]) -> None:
        """Append events; collective.

        Raises:
            ContactInputError: On all ranks, if the file cannot be written. It is as it was, and the
                next call tries again.
        """
        rows: list[list[object]] = [
            [e.step, e.node, " ".join(f"{x:.10g}" for x in e.x), e.before, e.after, e.contact]
            for e in events
        ]
        self._table.write([row[: self._width] for row in rows])
