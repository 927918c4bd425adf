# SPDX-License-Identifier: MIT
"""HDF5 files behind a header with their SHA-256, replaced as a whole and read only if intact.

HDF5 works in memory only: on a full disk it would end the process.
"""

import contextlib
import hashlib
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..base.atomic_file import read_regular, replace_file
from ..base.errors import CheckpointError

#: First words of the file, version of its layout, bytes before the HDF5 part (its "user block").
FORMAT, VERSION, HEADER = "fenicsx_friction checkpoint", 2, 512


@contextlib.contextmanager
def writing(path: Path) -> Iterator[Any]:
    """Yield an empty HDF5 file in memory that replaces the file ``path`` at the end."""
    memory = io.BytesIO()
    with _hdf5(memory, "w", userblock_size=HEADER) as h5:
        yield h5
    with memory.getbuffer() as content:
        replace_file(path, _header_of(content), content[HEADER:])


@contextlib.contextmanager
def reading(path: str | os.PathLike[str]) -> Iterator[Any]:
    """Yield the HDF5 part of a file, after checking that the file is intact."""
    with read_regular(path) as file:
        header = file.read(HEADER)
        _check_format(header)
        file.seek(0)
        content = file.read()
    right = _header_of(memoryview(content))
    if header != right:
        size, expected = (words.split()[4].decode("ascii", "replace") for words in (right, header))
        reason = f"truncated: it has {size} of {expected} bytes" if size != expected else "damaged"
        raise CheckpointError(f"is {reason}; its SHA-256 is not the one in its header.")
    with _hdf5(io.BytesIO(content), "r") as h5:
        yield h5


def _check_format(header: bytes) -> None:
    """Raise unless a file begins as a checkpoint of this format."""
    if not header.startswith(FORMAT.encode()):
        raise CheckpointError("is no checkpoint of fenicsx_friction.")
    if len(header) < HEADER:
        raise CheckpointError(f"is truncated: it has {len(header)} bytes only.")
    words = header.decode("ascii", "replace").split()
    if len(words) < 5:
        raise CheckpointError("is damaged: its header is not whole.")
    if words[2] != str(VERSION):
        raise CheckpointError(
            f"has format {words[2]}, this version of fenicsx_friction reads format {VERSION}."
        )


def _header_of(content: memoryview) -> bytes:
    """Return the right header for the content of a file, whatever header it has."""
    digest = hashlib.sha256(content[HEADER:]).hexdigest()
    text = f"{FORMAT} {VERSION}\nbytes {len(content)}\nsha256 {digest}\n"
    return text.encode().ljust(HEADER, b"\n")


def _hdf5(file: io.BytesIO, mode: str, **options: int) -> Any:
    """Open an HDF5 file in memory."""
    try:
        import h5py
    except ImportError as error:  # pragma: no cover - the image has it
        raise CheckpointError("needs h5py: install python3-h5py, or h5py from conda.") from error
    return h5py.File(file, mode, **options)
