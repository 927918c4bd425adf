# SPDX-License-Identifier: MIT
"""Stiffness of the bulk over the area of contact nodes."""

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..obstacles.kinematics import Array
from ..obstacles.pairing import Pairing
from ..surfaces.surface import ContactSurface

#: The scale is that of the primary surface from this ratio on.
MUCH_SOFTER = 0.1


def over_area(
    stiffness: fem.Function,
    surface: ContactSurface,
    parent_dofs: npt.NDArray[np.integer],
    pairing: Pairing,
) -> Array:
    """Return the stiffness over the area (Pa/m) at the local nodes of a surface; collective.

    Args:
        stiffness: Stiffness (N/m) at the dofs of the displacement.
        surface: The surface.
        parent_dofs: The (blocked) dof of the displacement at each local node.
        pairing: What the nodes meet: the softer body decides which traction belongs to a gap.
    """
    V = stiffness.function_space
    mean = stiffness.x.array.reshape(-1, V.dofmap.index_map_bs).mean(axis=1)
    own = mean[parent_dofs] / surface.area.x.array
    softer = pairing.stiffness(mean, V)
    return np.where(softer < MUCH_SOFTER * own, softer, own)
