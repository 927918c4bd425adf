# SPDX-License-Identifier: MIT
"""The side of a contact that meets an obstacle, as the obstacle sees it."""

from typing import Protocol

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..surfaces.surface import ContactSurface

Array = npt.NDArray[np.floating]


class Side(Protocol):
    """The secondary side of a contact; rows of arrays are the owned nodes of its surface.

    Attributes:
        surface: The contact surface.
        c: Multipliers ``(c_n, c_1[, c_2])`` (Pa).
        hint: Direction whose tangential part is the first tangent.
        parent_dofs: The (blocked) dof of the displacement at each local node.
    """

    surface: ContactSurface
    c: fem.Function
    hint: fem.Function
    parent_dofs: npt.NDArray[np.int32]

    def gap_and_friction(self) -> tuple[Array, Array]:
        """Return gaps (m) and friction limits at unit pressure; collective."""

    def nodal_position(self) -> Array:
        """Return the current positions (m); collective."""

    def nodal_normal(self) -> Array:
        """Return the unit normals towards the body; collective."""
