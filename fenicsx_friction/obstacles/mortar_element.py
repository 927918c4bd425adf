# SPDX-License-Identifier: MIT
"""Kinematics and forces of nodes that meet another body on average, with exact derivatives.

A secondary point ``x`` with the normal ``n`` of its patch sees the primary point ``y``:
``x - y = g n``. Gap and slip of a node are averages over the points round it, each with shares of
its own. The force of its multipliers acts at the same points, by the shares of slips, opposite on
both bodies. Which points there are, and what they see, does not change here; where they see it
does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .face_frames import carried_frames, unit_normals
from .facing import Facing, Positions
from .kinematics import slices
from .mortar_groups import Groups
from .mortar_turning import PointForces, Turning
from .old_points import points_before
from .rays import cast, duals
from .segments import Segments
from .shares import Shares

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


class MortarElement:
    """The averages of this rank's nodes over given points.

    Args:
        facing: The two surfaces.
        points: The points.
        old: Faces, and places on them, that the points saw at the last accepted displacement.
        shares: Shares of the points in the averages of this rank's nodes.
        own: Place of each node's own dof.
    """

    def __init__(
        self,
        facing: Facing,
        points: Segments,
        old: tuple[Indices, Array],
        shares: Shares,
        own: Indices,
    ) -> None:
        self._facing, self.points, self.shares = facing, points, shares
        self._groups = groups = Groups(facing, points, old[0], shares, own)
        self._turning = Turning(facing, points, groups)
        self._corners, self._couples = groups.corners, groups.couples
        self._at, old_at = facing.secondary.shapes(points.xi), facing.primary.shapes(old[1])
        own_face = facing.secondary.face_of(points.patch)
        self._on_own = facing.secondary.interpolation(own_face, self._at)
        self._on_old = facing.primary.interpolation(old[0], old_at)
        self._gap_shares = groups.corners.gaps(self._at)
        self._shares_at = groups.corners.slips(self._at)
        self._old_shares = groups.old.slips(old_at)
        self._sums = groups.corners.gaps(np.ones(len(points.patch)))
        self._found_duals: Array | None = None
        self._acted: tuple[Array, Array] | None = None

    @classmethod
    def over(
        cls,
        facing: Facing,
        points: Segments,
        before: tuple[Positions, Segments],
        shares: Shares,
        own: Indices,
    ) -> MortarElement:
        """Return the averages over those of the points that have shares.

        Args:
            facing: The two surfaces.
            points: The points.
            before: Positions at the last accepted displacement, and what was seen there.
            shares: Shares of the points in the averages of this rank's nodes.
            own: Place of each node's own dof.
        """
        shares, used = shares.renumbered()
        points = points.take(used)
        old = points_before(facing, points, *before)
        return cls(facing, points, old, shares, own)

    @property
    def stencil(self) -> Indices:
        """Dofs of both surfaces round each node, its own first, -1 for none."""
        return self._groups.stencil

    def widen(self, width: int) -> None:
        """Give the stencils a width, as on other ranks."""
        more = width - self.stencil.shape[1]
        self._groups.stencil = np.pad(self.stencil, ((0, 0), (0, more)), constant_values=-1)

    def couples(self) -> tuple[Indices, Indices]:
        """Return nodes and the vertices of the faces that they see."""
        corners = self._facing.primary.nodes[self.points.face[self.shares.point]]
        return np.repeat(self.shares.node, corners.shape[1]), corners.ravel()

    # -- at a displacement -----------------------------------------------------------------------

    def evaluate(self, x: Positions, axis: Array, hint: Array) -> None:
        """Follow the surfaces.

        Args:
            x: Positions of the dofs of both (m).
            axis: Normals of the nodes whose frames are carried to the patches.
            hint: Vectors whose tangential parts are the first tangents.
        """
        secondary, primary, points = self._facing.secondary, self._facing.primary, self.points
        weights = np.tile(secondary.center_slopes, (len(secondary.dofs), 1, 1))
        normals, turns = unit_normals(secondary.tangents(x[0]), -secondary.signs, weights)
        corners = self._corners
        node, patch = corners.node, corners.key
        self.frames, by_normal = carried_frames(normals[patch], axis[node], hint[node])
        self._turns = turns
        self._by_normal = by_normal
        self._normal = normal = normals[points.patch]
        self.x = self._on_own @ x[0]
        eta, gap = cast(primary, x[1], points.face, self.x, normal, points.eta)
        self.failed = ~np.isfinite(gap)
        eta[self.failed] = points.eta[self.failed]
        self.gap = np.where(self.failed, 0.0, gap)
        table = primary.table(eta)
        self._shapes, self._slopes = table[:, 0], table[:, 1:]
        self._x, self._found_duals, self._acted = x[1], None, None
        self._way = self.x - self._on_old @ x[1]
        self._way_of_corner = corners.slips(self._way)
        self._couple_shapes = self._couples.slips(self._shapes)

    @property
    def _duals(self) -> Array:
        """The dual vectors of the tangents of the face that is seen and of the normal."""
        if self._found_duals is None:
            tangents = self._slopes @ self._facing.primary.at_dofs(self._x, self.points.face)
            self._found_duals = duals(tangents, self._normal)
        return self._found_duals

    def values(self) -> Array:
        """Return the field of the nodes: averages, (nodes, entries)."""
        corners, frames, way = self._corners, self.frames, self._way_of_corner
        gap = corners.gaps(self.gap)
        slip = np.einsum("ckd,cd->ck", frames[:, 1:], way)
        d = frames.shape[1]
        directions = frames[:, : d - 1].reshape(len(frames), (d - 1) * d) * self._sums[:, None]
        return np.asarray(
            self._groups.to_node @ np.column_stack([gap, slip, directions, corners.gaps(self.x)])
        )

    def tilts(self) -> Array:
        """Return how the normals at the points differ from those of the faces that they see."""
        seen = self._duals[:, -1]
        return np.asarray(self._normal - seen / np.linalg.norm(seen, axis=1, keepdims=True))

    def averages(self, values: Array) -> Array:
        """Return averages of what points have, (points, d), as those of gaps."""
        return np.asarray(self._groups.to_node @ self._corners.gaps(values))

    def slopes(self) -> Array:
        """Return the derivatives of the field: (nodes, entries, stencil, d)."""
        d, corners = self.frames.shape[1], self._corners
        gap, slip, normal, *first, position = (slice(*where) for where in slices(d))
        across, turns = self._duals[:, -1], self._turns[corners.key]
        block = np.zeros((*turns.shape[:1], turns.shape[2], position.stop, d))  # by dof, entry, d
        by_x = corners.gaps(self._at[:, :, None] * across[:, None])
        lost = corners.gaps(self.gap[:, None] * across)
        block[:, :, gap.start] = by_x - np.einsum("cd,cdae->cae", lost, turns)
        block[:, :, slip] = self._shares_at[:, :, None, None] * self.frames[:, None, 1:]
        turned = np.einsum("ckij,cjae->cakie", self._by_normal, turns)
        block[:, :, slip] += np.einsum("ci,cakie->cake", self._way_of_corner, turned[:, :, 1:])
        shares = self._sums[:, None, None, None]
        for where, k in zip([normal, *first], range(d - 1), strict=True):
            block[:, :, where] = shares * turned[:, :, k]
        block[:, :, position] = self._gap_shares[:, :, None, None] * np.eye(d)
        groups = self._groups
        result = groups.on_stencils(0, block)
        of_face = self._couples.gaps(self._shapes[:, :, None] * across[:, None])
        result[:, :, gap.start] -= groups.on_stencils(1, of_face)
        old = self._old_shares[:, :, None, None] * self.frames[groups.old_corner][:, None, 1:]
        result[:, :, slip] -= groups.on_stencils(2, old)
        return result.transpose(0, 2, 1, 3)

    def weights(self) -> Array:
        """Return the forces on the stencil of a unit force on each node, in one direction."""
        return self._acting(np.ones((len(self._corners.node), 1)))[:, :, 0]

    def levers(self) -> Array:
        """Return the forces of unit multipliers over what is covered: (nodes, d, stencil, d)."""
        (n, m), d = self.stencil.shape, self.frames.shape[1]
        levers = self._acting(self.frames.reshape(len(self.frames), d * d))
        return levers.reshape(n, m, d, d).transpose(0, 2, 1, 3)

    def forces(self, c: Array) -> Array:
        """Return the forces of multipliers over what is covered: (nodes, stencil, d)."""
        if self._acted is None or not np.array_equal(self._acted[0], c):
            self._acted = c.copy(), self._acting(self._of_corners(c))
        return self._acted[1]

    def _of_corners(self, c: Array) -> Array:
        """Return the tractions of multipliers in global axes at the corners (Pa)."""
        return np.asarray(np.einsum("ck,ckd->cd", c[self._corners.node], self.frames))

    def _acting(self, of_corner: Array) -> Array:
        """Return what acts on the stencils, opposite on both bodies, from what the corners have."""
        groups = self._groups
        own = self._shares_at[:, :, None] * of_corner[:, None]
        face = self._couple_shapes[:, :, None] * of_corner[groups.corner][:, None]
        return np.asarray(groups.on_stencils(0, own) - groups.on_stencils(1, face))

    def point_forces(self, c: Array) -> Array:
        """Return the forces on the body at the points (N), of this rank's nodes."""
        of_corner = self._of_corners(c) * self.shares.covered[self._corners.node][:, None]
        return np.asarray(self._corners.of_slip.T @ of_corner)

    def turned(self) -> list[tuple[Indices, Indices]]:
        """Return the dofs of the rows and columns of the blocks of :meth:`turning`."""
        return self._turning.places

    def turning(self, c: Array) -> list[Array]:
        """Return how displacements turn and move the forces (N/m), in blocks."""
        corners, couples, turning = self._corners, self._groups.corner, self._turning
        loads = c[corners.node] * self.shares.covered[corners.node][:, None]
        by_normal = np.einsum("ck,ckij->cij", loads, self._by_normal)
        turned = np.einsum("cij,cjae->ciae", by_normal, self._turns[corners.key])
        own = self._shares_at[:, :, None, None, None] * turned[:, None]
        face = -self._couple_shapes[:, :, None, None, None] * turned[couples][:, None]
        moved = self._slopes.transpose(0, 2, 1) @ self._duals[:, :-1]
        points = PointForces(self.point_forces(c), self._at, self._shapes, moved, self.gap)
        turns = self._turns[turning.patch_of_pair]
        return [turning.of_patches(own), turning.of_pairs(face, points, turns)]
