# SPDX-License-Identifier: MIT
"""Copies of the unknowns, and of a whole problem with its history, to be restored."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from .system import ContactSystem

Snapshot = list[npt.NDArray[np.floating]]


def save(functions: Sequence[fem.Function]) -> Snapshot:
    """Copy the values (owned and ghost) of the Functions."""
    return [f.x.array.copy() for f in functions]


def restore(functions: Sequence[fem.Function], snapshot: Snapshot) -> None:
    """Put the values back, bit for bit."""
    for f, values in zip(functions, snapshot, strict=True):
        f.x.array[:] = values


class ProblemSnapshot:
    """All that ``solve()`` changes, committed history included.

    These are the unknowns, their rates, ``u_old``, everything a contact owns (multipliers, slip
    path, frames, slip increment), the positions of moving obstacles now and at the last accepted
    step, the pairs of deformable ones, ``dt``, ``accepted`` and ``num_steps``. It leaves out loads
    and boundary values: the user sets them.

    Args:
        problem: The problem.
        history: Further Functions that steps change.
    """

    def __init__(self, problem: ContactSystem, history: Sequence[fem.Function] = ()) -> None:
        # A step replaces some attributes of a contact, such as the slip increment.
        self._contacts = [(k, dict(vars(k))) for k in problem.contacts]
        owned = [value for _, kept in self._contacts for value in kept.values()]
        functions = {
            id(f): f
            for f in [*problem.state, *problem.rates, problem.u_old, *owned, *history]
            if isinstance(f, fem.Function)
        }
        self._functions = list(functions.values())
        motions = [k.obstacle.motion for k in problem.contacts if k.obstacle.motion is not None]
        self._motions = [(motion, motion.save()) for motion in motions]
        self._pairings = [(k.pairing, k.pairing.save()) for k in problem.contacts]
        self._problem, self._values = problem, save(self._functions)
        self._scales = problem.scales.save()
        self._dt = problem.dt.value.copy()
        self._accepted, self._num_steps = list(problem.accepted), problem.num_steps

    def restore(self) -> None:
        """Put everything back, bit for bit; not collective."""
        for contact, kept in self._contacts:
            vars(contact).update(kept)
        restore(self._functions, self._values)
        for motion, position in self._motions:
            motion.restore(position)
        for pairing, saved in self._pairings:
            pairing.restore(saved)
        self._problem.scales.restore(self._scales)
        self._problem.dt.value = self._dt
        self._problem.accepted = list(self._accepted)
        self._problem.num_steps = self._num_steps
