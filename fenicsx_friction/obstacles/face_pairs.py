# SPDX-License-Identifier: MIT
"""Which face each node meets: at the start of a step, now, and where slip starts from."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import any_rank
from ..surfaces.face_cells import blend, on_edges, project, shape_matrix
from ..surfaces.faces import Faces, FaceSet
from .candidates import FACING
from .kinematics import Array
from .search import Pairs, SearchPolicy, find_pairs
from .side import Side

#: A node is at an end of the body if the middles of its faces are on one side by this, over the
#: diameter of a face.
AT_EDGE = 0.2


class FacesMet:
    """The faces that nodes meet within a step.

    A node that slides over an edge of the surface keeps its face for a while, since the body's
    faces rest on that edge. Where none do, at the end of the body, it is let go at once.

    Args:
        faces: The faces.
        secondary: The secondary surface.
        policy: How pairs are found.
        side: The secondary side.

    Attributes:
        pairs: The face of each owned node now.
        start: The same at the last accepted displacement.
    """

    #: What :meth:`save` keeps, beside the faces met: arrays that are replaced, never changed.
    _STATE: tuple[str, ...] = ("pairs", "start")
    #: Cosine of the normals of node and face up to which they face each other.
    facing = FACING

    def __init__(self, faces: Faces, secondary: FaceSet, policy: SearchPolicy, side: Side) -> None:
        self._faces, self._secondary, self._policy, self._side = faces, secondary, policy, side
        self.anchor()

    def anchor(self) -> None:
        """Pair the nodes at ``u_old``; collective."""
        self.pairs = self.start = self._find(self._side.u_old, self._closed())
        self._met = [self.pairs.face]

    def _closed(self) -> npt.NDArray[np.bool_]:
        """Tell which nodes were closed."""
        return self._side.nodal(self._side.c)[:, 0] != 0.0

    def begin_search(self) -> None:
        """Forget which faces were met before those of now."""
        self._met = [self.pairs.face]

    def search(self) -> bool:
        """Look again for the faces at the current displacement; collective."""
        comm, keep = self._side.surface.mesh.comm, self._policy.keep
        found = self._find(self._side.u, self.pairs.paired, self.pairs)
        back = self._returns(found)
        if any_rank(comm, bool(np.any(back))):
            found = self._find(self._side.u, self.pairs.paired, self.pairs, back * keep)
        changed = any_rank(comm, bool(np.any(found.face != self.pairs.face)))
        if changed:
            self.pairs = found
            self._met.append(found.face)
        return changed

    def save(self) -> object:
        """Return the pairs, those of the step's start and all that follows from them."""
        return {name: getattr(self, name) for name in self._STATE}, list(self._met)

    def restore(self, saved: Any) -> None:
        """Put the pairs back with their version, which no other pairs ever have."""
        state, met = saved
        vars(self).update(state)
        self._met = list(met)

    def _returns(self, found: Pairs) -> npt.NDArray[np.bool_]:
        """Tell which nodes would go back to a face that they have met in this step."""
        before = np.any([found.face == face for face in self._met], axis=0)
        return np.asarray(before & (found.face != self.pairs.face))

    def _find(
        self,
        u: fem.Function,
        held: npt.NDArray[np.bool_],
        last: Pairs | None = None,
        keep: npt.ArrayLike = 0.0,
    ) -> Pairs:
        """Pair this rank's nodes at a displacement; collective."""
        x, own, face_x = self._secondary.positions(u), self._secondary.own, self._faces.positions(u)
        found = find_pairs(
            self._faces,
            face_x,
            x[own],
            self._secondary.node_normals(x)[own],
            self._policy,
            held,
            last,
            keep=keep,
            facing=self.facing,
        )
        return Pairs(np.where(self._gone(found, x, face_x), -1, found.face), found.xi)

    def _gone(self, found: Pairs, x: Array, face_x: Array) -> npt.NDArray[np.bool_]:
        """Tell which nodes have gone over an edge with all of the body that is beside them."""
        cell, corners, own = (
            self._faces.cell,
            face_x[self._faces.faces[found.face]],
            self._secondary.own,
        )
        over = blend(shape_matrix(cell, found.xi), corners)
        back = on_edges(cell, corners, over) - over
        back /= np.maximum(np.linalg.norm(back, axis=1, keepdims=True), np.finfo(float).tiny)
        inwards, size = self._inwards(x)[own], self._secondary.node_sizes()[own]
        outside = np.sum(back * inwards, axis=1) < -AT_EDGE * size
        return np.asarray(outside & (cell.overhang(found.xi) > self._policy.enter))

    def _inwards(self, x: Array) -> Array:
        """Return the way from each node to the mean of the middles of its faces (m)."""
        faces = self._secondary.faces
        middle, result, number = x[faces].mean(axis=1), np.zeros_like(x), np.zeros(len(x))
        for column in faces.T:
            np.add.at(result, column, middle)
            np.add.at(number, column, 1.0)
        return np.asarray(result / np.maximum(number, 1.0)[:, None] - x)


class FacePairs(FacesMet):
    """The pairs of nodes and faces of a deformable body within a step.

    Args:
        faces: The faces of the primary surface.
        secondary: The secondary surface.
        policy: How pairs are found.
        side: The secondary side.

    Attributes:
        pairs, start: See :class:`FacesMet`.
        old_xi: Reference coordinates on the old face of the point that was met there.
        version: Changes with the pairs.
    """

    _STATE = (*FacesMet._STATE, "_old_face", "old_xi", "version")
    _last_version = 0

    def nodes(self) -> npt.NDArray[np.int64]:
        """Return the primary nodes of each pair: of its face, then of its old face."""
        return np.hstack([self._faces.faces[self.pairs.face], self._faces.faces[self._old_face]])

    def anchor(self) -> None:
        """Pair the nodes at ``u_old`` and keep the points of the faces that they meet there."""
        super().anchor()
        self._place_old()

    def search(self) -> bool:
        """Look again for the faces at the current displacement; collective."""
        changed = super().search()
        if changed:
            self._place_old()
        return changed

    def _place_old(self) -> None:
        """Find the point that each node met at ``u_old``; collective.

        A node that met none there is traced back to its present face, extended. Later increments
        of slip start from there, whatever faces the node has crossed.
        """
        self.version = self._last_version = self._last_version + 1
        met = self.start.paired
        self._old_face = np.where(met, self.start.face, self.pairs.face)
        corners = self._faces.positions(self._side.u_old)[self._faces.faces[self._old_face]]
        x = self._secondary.positions(self._side.u_old)[self._secondary.own]
        xi = np.where(met[:, None], self.start.xi, self.pairs.xi)
        projected = project(self._faces.cell, corners, x, xi)
        self.old_xi = np.where(np.isfinite(projected), projected, xi)
