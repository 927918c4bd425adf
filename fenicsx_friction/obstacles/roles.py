# SPDX-License-Identifier: MIT
"""Roles: which nodes of a surface that meets itself are secondary?

Where two places of a surface face each other, either could meet the other one. Both at once would
be too much: each pair of places is to meet once. Of two bodies, one is secondary: that whose nodes
press already, or the one with the finer faces where they face each other. On one body, roles spread
from node to node: from those that press already, then from the finest place, over fine places
first. A node that would meet nodes that meet its body, for the larger part, meets nothing itself.
So one side of a fold is secondary, and stays so while the fold moves on; where roles come from two
ends, they change within half a face, without a hole.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush

import numpy as np
import numpy.typing as npt
import scipy

from ..surfaces.faces import Faces, order_of_places

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

#: Nodes nearer to their foot than by this part of a face are equally near.
CLOSE = 0.05
#: A node meets nothing if it would meet secondary nodes by this share.
MOSTLY = 0.5


class Roles:
    """Chooses the secondary nodes of a surface that meets itself.

    The choice depends on places in the undeformed body, not on numbers of nodes: it is the same on
    any number of ranks.

    Args:
        faces: The faces of the surface.
        body: Body of each node.
    """

    def __init__(self, faces: Faces, body: Indices) -> None:
        corners, number = faces.faces, len(faces.X)
        width = corners.shape[1]
        i, j = np.repeat(corners, width, axis=1).ravel(), np.tile(corners, width).ravel()
        beside = scipy.sparse.csr_array((np.ones(len(i)), (i, j)), shape=(number, number))
        self._corners, self._body = corners, body
        self._order = order_of_places(faces.X, faces.X, faces.node_normals(faces.X))
        self._sizes, self._face_sizes = faces.node_sizes(), faces.sizes
        self._neighbours = [
            sorted(beside.indices[a:b], key=self._order.__getitem__)
            for a, b in zip(beside.indptr[:-1], beside.indptr[1:], strict=True)
        ]
        number = int(np.max(body, initial=0)) + 1
        self._first = np.full(number, len(body))
        np.minimum.at(self._first, body, self._order)

    def secondary(self, face: Indices, shapes: Array, distance: Array, held: Mask) -> Mask:
        """Tell which nodes meet the faces before them.

        Args:
            face: The face that each node of the surface has before it, or -1.
            shapes: The shape functions of its nodes at the node's foot.
            distance: From there to the node (m).
            held: Nodes that were secondary so far.
        """
        ratio = np.where(face >= 0, np.round(self._sizes / self._face_sizes[face], 3), np.inf)
        open_ = (face >= 0) & ~self._of_primary_bodies(face, distance, held)
        result = np.zeros(len(face), dtype=bool)
        met = np.where(face >= 0, self._body[self._corners[face, 0]], -1)
        # What presses first, and what roles reach from there; then the next place to start from.
        queue = [(0, 0.0, self._order[i], i) for i in np.flatnonzero(open_ & held)]
        queue += [(1, ratio[i], self._order[i], i) for i in np.flatnonzero(open_)]
        heapify(queue)
        while queue:
            *_, node = heappop(queue)
            if not open_[node]:
                continue
            open_[node] = False
            foot = self._corners[face[node]]
            if shapes[node] @ (result[foot] & (met[foot] == self._body[node])) < MOSTLY:
                result[node] = True
                for i in self._neighbours[node]:
                    heappush(queue, (0, ratio[i], self._order[i], i))
        return result

    def _of_primary_bodies(self, face: Indices, distance: Array, held: Mask) -> Mask:
        """Tell which nodes face a body that is to meet theirs, and not the other way round."""
        node = np.flatnonzero(face >= 0)
        ours, theirs = self._body[node], self._body[self._corners[face[node], 0]]
        node, ours, theirs = (values[ours != theirs] for values in (node, ours, theirs))
        both = np.sort(np.column_stack([ours, theirs]), axis=1)
        pairs, pair = np.unique(both, axis=0, return_inverse=True)
        pair, lower = pair.ravel(), ours == both[:, 0]
        number = (len(pairs), 2)
        votes, sizes, weights = (np.zeros(number) for _ in range(3))
        # Sizes count where the bodies meet first.
        weight = (CLOSE + distance[node] / np.mean(self._face_sizes)) ** -2
        place = (pair, np.where(lower, 0, 1))
        np.add.at(votes, place, held[node])
        np.add.at(sizes, place, weight * self._sizes[node])
        np.add.at(weights, place, weight)
        mean = np.full(number, np.inf)
        np.divide(sizes, weights * np.mean(self._face_sizes), out=mean, where=weights > 0.0)
        mean = np.round(mean, 3)
        keys = (self._first[pairs], mean, -votes)
        best = np.array([np.lexsort([k[n] for k in keys])[0] for n in range(len(pairs))], dtype=int)
        result = np.zeros(len(face), dtype=bool)
        result[node] = place[1] != best[pair]
        return result
