# SPDX-License-Identifier: MIT
"""The tangent frame of each contact node, and its directions that boundary conditions hold."""

import numpy as np
import numpy.typing as npt

#: A normal this close to the span of the prescribed directions counts as prescribed.
PRESCRIBED_NORMAL = 1e-8
#: Cosine between hint and normal beyond which the first tangent is taken from another axis.
STEEP = 0.9
#: Components that are equal to so many digits are tied, so that no rounding chooses an axis.
TIED = 9

Array = npt.NDArray[np.floating]
Mask = npt.NDArray[np.bool_]


def choose_hints(normals: Array, fixed: Mask) -> Array:
    """Choose the axis whose tangential part becomes the first tangent of each node.

    Where exactly one axis is prescribed and it is not the normal, take this axis: then only one
    multiplier belongs to the prescribed direction. Elsewhere take the axis most tangential to the
    surface.

    Args:
        normals: Unit normals, one row a node.
        fixed: Which Cartesian components of the displacement are prescribed, one row a node.

    Returns:
        Unit vectors along coordinate axes, one row a node.
    """
    single = (fixed.sum(axis=1) == 1) & ~_is_held(normals, fixed)
    flattest = np.round(abs(normals), TIED).argmin(axis=1)
    axis = np.where(single, fixed.argmax(axis=1), flattest)
    return np.asarray(np.eye(normals.shape[1])[axis])


def steep_hints(normals: Array, hints: Array) -> Mask:
    """Tell where the normal has turned so far towards the hint that the frame is ill-defined."""
    return np.asarray(abs(np.einsum("ij,ij->i", normals, hints)) > STEEP)


def pinned_directions(normals: Array, fixed: Mask) -> Mask:
    """Tell which directions ``(n, e_1[, e_2])`` of each frame are prescribed.

    Along a prescribed tangent the boundary condition carries the reaction. A row of contact there
    would repeat the condition, so the multiplier is set to zero. A node whose normal displacement
    is prescribed takes no part in contact.

    Args:
        normals: Unit normals, one row a node.
        fixed: Which Cartesian components of the displacement are prescribed.

    Returns:
        One row a node, normal first.
    """
    pinned = np.zeros_like(fixed)
    for k in range(1, fixed.shape[1]):
        pinned[:, k] = fixed.sum(axis=1) >= k
    pinned[_is_held(normals, fixed)] = True
    return pinned


def oblique(normals: Array, fixed: Mask, most: float) -> Mask:
    """Tell where prescribed directions are neither normal nor tangential (up to ``most``)."""
    along = np.linalg.norm(np.where(fixed, normals, 0.0), axis=1)
    return np.asarray((along > most) & ~_is_held(normals, fixed))


def _is_held(normals: Array, fixed: Mask) -> Mask:
    """Tell where the displacement along the normal is prescribed."""
    return np.asarray(np.linalg.norm(np.where(fixed, 0.0, normals), axis=1) < PRESCRIBED_NORMAL)
