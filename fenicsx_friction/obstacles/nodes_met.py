# SPDX-License-Identifier: MIT
"""Which face of a rigid tool each node meets."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..surfaces.face_cells import blend, on_edges, shape_matrix
from .face_pairs import FacesMet
from .kinematics import Array
from .pairing import Mask
from .search import Pairs

#: A node is at an end of the body if the middles of its faces are on one side by this, over the
#: diameter of a face.
AT_EDGE = 0.2


class NodesMet(FacesMet):
    """The faces of a tool that nodes meet within a step; steep ones, too, as walls in their way.

    A node that slides over an edge of the tool keeps its face for a while, since the body's faces
    rest on that edge. Where none do, at the end of the body, it is let go at once.
    """

    facing = 0.0

    def _find(
        self, u: fem.Function, held: Mask, last: Pairs | None = None, keep: npt.ArrayLike = 0.0
    ) -> Pairs:
        """Pair the nodes at a displacement; collective."""
        found, cell = super()._find(u, held, last, keep), self._faces.cell
        x, own = self._secondary.positions(u), self._secondary.own
        inwards, size = self._inwards(x)[own], self._secondary.node_sizes()[own]
        corners = self._faces.X[self._faces.faces[found.face]]
        over = blend(shape_matrix(cell, found.xi), corners)
        back = on_edges(cell, corners, over) - over
        back /= np.maximum(np.linalg.norm(back, axis=1, keepdims=True), np.finfo(float).tiny)
        outside = np.sum(back * inwards, axis=1) < -AT_EDGE * size
        beyond = cell.overhang(found.xi) > self._policy.enter
        return Pairs(np.where(outside & beyond, -1, found.face), found.xi)

    def _inwards(self, x: Array) -> Array:
        """Return the way from each node to the mean of the middles of its faces (m)."""
        faces = self._secondary.faces
        middle, result, number = x[faces].mean(axis=1), np.zeros_like(x), np.zeros(len(x))
        for column in faces.T:
            np.add.at(result, column, middle)
            np.add.at(number, column, 1.0)
        return np.asarray(result / np.maximum(number, 1.0)[:, None] - x)
