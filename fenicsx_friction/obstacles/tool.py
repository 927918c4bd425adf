# SPDX-License-Identifier: MIT
"""A rigid tool made of faces, as a side of a body sees it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..surfaces.bisection import cut
from ..surfaces.face_cells import blend, normals, shape_matrix
from ..surfaces.faces import Faces, FaceSet
from .candidates import TIE
from .kinematics import Array
from .motion import Motion
from .search import Pairs, SearchPolicy, nearest_faces
from .side import Side
from .tool_edges import ToolEdges
from .view import View

Indices = npt.NDArray[np.int64]


class Tool:
    """Faces of a rigid tool at rest, and the side of a body that moves beside them.

    Faces are searched and crossed in the frame of the tool. What a point meets is the plane of its
    face, which moves as a RigidPlane does.

    Args:
        obstacle: The tool, a ``RigidSurface``.
        side: The side.

    Attributes:
        side: As given.
        motion: The motion of the tool.
        whole: Its faces as given,
        faces: and cut to the size of those of the body.
        edges: Its edges and corners.
        policy: How they are searched.
        secondary: The nodes of the side beside them.
    """

    def __init__(self, obstacle: Any, side: Side) -> None:
        self.side, self.motion = side, obstacle.motion
        self.secondary = FromTool(side, obstacle.motion)
        self.whole = whole = obstacle.surface
        # The same on any partition.
        size = float(f"{self.secondary.size:.6g}")
        X, parts, self._part_of = cut(whole.X, whole.faces, size)
        self.edges = ToolEdges(whole, size)
        corners = whole.X[whole.faces]
        center = np.tile(whole.cell.center, (len(corners), 1))
        self._normal, self._point = normals(whole.cell, corners, center), corners[:, 0]
        self.faces, self.policy = Faces(whole.cell, X, parts), obstacle.search or SearchPolicy()
        if self.policy.reach is None:
            self.policy = replace(self.policy, reach=2.0 * max(size, self.faces.size))

    def outward(self) -> Array:
        """Return the outward normals of the undeformed body at the owned nodes."""
        return np.asarray(self.secondary.node_normals(self.secondary.X)[self.secondary.own])

    def planes(self, pairs: Pairs, X: Array, outward: Array, offset: Array) -> Array:
        """Return the planes that points meet: normal, point, distance at rest, 1.

        Args:
            pairs: The faces that they meet.
            X: The points in the undeformed body (m).
            outward: Outward normals there, for points that meet none.
            offset: What is subtracted from their gaps (m).

        Returns:
            One row each, ``2 d + 2`` numbers; those that meet none have a constant gap, and 0 last.
        """
        met, whole = pairs.paired, self._part_of[pairs.face]
        normal = np.where(met[:, None], self._normal[whole], -outward)
        point = np.where(met[:, None], self._point[whole], 0.0)
        away = np.sum(normal * (X - point), axis=1)
        start = np.where(met, away - offset, self.policy.distance(self.faces))
        return np.column_stack([normal, point, start, met])

    def distances(self, pairs: Pairs, x: Array) -> Array:
        """Return how far points beside the unmoved tool are in front of their faces (m)."""
        whole = self._part_of[pairs.face]
        return np.asarray(np.sum(self._normal[whole] * (x - self._point[whole]), axis=1))

    def cosines(self, pairs: Pairs, faces: Indices) -> Array:
        """Return the cosines between the normals of what points meet and those of faces."""
        normals_met, others = (self._normal[self._part_of[f]] for f in (pairs.face, faces))
        return np.asarray(np.sum(normals_met * others, axis=1))

    def rounding(self, planes: Array, X: Array) -> Array:
        """Return the lengths (m) whose rounding gaps from planes contain, which are moved."""
        d, motion = self.side.d, self.motion
        normal, point = planes[:, :d], planes[:, d : 2 * d]
        away = np.linalg.norm(X - point, axis=1)
        if motion is None:
            return away
        turned = motion.turned_by()
        moved = motion.translated() + (point - motion.center) @ turned.T
        along = np.sum(abs((normal + normal @ turned.T) * moved), axis=1)
        return np.asarray(along + away)

    def view(self, u: fem.Function, offset: Array) -> View:
        """Return how the nearest faces look at the nodes; collective.

        A node beyond the edges of its nearest face is in front of the tool as the averaged normal
        says: the plane of one of two faces that meet at an edge would not tell.
        """
        x, own, faces = self.secondary.positions(u), self.secondary.own, self.faces
        directions, x = self.secondary.node_normals(x)[own], x[own]
        near = nearest_faces(faces, faces.X, x)
        normal, over = self._normal[self._part_of[near.face]], near.overhang <= TIE
        around = faces.faces[near.face]
        shapes = shape_matrix(faces.cell, faces.cell.inside(near.xi))
        away = x - blend(shapes, faces.X[around])
        averaged = blend(shapes, faces.node_normals(faces.X)[around])
        beside = np.linalg.norm(away, axis=1) * np.sign(np.sum(away * averaged, axis=1))
        gap = np.where(over, near.gap, beside)
        cosine = np.sum(normal * directions, axis=1)
        deep = over & (cosine < 0.0) & (near.gap < -self.policy.distance(faces))
        return View(cosine, gap - offset, np.where(deep, -near.gap, 0.0))


class FromTool(FaceSet):
    """A contact surface in the frame of a tool: where its nodes are beside the unmoved tool.

    Args:
        side: The side.
        motion: The motion of the tool.
    """

    def __init__(self, side: Side, motion: Motion | None) -> None:
        super().__init__(side.surface, side.u)
        self._u_old, self._motion = side.u_old, motion

    def positions(self, u: fem.Function | None = None) -> Array:
        """Return the positions beside the tool where it is now, or was with ``u_old`` (m)."""
        return self.beside(super().positions(u), u)

    def beside(self, x: Array, u: fem.Function | None) -> Array:
        """Return positions of a displacement (m) as the unmoved tool sees them."""
        if self._motion is None:
            return x
        return self._motion.undone(self._motion.carried(x) if u is self._u_old else x)
