# SPDX-License-Identifier: MIT
"""Copies of the unknowns, to go back to."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem

Snapshot = list[npt.NDArray[np.floating]]


def save(functions: Sequence[fem.Function]) -> Snapshot:
    """Copy the values (owned and ghost) of the Functions."""
    return [f.x.array.copy() for f in functions]


def restore(functions: Sequence[fem.Function], snapshot: Snapshot) -> None:
    """Put the values back, bit for bit."""
    for f, values in zip(functions, snapshot, strict=True):
        f.x.array[:] = values
