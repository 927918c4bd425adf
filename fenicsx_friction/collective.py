# SPDX-License-Identifier: MIT
"""Work of one rank whose exceptions are raised on all ranks."""

from collections.abc import Callable
from typing import TypeVar

from mpi4py import MPI

T = TypeVar("T")


def on_all_ranks(comm: MPI.Intracomm, work: Callable[[], T]) -> T:
    """Run ``work``, which is not collective, on each rank; collective.

    Returns:
        This rank's result.

    Raises:
        RuntimeError: If ``work`` raised an exception on other ranks only; on the ranks where it
            did, that exception.
    """
    result, failure = _attempt(work)
    try:
        messages = [m for m in comm.allgather(failure and repr(failure)) if m]
        if failure is not None:
            raise failure
        if messages:
            raise RuntimeError(f"{messages[0]} (on another rank)")
    finally:
        del failure  # in a cycle with its traceback, see Substep.problem
    assert result is not None
    return result[0]


def on_first_rank(comm: MPI.Intracomm, work: Callable[[], T]) -> T | None:
    """Run ``work`` on rank 0; an exception there is raised on all ranks; collective.

    Returns:
        The result on rank 0, ``None`` on the others.
    """
    result, failure = _attempt(work) if comm.rank == 0 else (None, None)
    try:
        failure_there = comm.bcast(failure)
        if failure := failure or failure_there:  # rank 0's own has a traceback
            raise failure
    finally:
        del failure, failure_there
    return result[0] if result else None


def _attempt(work: Callable[[], T]) -> tuple[tuple[T] | None, Exception | None]:
    """Return the result, in a tuple, or the exception."""
    try:
        return (work(),), None
    except Exception as error:
        return None, error
