# SPDX-License-Identifier: MIT
"""Roles: which nodes of a surface that meets itself are secondary?

Where two places of a surface face each other, either could meet the other one. Both at once would
be too much: each pair of places is to meet once. Of two bodies, the finer one is secondary. On one
body, roles spread from node to node: from those that are closed already, then from the finest
place. A node that would meet a secondary node, for the larger part, meets nothing itself. So one
side of a fold is secondary, and stays so while the fold moves on; where roles come from two ends,
they change within half a face, without a hole.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
import scipy

from ..surfaces.faces import Faces, order_of_places

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

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
        self._rank = self._rank_bodies(faces.size)

    def _rank_bodies(self, size: float) -> Indices:
        """Return the place of each node's body in an order: finer ones first."""
        number = int(np.max(self._body, initial=0)) + 1
        of_face = self._body[self._corners[:, 0]]
        counts = np.maximum(np.bincount(of_face, minlength=number), 1)
        sizes = np.bincount(of_face, self._face_sizes, minlength=number) / counts
        first = np.full(number, len(self._body))
        np.minimum.at(first, self._body, self._order)
        rank = np.argsort(np.lexsort((first, np.round(sizes / size, 3))))
        return np.asarray(rank[self._body])

    def secondary(self, face: Indices, shapes: Array, held: Mask) -> Mask:
        """Tell which nodes meet the faces before them.

        Args:
            face: The face that each node of the surface has before it, or -1.
            shapes: The shape functions of its nodes at the node's foot.
            held: Nodes that were secondary so far.
        """
        open_ = (face >= 0) & (self._rank <= self._rank[self._corners[face, 0]])
        result = np.zeros(len(face), dtype=bool)
        self._spread(self._sorted(np.flatnonzero(open_ & held)), face, shapes, open_, result)
        left = np.flatnonzero(open_)
        ratio = np.round(self._sizes[left] / self._face_sizes[face[left]], 3)
        for seed in left[np.lexsort((self._order[left], ratio))]:
            self._spread([seed], face, shapes, open_, result)
        return result

    def _sorted(self, nodes: Indices) -> Indices:
        """Return nodes in the order of their places."""
        return nodes[np.argsort(self._order[nodes])]

    def _spread(
        self, start: Iterable[int], face: Indices, shapes: Array, open_: Mask, result: Mask
    ) -> None:
        """Make nodes secondary, and their neighbours in turn, unless what they meet already is."""
        queue = deque(start)
        while queue:
            node = queue.popleft()
            if not open_[node]:
                continue
            open_[node] = False
            met = self._corners[face[node]]
            if shapes[node] @ result[met] < MOSTLY:
                result[node] = True
                queue.extend(self._neighbours[node])
