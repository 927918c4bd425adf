# SPDX-License-Identifier: MIT
"""Surfaces that meet a rigid tool of faces: what is seen of the tool's own corners."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from dolfinx import fem

from .against_faces import AgainstFaces, beside
from .averaged import DEEP
from .crossing import Motion, find_crossed, held_depths
from .pairing import Mask
from .search import find_pairs
from .tool import Tool
from .two_bodies import Indices
from .view import View


class AgainstTool(AgainstFaces):
    """A surface that meets the faces of a rigid tool."""

    _tool: Tool

    def _take(self, tool: Tool, other: str) -> None:
        """Take the tool."""
        self._tool, self._outward = tool, tool.outward()
        self._face(tool.faces, tool.secondary, tool.policy, f"the {other}")

    @abstractmethod
    def _held_by(self, closed: Mask) -> tuple[Indices, Indices]:
        """Return owned nodes that are closed and the (cut) faces that hold them, in pairs."""

    def pierced(self, closed: Mask) -> Mask:
        """Tell which nodes have faces that corners of the tool have gone into; collective.

        Only faces of the body tell how deep is too deep: the tool may be as fine as it likes.
        """
        tool, body, side = self._tool, self._secondary, self.side
        comm, own = side.surface.mesh.comm, body.own
        start, end = (body.positions(u) for u in (side.u_old, side.u))
        corners, directions = tool.corners(start, end, body.size)
        mine = slice(comm.rank, None, comm.size)
        corners, x, directions = corners[mine], tool.whole.X[corners[mine]], directions[mine]
        nodes, faces = self._held_by(closed)
        held = np.column_stack([nodes + own.start, tool.whole_of(faces)])
        held = np.concatenate(comm.allgather(held))
        around = tool.whole.faces[held[:, 1]]
        place = np.full(len(tool.whole.X), -1)
        place[corners] = np.arange(len(corners))
        i, j = place[around].ravel(), np.repeat(held[:, 0], around.shape[1])
        met = beside(body, i[i >= 0], j[i >= 0], len(corners))
        sizes = body.sizes, np.full(len(corners), np.inf)
        motion = Motion(
            face_x=(start, end),
            x=(x, x),
            directions=(directions, directions),
            depths=(DEEP * sizes[0] + self._doubt, sizes[1]),
            held_depths=held_depths(sizes, self._doubt),
        )
        before = find_pairs(body, start, x, directions, self.policy, np.ones(len(x), bool)).face
        entered = find_crossed(body, motion, before, met)
        entered = np.concatenate(comm.allgather(entered[entered >= 0]))
        return np.isin(np.arange(own.start, own.stop), body.faces[entered])

    def view(self, u: fem.Function) -> View:
        """Return how the nearest faces look at the nodes; collective."""
        return self._tool.view(u, self.offset)
