# SPDX-License-Identifier: MIT
"""Which face of a rigid tool each point between the nodes meets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..surfaces.face_cells import blend, shape_matrix
from ..surfaces.face_points import FacePoints
from .candidates import TIE
from .face_pairs import FacesMet
from .kinematics import Array
from .pairing import Mask
from .search import Pairs, find_pairs
from .tool import Tool

#: Cosine of the normal of a face and the way to a point, from which on this is over the face.
RIDGE = 0.9


class PointsMet(FacesMet):
    """The faces of a tool that points between the nodes of a side meet within a step.

    Args:
        tool: The tool.
        points: The points.
    """

    def __init__(self, tool: Tool, points: FacePoints) -> None:
        self._tool, self._points = tool, points
        # Whether a point counts depends on where it is, not on what it met before.
        policy = replace(tool.policy, enter=1.0, leave=1.0)
        super().__init__(tool.faces, tool.secondary, policy, tool.side)

    def positions(self, u: fem.Function) -> Array:
        """Return where the points are beside the unmoved tool at a displacement; collective."""
        moved = self._points.interpolate(self._points.gather_all(u.x.array))
        return self._tool.secondary.beside(self._points.x + moved, u)

    def directions(self, u: fem.Function) -> Array:
        """Return the averaged normals of their nodes; collective."""
        nodes = self._tool.secondary
        return nodes.node_normals(nodes.positions(u))[nodes.own][self._points.node_of_point]

    def depths(self, offset: Array) -> Array:
        """Return how deep the points are behind their faces now (m), or ``-inf``; collective.

        Args:
            offset: What is subtracted from their gaps (m).
        """
        x, pairs = self.positions(self._side.u), self.pairs
        return np.where(pairs.paired, offset - self._tool.distances(pairs, x), -np.inf)

    def _closed(self) -> Mask:
        """Tell which points have nodes that are closed."""
        return super()._closed()[self._points.node_of_point]

    def _find(
        self, u: fem.Function, held: Mask, last: Pairs | None = None, keep: npt.ArrayLike = 0.0
    ) -> Pairs:
        """Pair the points at a displacement, those over the tool; collective.

        Beyond all faces, but over the tool, are points above a ridge between two of them.
        """
        x, faces = self.positions(u), self._faces
        parts = (x, self.directions(u), self._policy, held, last)
        found = find_pairs(faces, faces.X, *parts, keep=keep, facing=self.facing)
        shapes = shape_matrix(faces.cell, faces.cell.inside(found.xi))
        away = np.linalg.norm(x - blend(shapes, faces.X[faces.faces[found.face]]), axis=1)
        # A point that goes to and fro over an edge stays, within what ``keep`` allows.
        overhang = faces.cell.overhang(found.xi)
        over = overhang <= TIE
        if last is not None:
            over |= (found.face == last.face) & (overhang <= np.asarray(keep))
        over |= self._tool.distances(found, x) > RIDGE * away
        return Pairs(np.where(over, found.face, -1), found.xi)
