# SPDX-License-Identifier: MIT
"""CSV files with rows of steps, which a resumed run continues without rows twice."""

import csv
import io
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from mpi4py import MPI

from ..base.atomic_file import read_regular, replace_file
from ..base.collective import on_first_rank
from ..base.errors import ContactInputError

Rows = Sequence[Sequence[object]]


class StepTable:
    """A CSV file whose first column is the number of the step; whole after each write.

    Args:
        path: The file.
        columns: Names of the columns.
        comm: The ranks; the first one writes.
        argument: Name of the user's argument, for errors.

    Raises:
        ContactInputError: By all methods, on all ranks, if the file cannot be written, or the one
            to be continued has other columns.
    """

    def __init__(
        self, path: Path, columns: Sequence[str], comm: MPI.Intracomm, argument: str
    ) -> None:
        self.path, self._columns, self._comm = path, list(columns), comm
        self._argument = argument
        self._pending: list[Sequence[object]] = []

    def start(self, first: int) -> None:
        """Keep the rows of steps before the first to come, or start the file anew; collective."""

        def work() -> None:
            rows: list[Sequence[object]] = [self._columns]
            if first > 1 and self.path.exists():
                rows += self._rows_before(first)
            replace_file(self.path, _csv(rows))

        self._on_first_rank(work)

    def write(self, rows: Rows) -> None:
        """Append rows; what cannot be written is kept for the next call; collective."""
        self._pending += rows
        if self._pending:
            self._on_first_rank(lambda: append(self.path, _csv(self._pending)))
            self._pending = []

    def _rows_before(self, first: int) -> list[list[str]]:
        """Return the rows of earlier steps; the last line may be cut off."""
        with read_regular(self.path) as file:
            lines = file.read().decode()
        rows = list(csv.reader(io.StringIO(lines[: lines.rfind("\n") + 1], newline="")))
        if rows and rows[0] != self._columns:
            raise ContactInputError(
                f"{self._argument} = '{self.path}' is no such file of this problem: it begins with "
                f"{rows[0]}, not {self._columns}. Give another name, or remove the file."
            )
        return [row for row in rows[1:] if int(row[0]) < first]

    def _on_first_rank(self, work: Callable[[], None]) -> None:
        """Do work with the file; turn its errors into a ContactInputError."""

        def named() -> None:
            try:
                work()
            except ContactInputError:
                raise
            except (OSError, ValueError, IndexError, csv.Error) as error:
                raise ContactInputError(
                    f"{self._argument} = '{self.path}' cannot be written or continued: {error}. "
                    "Give a name in a folder that exists and has room."
                ) from error

        on_first_rank(self._comm, named)


def _csv(rows: Iterable[Sequence[object]]) -> bytes:
    """Return rows as the bytes of a CSV file."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def append(path: Path, content: bytes) -> None:
    """Append to a file: the whole content or nothing."""
    with path.open("ab", buffering=0) as file:
        size = file.seek(0, os.SEEK_END)
        try:
            while content:
                content = content[file.write(content) :]
        except OSError:
            file.truncate(size)
            raise
