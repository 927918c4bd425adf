# SPDX-License-Identifier: MIT
"""The planes of the patches of a surface, on which others are projected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..surfaces.face_tables import normals_of
from ..surfaces.lagrange_faces import LagrangeFaces

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


def outward_normals(faces: LagrangeFaces, x: Array) -> Array:
    """Return the unit normals out of the body at the centers of all patches."""
    normal = faces.signs[:, None] * normals_of(faces.tangents(x))
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


@dataclass(frozen=True)
class Planes:
    """The planes of the patches of the secondary surface.

    Attributes:
        origin: Centers of the patches (m).
        normal: Unit normals, towards the body.
        axes: Unit vectors in the planes: (patches, d - 1, d).
    """

    origin: Array
    normal: Array
    axes: Array

    @classmethod
    def of(cls, faces: LagrangeFaces, x: Array) -> Planes:
        """Return the planes at positions ``x`` of the dofs (m)."""
        normal, first = -outward_normals(faces, x), faces.tangents(x)[:, 0]
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        axes = first[:, None]
        if faces.d == 3:
            axes = np.stack([first, np.cross(normal, first)], axis=1)
        return cls(faces.corner_positions(x).mean(axis=1), normal, axes)

    def flat(self, patch: Indices, points: Array) -> Array:
        """Return the coordinates in the planes of points (n, ..., d)."""
        return np.einsum(
            "n...d,nkd->n...k", points - self._origins(patch, points), self.axes[patch]
        )

    def heights(self, patch: Indices, points: Array) -> Array:
        """Return how far points (n, ..., d) are behind the planes (m), seen from the body."""
        return np.einsum(
            "n...d,nd->n...", self._origins(patch, points) - points, self.normal[patch]
        )

    def points(self, patch: Indices, flat: Array) -> Array:
        """Return the points with coordinates in the planes."""
        return self.origin[patch] + np.einsum("nk,nkd->nd", flat, self.axes[patch])

    def _origins(self, patch: Indices, points: Array) -> Array:
        """Return the origins, to be subtracted from points."""
        return self.origin[patch].reshape(len(patch), *[1] * (points.ndim - 2), points.shape[-1])
