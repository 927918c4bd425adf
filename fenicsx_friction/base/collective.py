# SPDX-License-Identifier: MIT
"""Work of one rank whose exceptions are raised on all ranks."""

import pickle
from collections.abc import Callable
from typing import TypeVar

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

T = TypeVar("T")


def on_all_ranks(comm: MPI.Intracomm, work: Callable[[], T]) -> T:
    """Run ``work`` on each rank; collective.

    If it raises on some ranks, all ranks raise the exception of the first of them, so that an
    ``except`` does the same on all ranks. This holds for Ctrl-C inside ``work``, too. If ``work``
    is collective itself, it must raise before its first collective call, or on all ranks.

    Returns:
        This rank's result.

    Raises:
        BaseException: What ``work`` raised on the first rank where it did; a RuntimeError that
            quotes it, if it cannot be sent to other ranks.
    """
    result, failure = _attempt(work)
    try:
        if comm.size > 1:
            failure = _first(comm, failure)
        if failure is not None:
            raise failure
    finally:
        del failure  # it forms a reference cycle with its traceback
    assert result is not None
    return result[0]


def on_first_rank(comm: MPI.Intracomm, work: Callable[[], T]) -> T | None:
    """Run ``work`` on rank 0; an exception there is raised on all ranks; collective.

    Returns:
        The result on rank 0, ``None`` on the others.
    """
    return on_all_ranks(comm, work if comm.rank == 0 else lambda: None)


def _first(comm: MPI.Intracomm, failure: BaseException | None) -> BaseException | None:
    """Return the exception of the first rank that has one; a rank's own with its traceback."""
    sent = comm.allgather(None if failure is None else _sendable(failure))
    rank = next((rank for rank, content in enumerate(sent) if content is not None), None)
    if rank is None:
        return None
    content, is_itself = sent[rank]
    if rank == comm.rank and is_itself:
        return failure
    first: BaseException = pickle.loads(content)
    first.__cause__ = failure if rank == comm.rank else RuntimeError(f"Raised on rank {rank}.")
    return first


def _sendable(failure: BaseException) -> tuple[bytes, bool]:
    """Return a pickled exception, and False if it is a RuntimeError that quotes the original."""
    try:
        content = pickle.dumps(failure)
        if type(pickle.loads(content)) is type(failure):
            return content, True
    except Exception:
        pass  # it holds an object that cannot be pickled
    return pickle.dumps(RuntimeError(repr(failure))), False


def _attempt(work: Callable[[], T]) -> tuple[tuple[T] | None, BaseException | None]:
    """Return the result, in a tuple, or the exception."""
    try:
        return (work(),), None
    except BaseException as error:
        return None, error


def any_rank(comm: MPI.Intracomm, flag: bool) -> bool:
    """Tell whether a flag is set on any rank; collective."""
    return bool(comm.allreduce(flag, MPI.LOR))


def gather_rows(comm: MPI.Intracomm, rows: npt.NDArray, counts: npt.NDArray) -> npt.NDArray:
    """Return the rows of all ranks, in the order of the ranks; collective.

    Args:
        comm: The ranks.
        rows: The rows of this rank, of one type and shape on all ranks.
        counts: Number of rows of each rank.
    """
    shape = rows.shape[1:]
    found = np.empty((int(np.sum(counts)), *shape), dtype=rows.dtype)
    sizes = [int(count) * int(np.prod(shape)) for count in counts]
    comm.Allgatherv(np.ascontiguousarray(rows), (found, sizes))
    return found


def largest_of_ranks(comm: MPI.Intracomm, values: npt.NDArray) -> npt.NDArray:
    """Return the largest values of all ranks; what is not a number is infinite; collective."""
    values = np.nan_to_num(values, nan=np.inf, posinf=np.inf)
    comm.Allreduce(MPI.IN_PLACE, values, op=MPI.MAX)
    return values
