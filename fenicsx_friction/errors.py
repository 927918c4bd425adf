# SPDX-License-Identifier: MIT
"""Errors that say what failed, where, and what to try."""


class ContactInputError(ValueError):
    """A mesh, tag, law or boundary condition that cannot make a contact problem."""


class StepFailed(RuntimeError):
    """No certified solution of the increment was found; the last accepted state was restored.

    Attributes:
        report: The :class:`~fenicsx_friction.report.StepReport` of the failed step.
    """

    def __init__(self, message: str, report: object):
        super().__init__(message)
        self.report = report


class CheckpointError(ValueError):
    """A checkpoint that cannot be written, or cannot be read into this problem."""
