# SPDX-License-Identifier: MIT
"""Kinematics and forces of nodes that meet another body on average, with exact derivatives.

A secondary point ``x`` with the normal ``n`` of its patch sees the primary point ``y``:
``x - y = g n``. Gap and slip of a node are averages over the points round it; the force of its
multipliers acts at the same points, opposite on both bodies. Which points there are, and what they
see, does not change here; where they see it does.

A *corner* is a node with a patch round it, a *couple* a node with a patch and a face that it sees.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ..surfaces.lagrange_faces import LagrangeFaces
from .face_frames import carried_frames, unit_normals
from .kinematics import slices
from .segments import Segments, cast, duals
from .shares import Shares

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Bodies:
    """The two surfaces.

    Attributes:
        secondary: The secondary one.
        primary: The primary one. Stencils number its dofs after those of the secondary one.
    """

    secondary: LagrangeFaces
    primary: LagrangeFaces


@dataclass(frozen=True)
class Sums:
    """Sums of points with their shares, over groups of points.

    Attributes:
        matrix: Groups by points.
        node: Node of each group.
        key: What else the points of each group have in common.
    """

    matrix: scipy.sparse.csr_array
    node: Indices
    key: Indices

    @classmethod
    def over(cls, shares: Shares, keys: Indices, points: int) -> Sums:
        """Sum over the points of a node that have a key in common; keys are those of shares."""
        number = int(keys.max(initial=0)) + 1
        groups, inverse = np.unique(shares.node * number + keys, return_inverse=True)
        entries = (shares.value, (inverse.ravel(), shares.point))
        matrix = scipy.sparse.csr_array(entries, shape=(len(groups), points))
        return cls(matrix, groups // number, groups % number)

    def __matmul__(self, values: Array) -> Array:
        """Return the sums of values at the points, (points, ...)."""
        flat = self.matrix @ values.reshape(len(values), -1)
        return np.asarray(flat.reshape(len(self.node), *values.shape[1:]))


class MortarElement:
    """The averages of this rank's nodes over given points.

    Args:
        bodies: The two surfaces.
        points: The points.
        old: Faces, and places on them, that the points saw at the last accepted displacement.
        shares: Shares of the points in the averages of this rank's nodes.
        own: Place of each node's own dof.

    Attributes:
        stencil: Dofs of both surfaces round each node, its own first, -1 for none.
    """

    def __init__(
        self,
        bodies: Bodies,
        points: Segments,
        old: tuple[Indices, Array],
        shares: Shares,
        own: Indices,
    ) -> None:
        self._bodies, self.points, self.shares, self.num_nodes = bodies, points, shares, len(own)
        number, patch = len(points.patch), points.patch[shares.point]
        faces = len(bodies.primary.dofs)
        self._corners = Sums.over(shares, patch, number)
        self._couples = Sums.over(shares, patch * faces + points.face[shares.point], number)
        self._corner_of = self._corner_at(self._couples.node, self._couples.key // faces)
        corner = self._corner_at(shares.node, patch)
        old_couples = Sums.over(shares, corner * faces + old[0][shares.point], number)
        self._old_corner = old_couples.key // faces
        self._at = bodies.secondary.shapes(points.xi)
        self._old_at = bodies.primary.shapes(old[1])
        self._old_dofs = bodies.primary.dofs[old[0]]
        self._shares_at = self._corners @ self._at
        self._old_shares = old_couples @ self._old_at
        offset = bodies.secondary.X.shape[0]
        dofs = [
            bodies.secondary.dofs[bodies.secondary.face_of(self._corners.key)],
            bodies.primary.dofs[self._couples.key % faces] + offset,
            bodies.primary.dofs[old_couples.key % faces] + offset,
        ]
        nodes = [self._corners.node, self._couples.node, old_couples.node]
        self._number_stencils(nodes, dofs, own)

    def _corner_at(self, node: Indices, patch: Indices) -> Indices:
        """Return the corners of nodes with patches."""
        number = len(self._bodies.secondary)
        keys = self._corners.node * number + self._corners.key
        return np.asarray(np.searchsorted(keys, node * number + patch))

    def _number_stencils(self, nodes: list[Indices], dofs: list[Indices], own: Indices) -> None:
        """Number the dofs round each node, and find the places of those of groups there."""
        n, most = self.num_nodes, len(self._bodies.secondary.X) + len(self._bodies.primary.X) + 1
        all_nodes = [
            np.arange(n),
            *(np.repeat(i, j.shape[1]) for i, j in zip(nodes, dofs, strict=True)),
        ]
        all_dofs = np.concatenate([own, *(j.ravel() for j in dofs)])
        node = np.concatenate(all_nodes)
        later = np.where(all_dofs == own[node], 0, 1 + all_dofs)
        unique, inverse = np.unique(node * most + later, return_inverse=True)
        starts = np.searchsorted(unique, np.arange(n) * most)
        place = np.arange(len(unique)) - starts[unique // most]
        self.stencil = np.full((n, int(place.max(initial=0)) + 1), -1)
        found = unique % most - 1
        self.stencil[unique // most, place] = np.where(found < 0, own[unique // most], found)
        ends = np.cumsum([n, *(j.size for j in dofs)])
        parts = np.split(place[inverse.ravel()], ends[:-1])[1:]
        self._places = [part.reshape(j.shape) for part, j in zip(parts, dofs, strict=True)]
        self._nodes = nodes

    def widen(self, width: int) -> None:
        """Give the stencils a width, as on other ranks."""
        more = width - self.stencil.shape[1]
        self.stencil = np.pad(self.stencil, ((0, 0), (0, more)), constant_values=-1)

    # -- at a displacement -----------------------------------------------------------------------

    def evaluate(self, x: tuple[Array, Array], axis: Array, hint: Array) -> None:
        """Follow the surfaces.

        Args:
            x: Positions of the dofs of both (m).
            axis: Normals of the nodes whose frames are carried to the patches.
            hint: Vectors whose tangential parts are the first tangents.
        """
        secondary, primary, points = self._bodies.secondary, self._bodies.primary, self.points
        weights = np.tile(secondary.center_slopes(), (len(secondary.dofs), 1, 1))
        outward = np.repeat(secondary.outward, len(secondary.corners))
        normals, turns = unit_normals(secondary.tangents(x[0]), -outward, weights)
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

    @cached_property
    def _to_node(self) -> scipy.sparse.csr_array:
        """Adds corners to nodes."""
        number = len(self._corners.node)
        entries = (np.ones(number), (self._corners.node, np.arange(number)))
        return scipy.sparse.csr_array(entries, shape=(self.num_nodes, number))

    def values(self) -> Array:
        """Return the field of the nodes: averages, (nodes, entries)."""
        corners, frames, way = self._corners, self.frames, self._way_of_corner
        shares = corners @ np.ones(len(self.x))
        gap = corners @ self.gap
        slip = np.einsum("ckd,cd->ck", frames[:, 1:], way)
        directions = frames[:, : len(frames[0]) - 1].reshape(len(frames), -1) * shares[:, None]
        return np.asarray(
            self._to_node @ np.column_stack([gap, slip, directions, corners @ self.x])
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
        shares = (corners @ np.ones(len(self.x)))[:, None, None, None]
        for where, k in zip([normal, *first], range(d - 1), strict=True):
            block[:, :, where] = shares * turned[:, :, k]
        block[:, :, position] = self._shares_at[:, :, None, None] * np.eye(d)
        result = np.zeros((*self.stencil.shape, position.stop, d))
        self._add(result, 0, block)
        of_face = -(self._couples @ (self._shapes[:, :, None] * across[:, None]))
        self._add(result[:, :, gap.start], 1, of_face)
        old = self._old_shares[:, :, None, None] * self.frames[self._old_corner][:, None, 1:]
        self._add(result[:, :, slip], 2, -old)
        return result.transpose(0, 2, 1, 3)

    def _add(self, result: Array, group: int, blocks: Array) -> None:
        """Add blocks of groups (0 corners, 1 couples, 2 old ones) to rows of nodes."""
        np.add.at(result, (self._nodes[group][:, None], self._places[group]), blocks)

    def weights(self) -> Array:
        """Return the forces on the stencil of a unit force on each node, in one direction."""
        result = np.zeros(self.stencil.shape)
        self._add(result, 0, self._shares_at)
        self._add(result, 1, -self._couple_shapes)
        return result

    def levers(self) -> Array:
        """Return the forces of unit multipliers over what is covered: (nodes, d, stencil, d)."""
        d = self.frames.shape[1]
        result = np.zeros((*self.stencil.shape, d, d))
        self._add(result, 0, self._shares_at[:, :, None, None] * self.frames[:, None])
        frames = self.frames[self._corner_of]
        self._add(result, 1, -self._couple_shapes[:, :, None, None] * frames[:, None])
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
        own, face = self._places[0], self._places[1]
        blocks = self._shares_at[:, :, None, None, None] * turned[:, None]
        np.add.at(result, (node[:, None, None], own[:, :, None], own[:, None]), blocks)
        blocks = -self._couple_shapes[:, :, None, None, None] * turned[self._corner_of][:, None]
        at, beside = self._couples.node[:, None, None], own[self._corner_of][:, None]
        np.add.at(result, (at, face[:, :, None], beside), blocks)
        forces = self.point_forces(c)
        if np.any(forces):
            self._add_moved(result, forces)
        return result.transpose(0, 1, 3, 2, 4)

    def _add_moved(self, result: Array, forces: Array) -> None:
        """Add what follows from the places of the points on the primary surface, which change."""
        points, d = self.points, forces.shape[1]
        pairs, first, pair = np.unique(self._couples.key, return_index=True, return_inverse=True)
        faces = len(self._bodies.primary.dofs)
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

        own, face = self._places[0][self._corner_of[first]], self._places[1][first]
        for a in range(own.shape[1]):
            np.add.at(result, (node[:, None], face, own[:, a, None]), -block(self._at[:, a]))
        for b in range(k):
            np.add.at(result, (node[:, None], face, face[:, b, None]), block(self._shapes[:, b]))
        across = block(self.gap)
        turns = self._turns[self._corner_of[first]]
        turned = np.einsum("qbij,qjae->qabie", across, turns)
        for a in range(own.shape[1]):
            np.add.at(result, (node[:, None], face, own[:, a, None]), turned[:, a])
