# SPDX-License-Identifier: MIT
"""Measures the rows of the boundary by the same forces as those of the whole system."""

from collections.abc import Callable

import numpy as np

from ..base.groups import Array
from ..certificate.scales import SHARE, Scales
from .row_groups import MeasuredRows


class BoundaryMeasure:
    """Measures residuals on the boundary; elsewhere there are none.

    Reactions do not count among the forces, for they would cost an assembly.

    Args:
        rows: The rows.
        scales: Returns the scales of their groups now.
        nodes_across: Number of nodes across all contacts.

    Attributes:
        nodes_across: As given.
    """

    def __init__(
        self, rows: MeasuredRows, scales: Callable[[], Scales], nodes_across: float
    ) -> None:
        self._rows, self._scales, self.nodes_across = rows, scales, nodes_across

    def excess(self, rows: Array, tolerance: float) -> float:
        """Return the largest residual in units of what a relative tolerance allows."""
        found = self._rows.residuals(rows)
        return float(np.max(self._scales().excess(*found, tolerance, SHARE)))

    def find_noise(self) -> None:
        """Do nothing: the rounding of the user's residual does not enter here."""
