# SPDX-License-Identifier: MIT
"""The displacement's dofs on the facets of a surface, of all ranks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import gather_rows

Indices = npt.NDArray[np.int64]


class SurfaceDofs:
    """Numbers the (blocked) dofs on a surface in the order of their owners; collective.

    Args:
        V: Space of the displacement.
        dofs: Global (blocked) dofs on the facets of all ranks.

    Attributes:
        owned: Those that this rank owns, by their local numbers.
    """

    def __init__(self, V: fem.FunctionSpace, dofs: Indices) -> None:
        self._V, self._comm, self._all = V, V.mesh.comm, np.unique(dofs)
        start, end = V.dofmap.index_map.local_range
        owned = self._all[(self._all >= start) & (self._all < end)] - start
        self.owned: npt.NDArray[np.int32] = owned.astype(np.int32)
        self._counts = np.array(self._comm.allgather(len(owned)))

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._all)

    def places(self, dofs: Indices) -> Indices:
        """Return the places of global dofs in the order of :meth:`gather`."""
        return np.asarray(np.searchsorted(self._all, dofs))

    def places_of_local(self, dofs: npt.NDArray[np.int32]) -> Indices:
        """Return the places of local dofs."""
        return self.places(self._V.dofmap.index_map.local_to_global(dofs.astype(np.int32)))

    def contains_local(self, dofs: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
        """Tell which local dofs are among them."""
        numbers = self._V.dofmap.index_map.local_to_global(dofs.astype(np.int32))
        return np.isin(numbers, self._all)

    def gather(self, values: npt.NDArray) -> npt.NDArray:
        """Return the entries of a local array over the displacement's dofs, of all; collective."""
        rows = values.reshape(-1, self._V.dofmap.index_map_bs)[self.owned]
        return gather_rows(self._comm, rows, self._counts)
