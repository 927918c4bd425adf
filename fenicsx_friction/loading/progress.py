# SPDX-License-Identifier: MIT
"""A progress bar for the load steps."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from .record import StepRecord


@contextmanager
def step_progress(
    console: Console, start: float, end: float, *, shown: bool
) -> Iterator[Callable[[StepRecord], None]]:
    """Show a progress bar inside the context; yield the function that updates it.

    Errors of the terminal are ignored: a closed terminal must not end a run.

    Args:
        console: Where to.
        start: Where the path starts.
        end: Where it ends.
        shown: Whether to show anything.
    """
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn()
    bar = Progress(*columns, TimeElapsedColumn(), console=console, disable=not shown)
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
