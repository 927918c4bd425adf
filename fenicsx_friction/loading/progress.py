# SPDX-License-Identifier: MIT
"""A progress bar for the load steps, where there is a terminal and rich is installed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import numpy as np

from .record import StepRecord

if TYPE_CHECKING:
    from rich.console import Console


def find_terminal() -> Console | None:
    """Return the terminal, or ``None`` if the output goes elsewhere or rich is not installed."""
    try:
        from rich.console import Console
    except ImportError:
        return None
    console = Console()
    return console if console.is_terminal else None


@contextmanager
def step_progress(
    console: Console | None, start: float, end: float
) -> Iterator[Callable[[StepRecord], None]]:
    """Show a progress bar inside the context; yield the function that updates it.

    Errors of the terminal are ignored: a closed terminal must not end a run.

    Args:
        console: Where to; ``None`` shows nothing.
        start: Where the path starts.
        end: Where it ends.
    """
    if console is None:
        yield lambda record: None
        return
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn()
    bar = Progress(*columns, TimeElapsedColumn(), console=console)
    task = bar.add_task("first step", total=end - start)

    def show(record: StepRecord) -> None:
        """Tell how the step went."""
        states = np.sum([[k.open, k.stick, k.slip] for k in record.report.contacts], axis=0)
        text = (
            f"step {record.report.step} to {record.time:.4g}: {record.step:.2g} in "
            f"{record.report.iterations} it., open/stick/slip {'/'.join(map(str, states))}"
        )
        with suppress(OSError):
            bar.update(task, completed=record.time - start, description=text)

    with suppress(OSError):
        bar.start()
    try:
        yield show
    finally:
        with suppress(OSError):
            bar.stop()
