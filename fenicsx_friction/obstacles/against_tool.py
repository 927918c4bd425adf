# SPDX-License-Identifier: MIT
"""Surfaces that meet a rigid tool of faces: what is seen of the tool's own corners."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy
from dolfinx import fem

from .against_faces import AgainstFaces
from .averaged import DEEP
from .crossing import DEPTH, Motion, find_crossed
from .kinematics import Array
from .pairing import Mask
from .search import find_pairs
from .sinking import depths_inside
from .tool import Tool
from .view import View

Indices = npt.NDArray[np.int64]

#: Cosine of normals up to which walls are at right angles.
ASLANT = 0.1
#: Points on a way that are looked at; a wall thinner than the way over this may be missed.
SAMPLES = 32


class AgainstTool(AgainstFaces):
    """A surface that meets the faces of a rigid tool."""

    _tool: Tool

    def _take(self, obstacle: Any) -> Tool:
        """Take the tool, and return how the side sees it; collective."""
        self._tool = tool = Tool(obstacle, self.side)
        self._outward = tool.outward()
        self._face(tool.faces, tool.secondary, tool.policy, f"the {type(obstacle).__name__}")
        return tool

    def pierced(self, closed: Mask) -> Mask:
        """Tell which nodes have faces that edges or corners of the tool are in; collective.

        Only faces of the body tell how deep is too deep: the tool may be as fine as it likes.
        """
        tool, body, side = self._tool, self._secondary, self.side
        comm, own = side.surface.mesh.comm, body.own
        start, end = (body.positions(u) for u in (side.u_old, side.u))
        x, directions = tool.edges.near(np.concatenate([start, end]), body.size)
        mine = slice(comm.rank, None, comm.size)
        x, directions = x[mine], directions[mine]
        deep = self._deepest(self._pressed(closed), body.faces, body.sizes)
        motion = Motion(
            face_x=(start, end),
            x=(x, x),
            directions=(directions, directions),
            depths=(deep, np.full(len(x), np.inf)),
        )
        before = find_pairs(body, start, x, directions, self.policy, np.ones(len(x), bool)).face
        entered = find_crossed(body, motion, before)
        entered = np.concatenate(comm.allgather(entered[entered >= 0]))
        return np.isin(np.arange(own.start, own.stop), body.faces[entered])

    def _find_crossed(
        self, motion: Motion, started: Indices, met: scipy.sparse.csr_array | None = None
    ) -> Indices:
        """Return the face of the tool that each point has gone behind in the step, or -1.

        As far as a mesh does not resolve, a point may be beside an edge of the tool, or have come
        out of it again: it has gone sharply through a face, or deep into the tool on its way, or it
        has crossed none. Walls at right angles to the surface are crossed on such a way alone.
        """
        face = super()._find_crossed(replace(motion, aslant=-ASLANT), started, met)
        of_face, of_node = motion.depths
        deep = DEEP * self._secondary.size + self._doubt
        depths = np.full_like(of_face, np.inf), np.maximum(of_node, deep)
        steep = replace(motion, depths=depths, held_depths=None, aslant=ASLANT)
        wall = np.where(face < 0, super()._find_crossed(steep, started), -1)
        few = np.flatnonzero((face >= 0) | (wall >= 0))
        (start, end), (n, m) = ([a[few] for a in ends] for ends in (motion.x, motion.directions))
        sharp = np.minimum(of_node[few], DEPTH * self._secondary.size + self._doubt)
        sharply = Motion(
            motion.face_x, (start, end), (n, m), (of_face, sharp), aslant=-ASLANT, at_rest=True
        )
        through = (super()._find_crossed(sharply, started[few]) >= 0) & (face[few] >= 0)
        way = np.concatenate(
            [start + t * (end - start) for t in np.linspace(0.0, 1.0, SAMPLES + 1)]
        )
        inside = self._inside(way, np.tile(m, (SAMPLES + 1, 1)))
        inside = np.max(inside.reshape(SAMPLES + 1, len(few)), axis=0)
        deeper = inside > np.where(face[few] >= 0, deep, 0.5 * deep)  # in the middle of a wall
        result = np.maximum(face, wall)
        result[few[~(through | deeper)]] = -1
        return result

    def _inside(self, x: Array, directions: Array) -> Array:
        """Return how deep points are in the tool (m), zero outside."""
        edges = self._tool.edges
        return depths_inside(self.faces, x, directions, edges.open, edges.facing)

    def sunk(self) -> Mask:
        """Tell which nodes, or points round them, are in the tool beside what they meet.

        A tenth of a face is what a mesh does not resolve. Collective.
        """
        sizes = DEEP * self._secondary.node_sizes()[self._secondary.own] + self._doubt
        result = np.zeros(len(sizes), dtype=bool)
        for x, directions, node, met in self._places():
            inside = self._inside(x, directions)
            beside = inside + self.offset[node] - np.maximum(met, 0.0)
            deep = (inside > 0.0) & (beside > sizes[node])
            result |= np.bincount(node, deep, minlength=len(sizes)) > 0.0
        return result

    @abstractmethod
    def _places(self) -> Iterator[tuple[Array, Array, Indices, Array]]:
        """Yield points beside the unmoved tool, normals, nodes, and depths that they meet (m)."""

    def view(self, u: fem.Function) -> View:
        """Return how the nearest faces look at the nodes; collective."""
        return self._tool.view(u, self.offset)
