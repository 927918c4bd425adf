# SPDX-License-Identifier: MIT
"""Kinematics and forces of nodes that meet another body on average, with exact derivatives.

A secondary point ``x`` with the normal ``n`` of its patch sees the primary point ``y``:
``x - y = g n``. Gap and slip of a node are averages over the points round it; the force of its
multipliers acts at the same points, opposite on both bodies. Which points there are, and what they
see, does not change here; where they see it does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.sparse

from .face_frames import carried_frames, unit_normals
from .facing import Facing, Positions
from .kinematics import slices
from .mortar_groups import Groups
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
        self._corners, self._couples = groups.corners, groups.couples
        self._at, self._old_at = facing.secondary.shapes(points.xi), facing.primary.shapes(old[1])
        self._old_dofs = facing.primary.dofs[old[0]]
        self._shares_at = groups.corners @ self._at
        self._old_shares = groups.old @ self._old_at
        self._sums = groups.corners @ np.ones(len(points.patch))

    @property
    def stencil(self) -> Indices:
        """Dofs of both surfaces round each node, its own first, -1 for none."""
        return self._groups.stencil

    def widen(self, width: int) -> None:
        """Give the stencils a width, as on other ranks."""
        more = width - self.stencil.shape[1]
        self._groups.stencil = np.pad(self.stencil, ((0, 0), (0, more)), constant_values=-1)

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
        self._turns = turns[patch]
        self._by_normal = by_normal
        normal = normals[points.patch]
        dofs = secondary.dofs[secondary.face_of(points.patch)]
        self.x = np.einsum("pa,pad->pd", self._at, x[0][dofs])
        eta, gap = cast(primary, x[1], points.face, self.x, normal, points.eta)
        self.failed = ~np.isfinite(gap)
        eta[self.failed] = points.eta[self.failed]
        self.gap = np.where(self.failed, 0.0, gap)
        self._shapes, self._slopes = primary.shapes(eta), primary.slopes(eta)
        tangents = np.einsum("pta,pad->ptd", self._slopes, x[1][primary.dofs[points.face]])
        self._duals = duals(tangents, normal)
        self._way = self.x - np.einsum("pa,pad->pd", self._old_at, x[1][self._old_dofs])
        self._way_of_corner = corners @ self._way
        self._couple_shapes = self._couples @ self._shapes

    def values(self) -> Array:
        """Return the field of the nodes: averages, (nodes, entries)."""
        corners, frames, way = self._corners, self.frames, self._way_of_corner
        gap = corners @ self.gap
        slip = np.einsum("ckd,cd->ck", frames[:, 1:], way)
        d = frames.shape[1]
        directions = frames[:, : d - 1].reshape(len(frames), (d - 1) * d) * self._sums[:, None]
        return np.asarray(
            self._groups.to_node @ np.column_stack([gap, slip, directions, corners @ self.x])
        )

    def slopes(self) -> Array:
        """Return the derivatives of the field: (nodes, entries, stencil, d)."""
        d, corners = self.frames.shape[1], self._corners
        gap, slip, normal, *first, position = (slice(*where) for where in slices(d))
        across, turns = self._duals[:, -1], self._turns
        block = np.zeros((*turns.shape[:1], turns.shape[2], position.stop, d))  # by dof, entry, d
        by_x = corners @ (self._at[:, :, None] * across[:, None])
        lost = corners @ (self.gap[:, None] * across)
        block[:, :, gap.start] = by_x - np.einsum("cd,cdae->cae", lost, turns)
        block[:, :, slip] = self._shares_at[:, :, None, None] * self.frames[:, None, 1:]
        turned = np.einsum("ckij,cjae->cakie", self._by_normal, turns)
        block[:, :, slip] += np.einsum("ci,cakie->cake", self._way_of_corner, turned[:, :, 1:])
        shares = self._sums[:, None, None, None]
        for where, k in zip([normal, *first], range(d - 1), strict=True):
            block[:, :, where] = shares * turned[:, :, k]
        block[:, :, position] = self._shares_at[:, :, None, None] * np.eye(d)
        result = np.zeros((*self.stencil.shape, position.stop, d))
        self._groups.add(result, 0, block)
        of_face = -(self._couples @ (self._shapes[:, :, None] * across[:, None]))
        self._groups.add(result[:, :, gap.start], 1, of_face)
        old = self._old_shares[:, :, None, None] * self.frames[self._groups.old_corner][:, None, 1:]
        self._groups.add(result[:, :, slip], 2, -old)
        return result.transpose(0, 2, 1, 3)

    def weights(self) -> Array:
        """Return the forces on the stencil of a unit force on each node, in one direction."""
        result = np.zeros(self.stencil.shape)
        self._groups.add(result, 0, self._shares_at)
        self._groups.add(result, 1, -self._couple_shapes)
        return result

    def levers(self) -> Array:
        """Return the forces of unit multipliers over what is covered: (nodes, d, stencil, d)."""
        d = self.frames.shape[1]
        result = np.zeros((*self.stencil.shape, d, d))
        self._groups.add(result, 0, self._shares_at[:, :, None, None] * self.frames[:, None])
        frames = self.frames[self._groups.corner]
        self._groups.add(result, 1, -self._couple_shapes[:, :, None, None] * frames[:, None])
        return result.transpose(0, 2, 1, 3)

    def point_forces(self, c: Array) -> Array:
        """Return the forces on the body at the points (N), of this rank's nodes."""
        node = self._corners.node
        of_corner = np.einsum("ck,ckd->cd", c[node], self.frames)
        of_corner *= self.shares.covered[node][:, None]
        return np.asarray(self._corners.matrix.T @ of_corner)

    def turning(self, c: Array) -> Array:
        """Return how the stencil turns the forces over what is covered: (nodes, m, d, m, d).

        What the displacement of points on the primary surface does is put down to one node of each
        pair of a patch and a face.
        """
        (n, m), d = self.stencil.shape, self.frames.shape[1]
        result = np.zeros((n, m, m, d, d))
        node = self._corners.node
        by_normal = np.einsum("ck,ckij->cij", c[node], self._by_normal)
        turned = np.einsum("cij,cjae->caie", by_normal, self._turns)
        own, face = self._groups.places[0], self._groups.places[1]
        blocks = self._shares_at[:, :, None, None, None] * turned[:, None]
        np.add.at(result, (node[:, None, None], own[:, :, None], own[:, None]), blocks)
        blocks = -self._couple_shapes[:, :, None, None, None] * turned[self._groups.corner][:, None]
        at, beside = self._couples.node[:, None, None], own[self._groups.corner][:, None]
        np.add.at(result, (at, face[:, :, None], beside), blocks)
        forces = self.point_forces(c)
        if np.any(forces):
            self._add_moved(result, forces)
        return result.transpose(0, 1, 3, 2, 4)

    def _add_moved(self, result: Array, forces: Array) -> None:
        """Add what follows from the places of the points on the primary surface, which change."""
        points, d = self.points, forces.shape[1]
        pairs, first = np.unique(self._couples.key, return_index=True)
        faces = len(self._facing.primary.dofs)
        of_point = np.searchsorted(pairs, points.patch * faces + points.face)
        loaded = np.flatnonzero(np.any(forces != 0.0, axis=1))
        entries = (np.ones(len(loaded)), (of_point[loaded], loaded))
        add = scipy.sparse.csr_array(entries, shape=(len(pairs), len(forces)))
        node = self._couples.node[first]
        over = 1.0 / self.shares.covered[node][:, None]
        moved = np.einsum("pkb,pke->pbe", self._slopes, self._duals[:, :-1])
        by_way = (forces[:, None, :, None] * moved[:, :, None]).reshape(len(forces), -1)
        k = moved.shape[1]

        def block(weights: Array) -> Array:
            """Return the sums of a weight of the points: (pairs, face dofs, d, d)."""
            return ((add @ (weights[:, None] * by_way)) * over).reshape(-1, k, d, d)

        own, face = (
            self._groups.places[0][self._groups.corner[first]],
            self._groups.places[1][first],
        )
        for a in range(own.shape[1]):
            np.add.at(result, (node[:, None], face, own[:, a, None]), -block(self._at[:, a]))
        for b in range(k):
            np.add.at(result, (node[:, None], face, face[:, b, None]), block(self._shapes[:, b]))
        across = block(self.gap)
        turns = self._turns[self._groups.corner[first]]
        turned = np.einsum("qbij,qjae->qabie", across, turns)
        for a in range(own.shape[1]):
            np.add.at(result, (node[:, None], face, own[:, a, None]), turned[:, a])
