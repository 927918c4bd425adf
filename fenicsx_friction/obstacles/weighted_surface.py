# SPDX-License-Identifier: MIT
"""Weighted contact with the faces of a rigid tool, for displacements of degree 2 or more."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..surfaces.face_points import FacePoints
from ..surfaces.nodal_kernel import Sites
from .against_faces import beside
from .against_tool import AgainstTool
from .averaged import DEEP
from .between import Between
from .crossing import Motion, find_crossed, held_depths
from .face_pairs import FacesMet
from .kinematics import Array
from .pairing import Mask
from .search import Pairs, find_pairs
from .side import Side
from .tool import Tool
from .weighted import WeightedPairing

#: Points count up to this part of a face beyond the edge if they did before.
BEYOND = 0.05
#: Nodes meet nothing if less of their average than this is in front of faces.
COVER = 0.05


class PointsMet(FacesMet):
    """The faces of a tool that points between the nodes of a side meet within a step.

    Args:
        tool: The tool.
        points: The points.
    """

    def __init__(self, tool: Tool, points: FacePoints) -> None:
        self._tool, self._points = tool, points
        # A little more room for those that have a face, or they would come and go.
        policy = replace(tool.policy, enter=0.0, leave=BEYOND)
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
        """Pair the points at a displacement; collective."""
        parts = (self.positions(u), self.directions(u), self._policy, held, last)
        return find_pairs(self._faces, self._faces.X, *parts, keep=keep)


class WeightedSurface(AgainstTool, WeightedPairing):
    """Nodes that meet the faces of a rigid tool on average over their faces.

    Each point of an average meets the plane of a face of its own. Points beyond the tool's edges
    meet none and do not count: gap and slip are averages over the rest, the *cover* of a node, and
    forces act there. Which faces and which cover is found anew after each solve.

    Args:
        obstacle: The tool.
        side: The side.
    """

    near: Any
    #: Open nodes may have points behind faces: the node counts on average.
    behind = DEEP

    def __init__(self, obstacle: Any, side: Side) -> None:
        super().__init__(obstacle, side)

    def _sites(self) -> Sites:
        """Return the points of the averages, which have planes of their own."""
        self._planes = np.zeros((self.points.num_owned, 2 * self.side.d + 2))
        self.points.give(self.near.planes, self._planes)
        return self.points

    def _watch(self) -> None:
        """Look for the faces that points and nodes of the body's faces meet; collective."""
        tool = Tool(self.obstacle, self.side)
        self._take(tool, type(self.obstacle).__name__)
        self._whole = self.points.share
        self._met, self._met_nodes = PointsMet(tool, self.points), PointsMet(tool, self._nodes)
        self._between = Between(self.obstacle, self.side, self.points, self._gaps_and_normals)
        self._write()

    def _write(self) -> None:
        """Write the planes that the points meet, and their weights."""
        pairs, points, node = self._met.pairs, self.points, self.points.node_of_point
        share = np.where(pairs.paired, self._whole.ravel(), 0.0)
        cover = np.bincount(node, share, minlength=self.side.surface.num_owned)
        self.cover = np.where(cover < COVER, 0.0, cover)
        covered = self.cover[node] > 0.0
        share = np.where(covered, share / np.where(covered, cover[node], 1.0), self._whole.ravel())
        points.share = share.reshape(self._whole.shape)
        met = Pairs(np.where(covered, pairs.face, -1), pairs.xi)
        parts = (met, points.x, self._outward[node], self.offset[node])
        self._planes[:] = self._tool.planes(*parts)

    # -- kinematics ------------------------------------------------------------------------------

    def levers(self) -> Array:
        """Return the forces of unit multipliers over the area: on what is covered."""
        return super().levers() * self.cover[:, None, None, None]

    def turning(self, slopes: Array, weight_slopes: Array | None) -> list[Array]:
        """Return how displacements turn the forces (N/m)."""
        cover = self.cover[:, None, None]
        return [block * cover for block in super().turning(slopes, weight_slopes)]

    def acting_area(self) -> Array:
        """Return the parts of the areas on which forces act, whole ones where none do."""
        return self.area() * np.where(self.cover > 0.0, self.cover, 1.0)

    # -- from step to step -----------------------------------------------------------------------

    def anchor(self) -> None:
        """Find the faces at ``u_old``, and the mean normals; collective."""
        self._met.anchor()
        self._met_nodes.anchor()
        self._write()
        super().anchor()

    def search(self) -> bool:
        """Look again for the faces at the current displacement and motion; collective."""
        changed = self._met.search()
        self._met_nodes.search()
        if changed:
            self._write()
        return changed

    def save(self) -> object:
        """Return the faces met now, at the step's start and between."""
        return self._met.save(), self._met_nodes.save()

    def restore(self, saved: Any) -> None:
        """Put them back."""
        for met, state in zip((self._met, self._met_nodes), saved, strict=True):
            met.restore(state)
        self._write()

    # -- what else is asked of an obstacle -------------------------------------------------------

    def meeting(self) -> Mask:
        """Tell which owned nodes have faces before them."""
        return self.cover > 0.0

    def couples(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return points and the nodes of the faces that they meet now, in pairs."""
        return self.couples_of(self._met.pairs)

    def _held_by(self, closed: Mask) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return nodes of points that are closed and the faces that hold these, in pairs."""
        node, pairs = self.points.node_of_point, self._met.pairs
        found = np.flatnonzero(closed[node] & pairs.paired)
        return node[found], pairs.face[found]

    def crossed(self, closed: Mask) -> Mask:
        """Tell which nodes have points that went through faces in the step; collective."""
        node, side, met = self.points.node_of_point, self.side, self._met
        i, j = self.couples()
        held = closed[node[i]]
        ends = (side.u_old, side.u)
        # However fine the tool, the body meets it as its own faces can.
        of_face = np.full(len(self.faces.faces), np.inf)
        of_node = self._secondary.node_sizes()[self._secondary.own][node]
        motion = Motion(
            face_x=(self.faces.X, self.faces.X),
            x=(met.positions(ends[0]), met.positions(ends[1])),
            directions=(met.directions(ends[0]), met.directions(ends[1])),
            depths=(self.behind * of_face + self._doubt, self.behind * of_node + self._doubt),
            held_depths=held_depths((of_face, of_node), self._doubt),
        )
        by = beside(self.faces, i[held], j[held], len(node))
        found = find_crossed(self.faces, motion, met.start.face, by) >= 0
        return np.bincount(node, found, minlength=len(closed)) > 0.0

    def _depths(self) -> tuple[Array, Array]:
        """Return how deep points and nodes of the faces are in the obstacle (m); collective."""
        parts = ((self._met, self.points), (self._met_nodes, self._nodes))
        at_points, at_nodes = (met.depths(self.offset[p.node_of_point]) for met, p in parts)
        return at_points, at_nodes

    def rounding(self) -> Array:
        """Return the lengths whose rounding gaps contain: those of planes that are moved."""
        result = np.zeros(self.side.surface.num_owned)
        lengths = self._tool.rounding(self._planes, self.points.x)
        np.maximum.at(result, self.points.node_of_point, lengths)
        return result
