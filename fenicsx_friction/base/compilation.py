# SPDX-License-Identifier: MIT
"""Compilation of forms that survives a compilation killed in the middle.

While FFCx compiles a form, its ``.c`` file in the cache marks the form as busy. The file of a
killed process stays, and all others wait for the form in vain. Therefore this package keeps its
forms in a folder of their own. A process that compiles there holds a shared lock (``flock``), which
ends with the process, however it ends. A process that gets the lock alone knows that nobody
compiles: incomplete files are then left over, and it removes them. A process that waits for a
living one waits longer.
"""

import fcntl
import functools
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

from mpi4py import MPI

from dolfinx import jit
from dolfinx.fem import petsc

#: Seconds to wait for another process that compiles.
PATIENCE = 900.0
#: The same where the file system has no locks, and the other process may be dead.
PATIENCE_WITHOUT_LOCKS = 60.0
#: Seconds for which the lock is tried before the next attempt.
PAUSE = 2.0


class NonlinearProblem(petsc.NonlinearProblem):
    """DOLFINx's class. In 0.11 its destructor fails if its constructor did; defaults cure that."""

    _snes = _A = _b = _x = _P_mat = None


def compiled(function: Callable[..., Any], comm: MPI.Intracomm) -> Callable[..., Any]:
    """Return ``function`` protected against killed compilations; collective when called.

    Args:
        function: ``fem.form``, ``fem.Expression``, ``NonlinearProblem``: takes ``jit_options``.
        comm: The ranks that compile together.

    Returns:
        The same function. It raises ``TimeoutError``, on all ranks, when another process does not
        finish a form in a quarter of an hour, or in a minute where the file system has no locks.
    """

    def call(*args: Any, jit_options: dict[str, Any] | None = None, **kwargs: Any) -> Any:
        """Call ``function``, again where it has waited for a killed compilation."""
        folder = Path(jit.get_options(jit_options)["cache_dir"]) / "fenicsx_friction"
        options = {**(jit_options or {}), "cache_dir": folder}
        if comm.rank == 0:
            _remove_leftovers_once(folder)
        start, locks = time.monotonic(), True
        while True:
            try:
                with _locked(folder, fcntl.LOCK_SH) as locks:
                    return function(*args, jit_options=options, **kwargs)
            except (TimeoutError, RuntimeError) as error:
                if not _waited_in_vain(comm, error):
                    raise
                message = str(error)
            except BaseException:  # Ctrl-C, for example
                remove_leftovers(folder)
                raise
            waited = time.monotonic() - start
            if comm.bcast(waited > (PATIENCE if locks else PATIENCE_WITHOUT_LOCKS)):
                raise TimeoutError(
                    f"{folder}: another process has been compiling a form for {waited:.0f} s, or "
                    f"was killed. If no other program runs that uses this folder, remove it. "
                    f"FFCx says: {message}"
                )
            _remove_leftovers_within(folder, PAUSE)
            comm.Barrier()  # no rank compiles again while another one removes

    return call


def remove_leftovers(folder: Path) -> bool:
    """Remove what killed compilations left in ``folder``, unless somebody compiles there.

    Returns:
        Whether it was done.
    """
    with _locked(folder, fcntl.LOCK_EX | fcntl.LOCK_NB) as alone:
        if alone:
            for path in _dead_files(folder):
                path.unlink(missing_ok=True)
    return alone


_remove_leftovers_once = functools.cache(remove_leftovers)


def _remove_leftovers_within(folder: Path, seconds: float) -> None:
    """Ask for the lock again and again, for some time."""
    end = time.monotonic() + seconds
    while not remove_leftovers(folder) and time.monotonic() < end:
        time.sleep(0.02)


@contextmanager
def _locked(folder: Path, kind: int) -> Iterator[bool]:
    """Hold the lock of ``folder`` inside the context, and tell whether it could be had."""
    with ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            fcntl.flock(stack.enter_context((folder / "lock").open("a")), kind)
            held = True
        except OSError:  # another holds it; or there are no locks, or the folder is read-only
            held = False
        yield held


def _dead_files(folder: Path) -> list[Path]:
    """Return the files of incomplete entries; nobody must be compiling."""
    entries = defaultdict(set)
    for name in os.listdir(folder):
        stem, _, suffix = name.partition(".")
        entries[stem].add(f".{suffix}")
    libraries = set(EXTENSION_SUFFIXES)
    return [
        folder / (stem + suffix)
        for stem, found in entries.items()
        for suffix in found
        if found & {".c", ".c.cached"} and not ({".c", ".c.cached"} <= found and found & libraries)
    ]


def _waited_in_vain(comm: MPI.Intracomm, error: Exception) -> bool:
    """Tell whether FFCx waited for files that did not come; the same on all ranks.

    DOLFINx compiles on rank 0, loads on the others, and raises errors of these two on all ranks.
    """
    if comm.size == 1:
        return isinstance(error, TimeoutError)
    message = str(error)
    if not message.startswith(("Failed JIT compilation", "JIT ")):
        return False  # may have been raised by this rank alone
    return bool(comm.bcast("timed out" in message or "cache load failed" in message))
