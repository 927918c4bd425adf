# SPDX-License-Identifier: MIT
"""The secondary side of a contact, as the obstacle sees it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..surfaces.surface import ContactSurface

Array = npt.NDArray[np.floating]


@dataclass(frozen=True)
class Side:
    """The secondary side of a contact.

    Attributes:
        surface: The contact surface.
        u: Displacement.
        u_old: Displacement of the last accepted step.
        c: Multipliers ``(c_n, c_1[, c_2])`` (Pa).
        hint: Direction whose tangential part is the first tangent.
        felt: Stiffness of the bulk over area that the nodes feel (Pa/m).
        parent_dofs: The (blocked) dof of the displacement at each local node.
    """

    surface: ContactSurface
    u: fem.Function
    u_old: fem.Function
    c: fem.Function
    hint: fem.Function
    felt: fem.Function
    parent_dofs: npt.NDArray[np.int32]

    @property
    def d(self) -> int:
        """Dimension of space."""
        return int(self.surface.mesh.geometry.dim)

    def owned(self, values: npt.NDArray) -> npt.NDArray:
        """Return the entries of a local array over the displacement's dofs at the owned nodes."""
        return values.reshape(-1, self.d)[self.parent_dofs[: self.surface.num_owned]]

    def nodal(self, f: fem.Function) -> Array:
        """Return the values of a vector of the multipliers' space at the owned nodes."""
        return self.nodal_entries(f.x.array)

    def nodal_entries(self, values: npt.NDArray) -> npt.NDArray:
        """Return the entries of an array over that space at the owned nodes."""
        return values.reshape(-1, self.d)[: self.surface.num_owned]

    def pressed_in(self) -> Array:
        """Return how far the multipliers press the body in at each owned node (m), about."""
        c_n, felt = self.nodal(self.c)[:, 0], self.felt.x.array[: self.surface.num_owned]
        return np.asarray(abs(c_n) / felt)

    def facet_size(self) -> Array:
        """Return the size of the facets round each owned node (m)."""
        n = self.surface.num_owned
        return np.asarray(self.surface.size.x.array[:n] ** (1.0 / (self.d - 1)))
