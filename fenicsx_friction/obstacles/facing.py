# SPDX-License-Identifier: MIT
"""Two surfaces that face each other, with all dofs of the displacement on them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..surfaces.lagrange_faces import LagrangeFaces
from ..surfaces.surface import ContactSurface

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]
#: Positions of the dofs of the secondary and of the primary surface (m).
Positions = tuple[Array, Array]


class Facing:
    """The secondary and the primary surface, on every rank; collective.

    Args:
        surfaces: The secondary and the primary one.
        V: Space of the displacement.

    Attributes:
        secondary: The secondary surface.
        primary: The primary one. Its dofs are numbered after those of the secondary one.
    """

    def __init__(
        self, surfaces: tuple[ContactSurface, ContactSurface], V: fem.FunctionSpace
    ) -> None:
        self.secondary, self.primary = (LagrangeFaces(surface, V) for surface in surfaces)
        self.num_secondary, self.num_primary = (len(f.rows) for f in (self.secondary, self.primary))
        self._origin = self.secondary.X[0].copy()

    @property
    def owned(self) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """This rank's (blocked) dofs on both."""
        return self.secondary.rows.owned, self.primary.rows.owned

    def rows(self, values: npt.NDArray) -> tuple[npt.NDArray, npt.NDArray]:
        """Return the entries of a local array at the dofs of both surfaces; collective."""
        return self.secondary.rows.gather(values), self.primary.rows.gather(values)

    def patches_near(self, nodes: slice, rings: int) -> npt.NDArray[np.bool_]:
        """Tell which patches of the secondary surface are in so many rings round nodes."""
        of_faces = self.secondary.nodes
        near = (of_faces >= nodes.start) & (of_faces < nodes.stop)
        for _ in range(rings - 1):
            near = np.isin(of_faces, of_faces[near.any(axis=1)])
        return np.repeat(near.any(axis=1), len(self.secondary.corners))

    def positions(self, u: Array) -> Positions:
        """Return the positions of all dofs, seen from :meth:`origin`; collective.

        So neither large coordinates nor a common motion add rounding.
        """
        first, second = self.rows(u)
        shift = first[0].copy()
        X = [faces.X - self._origin for faces in (self.secondary, self.primary)]
        return X[0] + (first - shift), X[1] + (second - shift)

    def origin(self, u: Array) -> Array:
        """Return the place from where positions count (m); collective."""
        return np.asarray(self._origin + self.rows(u)[0][0])
