# SPDX-License-Identifier: MIT
"""The nodal values of one contact, and how far they violate the law."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]
OPEN, STICK, SLIP = 0, 1, 2
STATE_NAMES = ("open", "stick", "slip")
#: Limits (Pa) from here on mean permanent stick.
UNLIMITED = 1e299


@dataclass(frozen=True)
class NodalState:
    """Nodal values of one contact on this rank, one row a node.

    Attributes:
        gap: Gap (m).
        slip: Slip increment of the step (m), ``gdim - 1`` columns.
        limit: Friction limit (Pa) at the pressure ``max(c_n - r gap, 0)``.
        c: Multipliers ``(c_n, c_t)`` (Pa).
        r: Scale of the natural map (Pa/m): the stiffness of the bulk over the area.
        area: Nodal area.
        free: False for the prescribed directions; a node with a prescribed normal is no
            contact node.
        own_map: ``|R_t|`` (Pa) of a law that states no cone, by its own residual, or ``None``.
        bonded: Nodes that neither open nor slide, whatever they carry; ``None`` for none.
    """

    gap: Array
    slip: Array
    limit: Array
    c: Array
    r: Array
    area: Array
    free: npt.NDArray[np.bool_]
    own_map: Array | None = None
    bonded: npt.NDArray[np.bool_] | None = None

    @property
    def ties(self) -> npt.NDArray[np.bool_]:
        """Nodes that are bonded."""
        return np.zeros(len(self.gap), dtype=bool) if self.bonded is None else self.bonded

    @property
    def takes_part(self) -> npt.NDArray[np.bool_]:
        """Nodes whose normal direction is free."""
        return self.free[:, 0]

    @property
    def trial(self) -> Array:
        """The argument ``c_t - r s`` of the tangential projection (Pa)."""
        return self.c[:, 1:] - self.r[:, None] * self.slip

    def natural_map(self) -> tuple[Array, Array]:
        """Return the natural-map residuals ``R_n`` and ``|R_t|`` of each node (Pa)."""
        normal = self.c[:, 0] - np.maximum(self.c[:, 0] - self.r * self.gap, 0.0)
        normal = np.where(self.ties, self.r * self.gap, normal)
        length = np.linalg.norm(self.trial, axis=1)
        outside = length > self.limit
        shrink = np.divide(self.limit, length, out=np.ones_like(length), where=outside)
        tangential = self.c[:, 1:] - shrink[:, None] * self.trial
        part = self.takes_part
        size = np.linalg.norm(tangential, axis=1) if self.own_map is None else self.own_map
        return abs(normal) * part, size * part

    def states(self) -> npt.NDArray[np.int8]:
        """Return OPEN, STICK or SLIP of each node."""
        closed = (self.c[:, 0] - self.r * self.gap >= 0.0) | self.ties
        slips = np.linalg.norm(self.trial, axis=1) >= self.limit
        return np.where(closed & self.takes_part, np.where(slips, SLIP, STICK), OPEN).astype(
            np.int8
        )
