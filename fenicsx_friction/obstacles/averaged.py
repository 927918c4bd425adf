# SPDX-License-Identifier: MIT
"""Pairings whose nodes meet an obstacle on average over the faces round them."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from dolfinx import fem

from .face_frames import along_planes
from .kinematics import Array, frames, slices
from .pairing import Mask, Pairing

#: Weights of dofs below this count as none.
WEIGHTLESS = 1e-12
#: Component of the normal below which an axis is along the surface.
ALONG = 0.5
#: An obstacle that enters a face by this fraction of its size is not open to it.
DEEP = 0.1


class Averaged(Pairing):
    """Nodes with averaged normals and frames, and with forces on all dofs of their faces."""

    def traction(self) -> Array:
        """Return the tractions in global axes: forces over areas."""
        self.update()
        c = self.side.nodal(self.side.c)
        return np.asarray(np.sum(self.body_forces(c), axis=1))

    def body_forces(self, c: Array) -> Array:
        """Return the forces of multipliers over the area on the body itself: (nodes, points, d)."""
        return self.forces(c)

    def normals(self) -> Array:
        """Return the unit normals along the averages."""
        normal = self.values()[:, slice(*slices(self.side.d)[2])]
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def frames(self) -> Array:
        """Return frames along the averages, made orthonormal."""
        values, (normal, *first) = self.values().copy(), slices(self.side.d)[2:-1]
        n = values[:, slice(*normal)]
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        for where in first:
            # There is none before hints are chosen.
            values[:, slice(*where)] = along_planes(values[:, slice(*where)], n)
        return frames(values, self.side.d)

    @abstractmethod
    def on_plane(self, still: Mask) -> Mask:
        """Tell in which directions what the nodes meet is at rest as they are; collective.

        Args:
            still: The prescribed dofs of the displacement that do not move in this step.
        """

    def prescribed(self, fixed: fem.Function, nodes: Mask, still: Mask) -> Mask:
        """Keep the directions in which all that the average depends on is prescribed.

        On symmetry planes a node keeps its own: directions along the surface in which neither it
        nor what it meets is moved. Elsewhere the rest of its average is free.
        """
        held = self.gather(fixed.x.array, missing=1.0) > 0.5
        weights = abs(self.weights())
        along = abs(self.normals()) < ALONG
        plane = self.side.owned(still) & along & self.on_plane(still)
        symmetry = plane & ~np.all(nodes, axis=1, keepdims=True)
        meets = np.any(weights >= WEIGHTLESS, axis=1, keepdims=True)
        all_held = np.all(held | (weights < WEIGHTLESS)[:, :, None], axis=1)
        return np.asarray(symmetry | (meets & all_held))
