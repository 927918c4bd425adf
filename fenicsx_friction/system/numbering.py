# SPDX-License-Identifier: MIT
"""Numbers of dofs in the system of all unknowns."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem


def global_dofs(spaces: Sequence[fem.FunctionSpace]) -> list[npt.NDArray[np.int64]]:
    """Return, for the local dofs (with ghosts) of each space, their rows in the blocked system."""
    maps = [(V.dofmap.index_map, V.dofmap.index_map_bs) for V in spaces]
    next_row = sum(m.local_range[0] * bs for m, bs in maps)
    rows = []
    for V, (m, bs) in zip(spaces, maps, strict=True):
        numbers = fem.Function(V, dtype=np.float64)
        owned = m.size_local * bs
        numbers.x.array[:owned] = next_row + np.arange(owned)
        numbers.x.scatter_forward()
        rows.append(np.rint(numbers.x.array).astype(np.int64))
        next_row += owned
    return rows
