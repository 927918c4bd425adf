# SPDX-License-Identifier: MIT
"""Rigid bodies that carry loads, where the rest of a problem is condensed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..equations.numbering import num_owned
from ..obstacles.rigid_body import RigidBody

Array = npt.NDArray[np.floating]


class LoadedBodies:
    """The motions of rigid bodies among the unknowns of the boundary; collective.

    Their rows without contact are ``loads + slopes (q - start)``: springs, loads and given values.

    Args:
        bodies: The bodies.

    Attributes:
        motions: The unknowns, one Function a body.
        size: How many components this rank owns.
        loads, slopes, start: Of the owned components; loads (N) and start are those of the last
            :meth:`begin`.
        origin: The motions when that began.
    """

    def __init__(self, bodies: Sequence[RigidBody]) -> None:
        self._bodies, self.motions = bodies, [body.q for body in bodies]
        self.size = sum(map(num_owned, self.motions))

    def begin(self, rows: Sequence[Array]) -> float:
        """Take given values, and the rows at the present state; return their 2-norm here (N)."""
        self.origin = [f.x.array.copy() for f in self.motions]
        loads: list[Array] = [np.empty(0)]
        slopes: list[Array] = [np.empty(0)]
        for body, row in zip(self._bodies, rows, strict=True):
            loads.append(np.where(body.released[: len(row)], row, 0.0))
            slopes.append(body.slopes()[: len(row)])
            body.enter()
        self.loads, self.slopes = np.concatenate(loads), np.concatenate(slopes)
        self.start = self._now()
        return float(np.linalg.norm(self.loads))

    def rows(self) -> Array:
        """Return the rows now, without contact (N)."""
        return self.loads + self.slopes * (self._now() - self.start)

    def _now(self) -> Array:
        """Return the owned components."""
        return np.concatenate([*(f.x.array[: num_owned(f)] for f in self.motions), []])
