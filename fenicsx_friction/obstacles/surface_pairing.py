# SPDX-License-Identifier: MIT
"""Nodes that meet the faces of a rigid tool."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..surfaces.bisection import cut
from ..surfaces.face_cells import blend, normals, shape_matrix
from ..surfaces.faces import Faces, FaceSet
from .against_faces import AgainstFaces
from .face_pairs import FacesMet
from .kinematics import Array
from .motion import Motion
from .pairing import Mask
from .rigid_pairing import RigidPairing
from .search import TIE, SearchPolicy, nearest_faces
from .side import Side
from .view import View


class SurfacePairing(AgainstFaces, RigidPairing):
    """Nodes that meet the faces of a rigid tool: each stencil is the node alone.

    Faces are searched and crossed in the frame of the tool. What a node meets is the plane of its
    face, which moves as a RigidPlane does; its numbers are a field at the nodes. So the tool may be
    moved, or a body that carries loads, as any other rigid obstacle.

    Args:
        obstacle: The tool.
        side: The side.
    """

    near: Any

    def __init__(self, obstacle: Any, side: Side) -> None:
        super().__init__(obstacle, side)
        secondary = FromTool(side, obstacle.motion)
        whole, d = obstacle.surface, side.d
        # The same on any partition.
        size = float(f"{secondary.size:.6g}")
        X, parts, self._whole = cut(whole.X, whole.faces, size)
        corners = whole.X[whole.faces]
        center = np.tile(whole.cell.center, (len(corners), 1))
        self._normal, self._point = normals(whole.cell, corners, center), corners[:, 0]
        self._outward = secondary.node_normals(secondary.X)[secondary.own]
        faces, policy = Faces(whole.cell, X, parts), obstacle.search or SearchPolicy()
        if policy.reach is None:
            policy = replace(policy, reach=2.0 * max(size, faces.size))
        self._face(faces, secondary, policy, f"the {type(obstacle).__name__}")
        n = side.surface.num_owned
        self._planes = self.near.planes.x.array[: n * (2 * d + 2)].reshape(n, 2 * d + 2)
        self._met = FacesMet(faces, secondary, policy, side)
        self._start()

    def _axis(self) -> fem.Function | None:
        """Return the normals at the start of a step, from where 3D frames are carried to faces.

        So a node may meet a face at right angles to its last one: hints that were chosen for that
        one might have no tangential part.
        """
        self._normals = fem.Function(self.side.surface.space((self.side.d,)), name="axis")
        return self._normals if self.side.d == 3 else None

    def _start(self) -> None:
        """Write the planes that the nodes meet at the start, and their normals as they are now."""
        self._write()
        d, motion = self.side.d, self.obstacle.motion
        n = self._planes[:, :d]
        if motion is not None:
            n = n + self._planes[:, -1:] * (n @ motion.turned_by().T)
        self._normals.x.array[: n.size] = n.ravel()

    def _write(self) -> None:
        """Write the planes that the owned nodes meet: normal, point, distance at rest, 1."""
        d, pairs, rows = self.side.d, self._met.pairs, self._planes
        met, X = pairs.paired, self.side.surface.x[:, : self.side.d]
        whole = self._whole[pairs.face]
        rows[:, :d] = np.where(met[:, None], self._normal[whole], -self._outward)
        rows[:, d : 2 * d] = np.where(met[:, None], self._point[whole], 0.0)
        away = np.sum(rows[:, :d] * (X - rows[:, d : 2 * d]), axis=1)
        rows[:, 2 * d] = np.where(met, away - self.offset, self.policy.distance(self.faces))
        rows[:, 2 * d + 1] = met

    # -- from step to step -----------------------------------------------------------------------

    def anchor(self) -> None:
        """Find the faces that the nodes meet at ``u_old``; collective."""
        self._met.anchor()
        self._start()

    def search(self) -> bool:
        """Look again for the faces at the current displacement and motion; collective."""
        changed = self._met.search()
        if changed:
            self._write()
        return changed

    def save(self) -> object:
        """Return the faces met now, at the step's start and between."""
        return self._met.save()

    def restore(self, saved: Any) -> None:
        """Put them back."""
        self._met.restore(saved)
        self._write()

    # -- what else is asked of an obstacle -------------------------------------------------------

    def started(self) -> npt.NDArray[np.int64]:
        """Return the face of each node at the start of the step, or -1."""
        return self._met.start.face

    def meeting(self) -> Mask:
        """Tell which owned nodes have a face."""
        return self._met.pairs.paired

    def couples(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return owned nodes and the nodes of the faces that they meet now, in pairs."""
        return self.couples_of(self._met.pairs)

    def rounding(self) -> Array:
        """Return the lengths whose rounding gaps contain: those of planes that are moved."""
        d, motion = self.side.d, self.obstacle.motion
        normal, point = self._planes[:, :d], self._planes[:, d : 2 * d]
        away = np.linalg.norm(self.side.surface.x[:, :d] - point, axis=1)
        if motion is None:
            return away
        turned = motion.turned_by()
        moved = motion.translated() + (point - motion.center) @ turned.T
        along = np.sum(abs((normal + normal @ turned.T) * moved), axis=1)
        return np.asarray(along + away)

    def view(self, u: fem.Function) -> View:
        """Return how the nearest faces look at the nodes; collective.

        A node beyond the edges of its nearest face is in front of the tool as the averaged normal
        says: the plane of one of two faces that meet at an edge would not tell.
        """
        x, own, faces = self._secondary.positions(u), self._secondary.own, self.faces
        directions, x = self._secondary.node_normals(x)[own], x[own]
        near = nearest_faces(faces, faces.X, x)
        normal, over = self._normal[self._whole[near.face]], near.overhang <= TIE
        around = faces.faces[near.face]
        shapes = shape_matrix(faces.cell, faces.cell.inside(near.xi))
        away = x - blend(shapes, faces.X[around])
        averaged = blend(shapes, faces.node_normals(faces.X)[around])
        beside = np.linalg.norm(away, axis=1) * np.sign(np.sum(away * averaged, axis=1))
        gap = np.where(over, near.gap, beside)
        cosine = np.sum(normal * directions, axis=1)
        deep = over & (cosine < 0.0) & (near.gap < -self.policy.distance(faces))
        return View(cosine, gap - self.offset, np.where(deep, -near.gap, 0.0))


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
        x = super().positions(u)
        if self._motion is None:
            return x
        return self._motion.undone(self._motion.carried(x) if u is self._u_old else x)
