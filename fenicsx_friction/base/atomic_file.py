# SPDX-License-Identifier: MIT
"""Files that are replaced as a whole: safe with several writers, and when a writer is killed."""

import contextlib
import fcntl
import os
import re
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

#: What a path may lead to in place of a file.
KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


class NoRegularFile(OSError):
    """A path that leads to something else than a file."""


def read_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a file for reading; raises at once if the path is a pipe, instead of waiting."""
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        _check(os.fstat(number), path)
    except BaseException:
        os.close(number)
        raise
    return os.fdopen(number, "rb")


def replace_file(path: Path, *pieces: bytes | memoryview) -> None:
    """Replace a file by one of the given content, or leave it as it was.

    The content is first written to ``.<name>.<random>.part`` in the same folder, and to the disk.
    Then this part takes the name of the file. Parts that killed processes left are removed.

    Raises:
        OSError: If it cannot be written, or the path leads to something else than a file.
    """
    with contextlib.suppress(FileNotFoundError):
        _check(os.stat(path), path)
    _remove_parts(path)  # first, because they may fill the disk
    with _new_part(path) as (part, file):
        for piece in pieces:
            file.write(piece)
        file.flush()
        os.fsync(file.fileno())
        os.replace(part, path)
    folder = os.open(path.parent, os.O_RDONLY | os.O_CLOEXEC)
    with contextlib.suppress(OSError):  # some file systems do not support it, nor need it
        os.fsync(folder)
    os.close(folder)


def _check(status: os.stat_result, path: str | os.PathLike[str]) -> None:
    """Raise unless a path leads to a file."""
    if not stat.S_ISREG(status.st_mode):
        kind = KINDS.get(stat.S_IFMT(status.st_mode), "something else")
        raise NoRegularFile(f"'{path}' is {kind}, no file; give the name of a file")


@contextlib.contextmanager
def _new_part(path: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """Make a file that nobody else writes, and remove it on any failure.

    Its lock tells other processes that its writer lives. Before the lock is set, another process
    may remove the file as left over; then another file is made.
    """
    while True:
        part = path.with_name(f".{path.name}.{secrets.token_hex(8)}.part")
        # Exclusive: it follows no link. The mode is that of any new file.
        number = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            with os.fdopen(number, "w+b") as file:
                if _lock(number) and os.fstat(number).st_nlink > 0:
                    yield part, file
                    return
        except BaseException:
            part.unlink(missing_ok=True)
            raise


def _remove_parts(path: Path) -> None:
    """Remove the parts of a file whose writers are dead."""
    pattern = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{16}}\.part")
    with contextlib.suppress(OSError), os.scandir(path.parent) as entries:
        for part in [entry.path for entry in entries if pattern.fullmatch(entry.name)]:
            with contextlib.suppress(OSError):
                number = os.open(part, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
                with os.fdopen(number, "rb"):
                    if _lock(number, known=True):
                        os.unlink(part)


def _lock(number: int, *, known: bool = False) -> bool:
    """Lock an open file; tell whether nobody else held the lock.

    Where a file system has no locks the answer is yes, or no if it must be ``known``.
    """
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return not known
    return True
