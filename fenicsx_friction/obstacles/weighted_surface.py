# SPDX-License-Identifier: MIT
"""Weighted contact with the faces of a rigid tool, for displacements of degree 2 or more."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ..surfaces.face_points import FacePoints
from ..surfaces.nodal_kernel import Sites
from .against_tool import AgainstTool
from .averaged import DEEP
from .between import Between
from .crossing import HELD_DEPTH, Motion
from .kinematics import Array
from .pairing import Mask
from .points_met import PointsMet
from .search import Pairs
from .side import Side
from .weighted import WeightedPairing

Indices = npt.NDArray[np.int64]

#: Nodes meet nothing if less of their average than this is in front of faces.
COVER = 0.05
#: Cosine of the normals of two faces from which one goes on where the other ends.
LEVEL = 0.9


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

    def __init__(self, obstacle: Any, side: Side) -> None:
        super().__init__(obstacle, side)

    def _sites(self) -> Sites:
        """Return the points of the averages, which have planes of their own."""
        self._planes = np.zeros((self.points.num_owned, 2 * self.side.d + 2))
        self.points.give(self.near.planes, self._planes)
        return self.points

    def _watch(self) -> None:
        """Look for the faces that points and nodes of the body's faces meet; collective."""
        tool = self._take(self.obstacle)
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

    def begin_search(self) -> None:
        """Begin a series of searches."""
        self._met.begin_search()
        self._met_nodes.begin_search()

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

    def crossed(self, closed: Mask) -> Mask:
        """Tell which nodes have points that went through faces in the step; collective."""
        result, pressed = np.zeros(len(closed), dtype=bool), self._pressed(closed)
        for met, sites in self._both():
            result |= self._crossed(met, sites, pressed, closed)
        return result

    def _both(self) -> tuple[tuple[PointsMet, FacePoints], ...]:
        """Return the points of the averages and the nodes of the faces, with what they meet."""
        return (self._met, self.points), (self._met_nodes, self._nodes)

    def _crossed(self, met: PointsMet, sites: FacePoints, pressed: Array, closed: Mask) -> Mask:
        """Tell which nodes have such points; collective."""
        node, ends = sites.node_of_point, (self.side.u_old, self.side.u)
        # However fine the tool, the body meets it as its own faces can.
        of_face = np.full(len(self.faces.faces), np.inf)
        of_node = DEEP * self._secondary.node_sizes()[self._secondary.own][node] + self._doubt
        motion = Motion(
            face_x=(self.faces.X, self.faces.X),
            x=(met.positions(ends[0]), met.positions(ends[1])),
            directions=(met.directions(ends[0]), met.directions(ends[1])),
            depths=(of_face, of_node),
        )
        face = self._find_crossed(motion, met.start.face)
        middle = self.faces.X[self.faces.faces[face]].mean(axis=1)
        # A point little below its own face may be far behind a side of the tool, but not behind a
        # wall that rises from this face.
        depths, distances = met.depths(self.offset[node]), self._tool.distances(met.pairs, middle)
        top = (depths <= self._too_deep(sites, pressed)) & (distances < 0.0)
        # What it meets goes on there: contact holds it on average, as at a plane.
        level = (abs(distances) <= of_node) & (self._tool.cosines(met.pairs, face) > LEVEL)
        level &= closed[node] & (depths <= HELD_DEPTH / DEEP * of_node)
        # No other side of the tool is nearer, as below a thin plate or beside an edge.
        few = np.flatnonzero(level & (face >= 0))
        level[few] = self._inside(motion.x[1][few], motion.directions[1][few]) > LEVEL * depths[few]
        through = (face >= 0) & ~(met.pairs.paired & (top | level))
        return np.bincount(node, through, minlength=self.side.surface.num_owned) > 0.0

    def missed(self, closed: Mask) -> Mask:
        """Tell which open nodes have faces that the tool enters deeply; collective."""
        result, pressed = np.zeros(len(closed), dtype=bool), self._pressed(closed)
        for depths, sites in zip(self._depths(), (self.points, self._nodes), strict=True):
            deep = depths > self._too_deep(sites, pressed)
            result |= np.bincount(sites.node_of_point, deep, minlength=len(closed)) > 0.0
        return result & ~closed

    def _too_deep(self, sites: FacePoints, pressed: Array) -> Array:
        """Return from which depth on points are too deep in the tool (m).

        Faces at contact are before the tool on average only.
        """
        sizes = self._secondary.node_sizes()[self._secondary.own]
        number = len(sites.x) // max(len(sites.around), 1)
        around = np.repeat(sites.around, number, axis=0)
        return self._deepest(pressed, around, sizes[sites.node_of_point])

    def _places(self) -> Iterator[tuple[Array, Array, Indices, Array]]:
        """Yield the points of the averages, and the nodes of the faces."""
        u = self.side.u
        for (met, sites), depths in zip(self._both(), self._depths(), strict=True):
            yield met.positions(u), met.directions(u), sites.node_of_point, depths

    def _depths(self) -> tuple[Array, Array]:
        """Return how deep points and nodes of the faces are in the obstacle (m); collective."""
        both = self._both()
        at_points, at_nodes = (met.depths(self.offset[sites.node_of_point]) for met, sites in both)
        return at_points, at_nodes

    def rounding(self) -> Array:
        """Return the lengths whose rounding gaps contain: those of planes that are moved."""
        result = np.zeros(self.side.surface.num_owned)
        lengths = self._tool.rounding(self._planes, self.points.x)
        np.maximum.at(result, self.points.node_of_point, lengths)
        return result
