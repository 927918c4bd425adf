# SPDX-License-Identifier: MIT
"""Groups of points that count together in the averages of nodes, and the dofs that they touch.

A *corner* is a node with a patch round it, a *couple* a node with a patch and a face that it sees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy

from .facing import Facing
from .segments import Segments
from .shares import Shares

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Sums:
    """Sums of points with their shares, over groups of points.

    Attributes:
        of_gap: Groups by points, of shares in gaps.
        of_slip: The same of shares in slips and forces.
        node: Node of each group, ascending.
        key: What else the points of each group have in common, ascending for each node.
        group: The group of each share.
    """

    of_gap: scipy.sparse.csr_array
    of_slip: scipy.sparse.csr_array
    node: Indices
    key: Indices
    group: Indices

    @classmethod
    def over(cls, shares: Shares, keys: Indices, points: int) -> Sums:
        """Sum over the points of a node that have a key in common; keys are those of shares."""
        number = int(keys.max(initial=0)) + 1
        groups, group = np.unique(shares.node * number + keys, return_inverse=True)
        return cls._of(shares, points, groups // number, groups % number, group.ravel())

    def coarser(self, shares: Shares, keys: Indices) -> tuple[Sums, Indices]:
        """Return sums over groups of these groups, and the larger group of each.

        Args:
            shares: Those that the sums were made of.
            keys: What groups have in common, ascending for each node.
        """
        first = np.ones(len(keys), dtype=bool)
        first[1:] = (np.diff(self.node) != 0) | (np.diff(keys) != 0)
        larger, points = np.cumsum(first) - 1, self.of_gap.shape[1]
        sums = self._of(shares, points, self.node[first], keys[first], larger[self.group])
        return sums, larger

    @classmethod
    def _of(cls, shares: Shares, points: int, node: Indices, key: Indices, group: Indices) -> Sums:
        """Sum over the shares of each group."""
        number, shape = len(group), (len(node), points)
        ones = (np.ones(number, dtype=np.int8), group, np.arange(number + 1))
        sorted_ = scipy.sparse.csr_array(ones, shape=(number, len(node))).tocsc()
        order, ends = sorted_.indices, sorted_.indptr
        of_gap, of_slip = (
            scipy.sparse.csr_array((v[order], shares.point[order], ends), shape=shape)
            for v in shares.values
        )
        return cls(of_gap, of_slip, node, key, group)

    def gaps(self, values: Array) -> Array:
        """Return the sums of values at the points, (points, ...), with their shares in gaps."""
        return summed(self.of_gap, values)

    def slips(self, values: Array) -> Array:
        """Return the same with their shares in slips and forces."""
        return summed(self.of_slip, values)


def adder(group: Indices, number: int) -> scipy.sparse.csr_array:
    """Return the matrix that adds rows up over so many groups, from the group of each row."""
    entries = (np.ones(len(group)), (group, np.arange(len(group))))
    return scipy.sparse.csr_array(entries, shape=(number, len(group)))


def summed(matrix: scipy.sparse.csr_array, values: Array) -> Array:
    """Return a matrix times arrays of any shape."""
    flat = matrix @ values.reshape(len(values), math.prod(values.shape[1:]))
    return np.asarray(flat.reshape(matrix.shape[0], *values.shape[1:]))


class Groups:
    """The groups of this rank's nodes.

    Args:
        facing: The two surfaces.
        points: The points.
        old_face: The face that each point saw at the last accepted displacement.
        shares: Shares of the points in the averages of this rank's nodes.
        own: Place of each node's own dof.

    Attributes:
        corners: Sums over nodes and patches.
        couples: Sums over nodes, patches and the faces that they see.
        old: Sums over nodes, patches and the faces that they saw.
        corner: The corner of each couple.
        old_corner: That of each old one.
        stencil: Dofs of both surfaces round each node, its own first, -1 for none.
        places: Where the dofs of corners, couples and old ones are in it.
    """

    def __init__(
        self,
        facing: Facing,
        points: Segments,
        old_face: Indices,
        shares: Shares,
        own: Indices,
    ) -> None:
        number, patch, self._num_nodes = len(points.patch), points.patch[shares.point], len(own)
        secondary, primary = facing.secondary, facing.primary
        faces, offset = len(primary.dofs), facing.num_secondary
        self.couples = Sums.over(shares, patch * faces + points.face[shares.point], number)
        self.corners, self.corner = self.couples.coarser(shares, self.couples.key // faces)
        corner = self.corners.group
        self.old = Sums.over(shares, corner * faces + old_face[shares.point], number)
        self.old_corner = self.old.key // faces
        self._nodes = [self.corners.node, self.couples.node, self.old.node]
        dofs = [
            secondary.dofs[secondary.face_of(self.corners.key)],
            primary.dofs[self.couples.key % faces] + offset,
            primary.dofs[self.old.key % faces] + offset,
        ]
        self._number_stencils(dofs, own, offset + facing.num_primary)

    def _number_stencils(self, dofs: list[Indices], own: Indices, most: int) -> None:
        """Number the dofs round each node, and find the places of those of groups there."""
        n = len(own)
        around = [np.repeat(i, j.shape[1]) for i, j in zip(self._nodes, dofs, strict=True)]
        node = np.concatenate([np.arange(n), *around])
        dof = np.concatenate([own, *(j.ravel() for j in dofs)])
        later = np.where(dof == own[node], 0, 1 + dof)  # the node's own comes first
        unique, inverse = np.unique(node * (most + 1) + later, return_inverse=True)
        of_node = unique // (most + 1)
        place = np.arange(len(unique)) - np.searchsorted(of_node, of_node)
        self.stencil = np.full((n, int(place.max(initial=0)) + 1), -1)
        found = unique % (most + 1) - 1
        self.stencil[of_node, place] = np.where(found < 0, own[of_node], found)
        ends = np.cumsum([n, *(j.size for j in dofs)])[:-1]
        parts = np.split(place[inverse.ravel()], ends)[1:]
        self.places = [part.reshape(j.shape) for part, j in zip(parts, dofs, strict=True)]

    @cached_property
    def to_node(self) -> scipy.sparse.csr_array:
        """Adds corners to nodes."""
        return adder(self.corners.node, self._num_nodes)

    def on_stencils(self, group: int, blocks: Array) -> Array:
        """Add blocks of groups (0 corners, 1 couples, 2 old ones) up: (nodes, stencil, ...)."""
        shape = blocks.shape[2:]
        flat = blocks.reshape(blocks.shape[0] * blocks.shape[1], math.prod(shape))
        return np.asarray((self._to_stencil[group] @ flat).reshape(*self.stencil.shape, *shape))

    @cached_property
    def _to_stencil(self) -> list[scipy.sparse.csr_array]:
        """Adds rows of the dofs of groups to rows of the stencils, once these have their width."""
        (n, m), found = self.stencil.shape, []
        for node, places in zip(self._nodes, self.places, strict=True):
            found.append(adder((node[:, None] * m + places).ravel(), n * m))
        return found
