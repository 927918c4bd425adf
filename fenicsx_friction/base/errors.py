# SPDX-License-Identifier: MIT
"""Errors that say what failed, where, and what to try."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class ContactInputError(ValueError):
    """A mesh, tag, law or boundary condition that cannot make a contact problem."""


class StepFailed(RuntimeError):
    """No certified solution of the increment was found; the last accepted state was restored.

    It can be pickled with its report, as pools of processes do.

    Attributes:
        report: The :class:`~fenicsx_friction.increment.report.StepReport` of the failed step.
        background: What a report of the failure needs: versions, settings, sizes. It ends the text.
    """

    def __init__(self, message: str, report: object, background: str = "") -> None:
        super().__init__(message)
        self.report, self.background = report, background

    @property
    def message(self) -> str:
        """What went wrong, without the background."""
        return super().__str__()

    def __str__(self) -> str:
        """Return message and background."""
        return f"{self.message}\n{self.background}" if self.background else self.message

    def __reduce__(self) -> tuple[Callable[..., StepFailed], tuple[Any, ...], dict[str, Any]]:
        """Say how to copy it: without the constructor, which differs in derived classes."""
        return _unpickled, (type(self), *self.args), vars(self)


class CheckpointError(ValueError):
    """A checkpoint that cannot be written, or cannot be read into this problem."""


def _unpickled(kind: type[StepFailed], *arguments: object) -> StepFailed:
    """Return an exception without the attributes that its constructor sets."""
    return kind.__new__(kind, *arguments)


class OutOfMemory(RuntimeError):
    """The direct solver has no memory left; smaller steps do not help."""
