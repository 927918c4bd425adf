# SPDX-License-Identifier: MIT
"""Keeps what callbacks raise: PETSc passes on only a number."""

from collections.abc import Iterator
from contextlib import contextmanager


class ErrorKeeper:
    """Keeps the last exception of a group of callbacks.

    Attributes:
        error: The exception, if any.
    """

    def __init__(self) -> None:
        self.error: BaseException | None = None

    @contextmanager
    def __call__(self) -> Iterator[None]:
        """Keep an exception raised inside, and raise it."""
        try:
            yield
        except BaseException as error:
            self.error = error
            raise
