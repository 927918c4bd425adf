# SPDX-License-Identifier: MIT
"""Pairings whose nodes meet an obstacle on average over the faces round them."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from .kinematics import Array, frames, slices
from .obstacle import Mask, Pairing

#: Weights of dofs below this count as none.
WEIGHTLESS = 1e-12
#: An obstacle that enters a face by this fraction of its size is not open to it.
DEEP = 0.1


class Averaged(Pairing):
    """Nodes with averaged normals and frames, and with forces on all dofs of their faces."""

    def traction(self) -> Array:
        """Return the tractions in global axes: forces over areas."""
        self.update()
        c = self.side.nodal(self.side.c)
        return np.asarray(np.einsum("nk,nkpd->nd", c, self.body_levers()))

    def body_levers(self) -> Array:
        """Return the levers of the dofs of the body itself."""
        return self.levers()

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
            e = values[:, slice(*where)]
            e -= np.sum(e * n, axis=1, keepdims=True) * n
            length = np.linalg.norm(e, axis=1, keepdims=True)
            e /= np.where(length > 0.0, length, 1.0)  # before hints are chosen
        return frames(values, self.side.d)

    def prescribed(self, fixed: fem.Function, nodes: Mask) -> Mask:
        """Keep the directions in which all that the average depends on is prescribed.

        A node keeps its own, as on symmetry planes, unless all its directions are prescribed.
        """
        held = self.gather(fixed.x.array, missing=1.0) > 0.5
        weights = abs(self.weights())
        symmetry = nodes & ~np.all(nodes, axis=1, keepdims=True)
        meets = np.any(weights >= WEIGHTLESS, axis=1, keepdims=True)
        all_held = np.all(held | (weights < WEIGHTLESS)[:, :, None], axis=1)
        return np.asarray(symmetry | (meets & all_held))
