# SPDX-License-Identifier: MIT
"""HDF5 files behind a header with their SHA-256, replaced at once and read only if whole."""

import contextlib
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from .errors import CheckpointError

#: First words of the file, version of its layout, bytes before the HDF5 part (its "user block").
FORMAT, VERSION, HEADER = "fenicsx_friction checkpoint", 1, 512


def verify(file: BinaryIO) -> None:
    """Raise unless the file is a checkpoint of this format, to the last bit."""
    header = file.read(HEADER)
    if not header.startswith(FORMAT.encode()):
        raise CheckpointError("is no checkpoint of fenicsx_friction.")
    if len(header) < HEADER:
        raise CheckpointError(f"is truncated: it has {len(header)} bytes only.")
    words = header.decode("ascii", "replace").split()
    if words[2] != str(VERSION):
        raise CheckpointError(
            f"has format {words[2]}, this version of fenicsx_friction reads format {VERSION}."
        )
    right = header_of(file)
    if header != right:
        size, expected = right.split()[4].decode(), words[4]
        reason = f"truncated: it has {size} of {expected} bytes" if size != expected else "damaged"
        raise CheckpointError(f"is {reason}; its SHA-256 is not the one in its header.")


def header_of(file: BinaryIO) -> bytes:
    """Return the header that belongs to the rest of a file."""
    digest = hashlib.sha256()
    size = file.seek(HEADER)
    while block := file.read(1 << 20):
        digest.update(block)
        size += len(block)
    text = f"{FORMAT} {VERSION}\nbytes {size}\nsha256 {digest.hexdigest()}\n"
    return text.encode().ljust(HEADER, b"\n")


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Open a file that replaces ``path`` once it is complete and on the disk."""
    part = path.with_name(f".{path.name}.part")
    try:
        with open(part, "w+b") as file:
            yield file
            header = header_of(file)
            file.seek(0)
            file.write(header)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    with contextlib.suppress(OSError):  # some file systems cannot, and need not
        os.fsync(folder)
    os.close(folder)


def hdf5_part(file: BinaryIO, mode: str, **options: int) -> Any:
    """Open the HDF5 part of a file."""
    try:
        import h5py
    except ImportError as error:  # pragma: no cover - the image has it
        raise CheckpointError("needs h5py: install python3-h5py, or h5py from conda.") from error
    return h5py.File(file, mode, **options)
