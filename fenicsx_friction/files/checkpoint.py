# SPDX-License-Identifier: MIT
"""Checkpoints: stop after any step, resume on any number of ranks.

A checkpoint is an HDF5 file of plain numbers behind a header with its SHA-256. It holds unknowns,
contact history and motions, but neither mesh nor forms. A script builds its problem as for a fresh
start and then fills it with :func:`read_checkpoint`. Values are stored in an order that does not
depend on the partition: sorted by the input numbers of the mesh entity to which a dof belongs.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from dolfinx import fem

from ..base.collective import on_first_rank
from ..base.errors import CheckpointError
from ..base.validators import instance, instances
from ..problem import FrictionalContactProblem
from .checkpoint_content import Content
from .checkpoint_file import Stored, checked_scalars, load, store

T = TypeVar("T")


def write_checkpoint(
    path: str | os.PathLike[str],
    problem: FrictionalContactProblem,
    scalars: Mapping[str, float] | None = None,
    *,
    history: Sequence[fem.Function] = (),
) -> None:
    """Write the state of a problem, or leave the old file as it was; collective.

    Args:
        path: The file; a complete one of this name is replaced at once. A killed run may leave
            ``.<name>.<random>.part`` beside it, which the next write removes.
        problem: The problem.
        scalars: Further finite numbers to keep, e.g. ``{"time": t}``; rank 0's are taken.
        history: Functions of the user that steps change.

    Raises:
        CheckpointError: On all ranks, if the file cannot be written, a value is not finite, or an
            element has dofs whose order depends on the partition.
    """
    content = Content(*_checked(problem, history))
    arrays = content.gather()

    def write() -> None:
        """Write on rank 0."""
        stored = Stored(
            num_steps=problem.num_steps,
            dt=float(problem.dt.value),
            scalars=checked_scalars({} if scalars is None else scalars),
            motions=[motion.save() for motion in content.motions],
            arrays=arrays,
        )
        store(path, content, stored)

    on_first_rank(problem.comm, _naming(f"Checkpoint '{path}' was not written:", write))


def read_checkpoint(
    path: str | os.PathLike[str],
    problem: FrictionalContactProblem,
    *,
    history: Sequence[fem.Function] = (),
) -> dict[str, float]:
    """Fill a problem, built by the same script on the same mesh, with a checkpoint; collective.

    Loads, boundary values and anything else that the script sets before a step are not restored.

    Args:
        path: The file.
        problem: The problem; unchanged if the file is refused.
        history: The Functions that were written, in the same order.

    Returns:
        The ``scalars`` that were written.

    Raises:
        CheckpointError: On all ranks, if the file is missing, foreign, truncated or damaged, or
            of another mesh, element or set of contacts.
    """
    content = Content(*_checked(problem, history))
    stored = on_first_rank(
        problem.comm, _naming(f"Checkpoint '{path}'", lambda: load(path, content))
    )
    small = None
    if stored is not None:
        small = stored.num_steps, stored.dt, stored.scalars, stored.motions, [*stored.arrays]
    num_steps, dt, scalars, motions, names = problem.comm.bcast(small)
    content.scatter({name: None if stored is None else stored.arrays[name] for name in names})
    for motion, position in zip(content.motions, motions, strict=True):
        motion.restore(position)
    problem.num_steps, problem.dt.value = num_steps, dt
    for k in problem.contacts:
        k.anchor()
    return dict(scalars)


def _checked(
    problem: FrictionalContactProblem, history: Sequence[fem.Function]
) -> tuple[FrictionalContactProblem, Sequence[fem.Function]]:
    """Return a problem and the user's Functions, or raise a ContactInputError."""
    if not hasattr(problem, "contacts"):
        instance(problem, FrictionalContactProblem, "problem", "a FrictionalContactProblem")
    return problem, instances(history, fem.Function, "history", "fem.Functions")


def _naming(what: str, work: Callable[[], T]) -> Callable[[], T]:
    """Return ``work`` with all its exceptions turned to a CheckpointError that says what failed."""

    def named() -> T:
        try:
            return work()
        except CheckpointError as error:
            raise CheckpointError(f"{what} {error}") from error
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            raise CheckpointError(f"{what.removesuffix(':')}: {reason}") from error

    return named
