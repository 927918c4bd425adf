# SPDX-License-Identifier: MIT
"""Where a path is, in a checkpoint: a script that is run again goes on as if it had not ended."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

from dolfinx import fem

from ..base.collective import on_first_rank
from ..base.errors import CheckpointError
from ..base.validators import instance
from ..files.checkpoint import read_checkpoint, write_checkpoint
from ..increment.snapshot import ProblemSnapshot
from ..problem import FrictionalContactProblem
from .energy import EnergyAudit

#: Names of the numbers in the checkpoint.
TIME, NEXT_STEP = "time", "next step"


class PathCheckpoint:
    """The checkpoint of a path: state of problem and audit, time, size of the next step.

    Args:
        path: The file.
        problem: The problem.
        history: Functions of the user that steps change.
        audit: Audits the steps.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        problem: FrictionalContactProblem,
        history: Sequence[fem.Function],
        audit: EnergyAudit | None,
    ) -> None:
        if not isinstance(path, str):
            instance(path, os.PathLike, "checkpoint", "the name of a file")
        self._path, self._problem = Path(path), problem
        self._history, self._audit = list(history), audit

    def read(self, loads: Callable[[float], None], end: float) -> tuple[float, float | None] | None:
        """Fill problem and audit, if there is a file; collective.

        Args:
            loads: Sets the loads of a time on the path.
            end: Where the path ends.

        Returns:
            The time and the size of the next step, if the file holds it; ``None`` without a file.

        Raises:
            CheckpointError: On all ranks, if the file cannot be used; the problem is unchanged.
        """
        comm = self._problem.comm
        if not comm.bcast(on_first_rank(comm, self._path.exists)):
            return None
        before = ProblemSnapshot(self._problem, self._history)
        kept = [] if self._audit is None else self._audit.kept()
        history = [*self._history, *kept]
        scalars = read_checkpoint(self._path, self._problem, history=history)
        if TIME not in scalars:
            before.restore()
            raise CheckpointError(
                f"Checkpoint '{self._path}' holds no number '{TIME}': it is of no path. Give "
                "another name, or remove the file."
            )
        if NEXT_STEP not in scalars:
            warnings.warn(
                f"Checkpoint '{self._path}' does not hold the size of the next step: the path goes "
                "on with that of its first one, and may take other steps than without a stop.",
                stacklevel=3,
            )
        if scalars[TIME] <= end:  # else its loads are those of a later path
            loads(scalars[TIME])
        if self._audit is not None:
            self._audit.resume(kept)
        return scalars[TIME], scalars.get(NEXT_STEP)

    def write(self, time: float, size: float) -> None:
        """Write state, time and size of the next step; collective.

        Raises:
            CheckpointError: On all ranks, if the file cannot be written.
        """
        kept = [] if self._audit is None else self._audit.kept()
        scalars = {TIME: time, NEXT_STEP: size}
        write_checkpoint(self._path, self._problem, scalars, history=[*self._history, *kept])
        self._problem.solvers.begin_anew()
