# SPDX-License-Identifier: MIT
"""Events: nodes that open, stick or slip where they did not in the step before."""

import csv
import io
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..base.atomic_file import read_regular, replace_file
from ..base.collective import on_first_rank
from ..base.errors import ContactInputError
from ..base.validators import instance
from ..certificate.nodal_state import OPEN, STATE_NAMES, NodalState
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
        self.path, self._comm = Path(path), problem.comm
        self._columns = ["step", "node", "x", "from", "to"]
        if len(problem.contacts) > 1:
            self._columns.append("contact")
        self._pending: list[list[object]] = []

        def start() -> None:
            """Write the header, and below it the rows of the steps that were made."""
            rows: list[list[object]] = [[*self._columns]]
            if problem.num_steps > 0 and self.path.exists():
                rows += self._rows_until(problem.num_steps)
            replace_file(self.path, _csv(rows))

        self._on_first_rank(start)

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
        self._pending += [row[: len(self._columns)] for row in rows]
        if self._pending:
            self._on_first_rank(lambda: _append(self.path, _csv(self._pending)))
            self._pending = []

    def _rows_until(self, step: int) -> list[list[object]]:
        """Return the rows of the steps up to one; the last line may be cut off."""
        with read_regular(self.path) as file:
            lines = file.read().decode()
        rows = list(csv.reader(io.StringIO(lines[: lines.rfind("\n") + 1], newline="")))
        if rows and rows[0] != self._columns:
            raise ContactInputError(
                f"events = '{self.path}' is no event log of this problem: it begins with {rows[0]},"
                f" not {self._columns}. Give another name, or remove the file."
            )
        return [[*row] for row in rows[1:] if int(row[0]) <= step]

    def _on_first_rank(self, work: Callable[[], None]) -> None:
        """Do work with the file; turn its errors into a ContactInputError."""

        def named() -> None:
            try:
                work()
            except ContactInputError:
                raise
            except (OSError, ValueError, IndexError, csv.Error) as error:
                raise ContactInputError(
                    f"events = '{self.path}' cannot be written or continued: {error}. Give the "
                    "name of a file in a folder that exists and has room."
                ) from error

        on_first_rank(self._comm, named)


def _csv(rows: Iterable[Sequence[object]]) -> bytes:
    """Return rows as the bytes of a CSV file."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def _append(path: Path, content: bytes) -> None:
    """Append to a file: the whole content or nothing."""
    with path.open("ab", buffering=0) as file:
        size = file.seek(0, os.SEEK_END)
        try:
            while content:
                content = content[file.write(content) :]
        except OSError:
            file.truncate(size)
            raise
