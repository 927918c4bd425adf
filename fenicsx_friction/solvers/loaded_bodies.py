# SPDX-License-Identifier: MIT
"""Rigid bodies that carry loads, where the rest of a problem is condensed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem

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
    """

    def __init__(self, bodies: Sequence[RigidBody]) -> None:
        self._bodies: Sequence[RigidBody] = bodies
        self.motions: list[fem.Function] = [body.q for body in bodies]
        self.size = sum(map(num_owned, self.motions))

    def begin(self, rows: Sequence[Array]) -> float:
        """Take given values, and the rows at the present state; return their 2-norm here (N)."""
        owned = [slice(num_owned(f)) for f in self.motions]
        slopes = [b.slopes()[own] for b, own in zip(self._bodies, owned, strict=True)]
        self.origin = [f.x.array.copy() for f in self.motions]
        free = [b.released[own] for b, own in zip(self._bodies, owned, strict=True)]
        loads = [np.where(there, row, 0.0) for there, row in zip(free, rows, strict=True)]
        self.loads, self.slopes = (np.concatenate([*parts, []]) for parts in (loads, slopes))
        for body in self._bodies:
            body.enter()
        self.start = self._now()
        return float(np.linalg.norm(self.loads))

    def rows(self) -> Array:
        """Return the rows now, without contact (N)."""
        return self.loads + self.slopes * (self._now() - self.start)

    def _now(self) -> Array:
        """Return the owned components."""
        return np.concatenate([*(f.x.array[: num_owned(f)] for f in self.motions), []])
