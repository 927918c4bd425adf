# SPDX-License-Identifier: MIT
"""How displacements turn and move the forces of mortar contact.

A force turns with the normal of its patch and moves on the face that it presses. Neither depends on
the node that it belongs to: the derivatives of all nodes are added up over patches, and over pairs
of a patch and a face that it sees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from .facing import Facing
from .mortar_groups import Groups, adder, summed
from .segments import Segments

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class PointForces:
    """The forces at the points, and what they depend on.

    Attributes:
        force: Forces on the body (N).
        at: Shape functions of the own face.
        shapes: Those of the face that is seen.
        moved: Their derivatives by a motion of the point, along the normal of its patch.
        gap: Distances (m).
    """

    force: Array
    at: Array
    shapes: Array
    moved: Array
    gap: Array


class Turning:
    """The patches and pairs round this rank's nodes.

    Args:
        facing: The two surfaces.
        points: The points.
        groups: Their groups.

    Attributes:
        places: Dofs at the rows and columns of both kinds of blocks.
        patch_of_pair: The patch of each pair.
    """

    def __init__(self, facing: Facing, points: Segments, groups: Groups) -> None:
        secondary, primary, faces = facing.secondary, facing.primary, len(facing.primary.dofs)
        patches, self._to_patch = _adder(groups.corners.key)
        pairs, self._to_pair = _adder(groups.couples.key)
        self.patch_of_pair = pairs // faces
        own, at_pair = (secondary.dofs[secondary.face_of(p)] for p in (patches, self.patch_of_pair))
        face = primary.dofs[pairs % faces] + facing.num_secondary
        self.places = [(own, own), (face, np.hstack([face, at_pair]))]
        # The points are sorted by pairs: a row of them for each, as long as the longest.
        self._pair = np.searchsorted(pairs, points.patch * faces + points.face)
        number = np.bincount(self._pair, minlength=len(pairs))
        before = (np.cumsum(number) - number)[self._pair]
        self._place = np.arange(len(self._pair)) - before
        self._shape = (len(pairs), int(number.max(initial=0)))

    def of_patches(self, blocks: Array) -> Array:
        """Add blocks of corners up over patches: (patches, rows, columns)."""
        return _as_matrices(summed(self._to_patch, blocks))

    def of_pairs(self, turned: Array, points: PointForces, turns: Array) -> Array:
        """Return the blocks of pairs: (pairs, rows, columns).

        Args:
            turned: How the forces of couples turn, by the dofs of the patch.
            points: The forces at the points.
            turns: How the normal of the patch of each pair turns.
        """
        of_patch = summed(self._to_pair, turned)
        of_face = np.zeros((*of_patch.shape[:3], points.shapes.shape[1], of_patch.shape[4]))
        loaded = np.flatnonzero(np.bincount(self._pair, np.any(points.force != 0.0, axis=1)))
        if len(loaded):
            by_own, by_face, by_gap = self._moved(points, loaded)
            of_face[loaded] += by_face
            of_patch[loaded] += np.einsum("qbij,qjae->qbiae", by_gap, turns[loaded]) - by_own
        return _as_matrices(np.concatenate([of_face, of_patch], axis=3))

    def _moved(self, points: PointForces, pairs: Indices) -> list[Array]:
        """Return what motions of the points on the faces do to the forces there.

        Returns:
            By the dofs of the patch and of the face, (pairs, face dofs, d, dofs, d), and by the
            points themselves along the normal, (pairs, face dofs, d, d).
        """
        chosen = np.zeros(self._shape[0], dtype=bool)
        chosen[pairs] = True
        p = np.flatnonzero(chosen[self._pair])
        row, place = (np.cumsum(chosen) - 1)[self._pair[p]], self._place[p]
        weights = np.column_stack([points.at[p], points.shapes[p], points.gap[p]])
        (k, d), n = points.moved.shape[1:], points.at.shape[1]
        by_way = points.force[p][:, :, None] * points.moved[p].reshape(len(p), 1, k * d)
        of_pair = np.zeros((len(pairs), self._shape[1], weights.shape[1]))
        ways = np.zeros((len(pairs), self._shape[1], k * d * d))
        of_pair[row, place], ways[row, place] = weights, by_way.reshape(len(p), k * d * d)
        sums = (ways.transpose(0, 2, 1) @ of_pair).reshape(len(pairs), d, k, d, weights.shape[1])
        sums = sums.transpose(0, 2, 1, 3, 4)
        by_dofs = sums.transpose(0, 1, 2, 4, 3)
        return [by_dofs[:, :, :, :n], by_dofs[:, :, :, n:-1], sums[..., -1]]


def _adder(keys: Indices) -> tuple[Indices, scipy.sparse.csr_array]:
    """Return the keys that there are, and what adds rows up over them."""
    found, inverse = np.unique(keys, return_inverse=True)
    return found, adder(inverse.ravel(), len(found))


def _as_matrices(blocks: Array) -> Array:
    """Return blocks (n, rows, d, columns, d) as matrices."""
    n, rows, d, columns, _ = blocks.shape
    return blocks.reshape(n, rows * d, columns * d)
