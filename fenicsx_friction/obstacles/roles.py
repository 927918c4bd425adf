# SPDX-License-Identifier: MIT
"""Roles: which nodes of a surface that meets itself are secondary?

Where two places of a surface face each other, either could meet the other one. Both at once would
be too much: each pair of places is to meet once. So the nodes of a face that is met meet nothing
themselves. Roles spread from node to node: from those that are closed already, then from the finest
place, so that one side of a fold is secondary as a whole, and stays so while the fold moves on.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ..surfaces.faces import Faces, order_of_places

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


class Roles:
    """Chooses the secondary nodes of a surface that meets itself.

    The choice depends on places in the undeformed body, not on numbers of nodes: it is the same on
    any number of ranks.

    Args:
        faces: The faces of the surface.
    """

    def __init__(self, faces: Faces) -> None:
        corners, number = faces.faces, len(faces.X)
        width = corners.shape[1]
        i, j = np.repeat(corners, width, axis=1).ravel(), np.tile(corners, width).ravel()
        beside = scipy.sparse.csr_array((np.ones(len(i)), (i, j)), shape=(number, number))
        self._corners = corners
        self._order = order_of_places(faces.X, faces.X, faces.node_normals(faces.X))
        self._sizes, self._face_sizes = faces.node_sizes(), faces.sizes
        self._neighbours = [
            sorted(beside.indices[a:b], key=self._order.__getitem__)
            for a, b in zip(beside.indptr[:-1], beside.indptr[1:], strict=True)
        ]

    def secondary(self, face: Indices, held: Mask) -> Mask:
        """Tell which nodes meet the faces before them.

        Args:
            face: The face that each node of the surface has before it, or -1.
            held: Nodes that were secondary so far.
        """
        partners = [set(self._corners[f]) if f >= 0 else set() for f in face]
        open_ = face >= 0
        result: set[int] = set()
        self._spread(self._sorted(np.flatnonzero(open_ & held)), partners, open_, result)
        left = np.flatnonzero(open_)
        ratio = np.round(self._sizes[left] / self._face_sizes[face[left]], 3)
        for seed in left[np.lexsort((self._order[left], ratio))]:
            self._spread([seed], partners, open_, result)
        chosen = np.zeros(len(face), dtype=bool)
        chosen[list(result)] = True
        return chosen

    def _sorted(self, nodes: Indices) -> Indices:
        """Return nodes in the order of their places."""
        return nodes[np.argsort(self._order[nodes])]

    def _spread(
        self, start: Iterable[int], partners: list[set[int]], open_: Mask, result: set[int]
    ) -> None:
        """Make nodes secondary, and their neighbours in turn, unless what they meet already is."""
        queue = deque(start)
        while queue:
            node = queue.popleft()
            if not open_[node]:
                continue
            open_[node] = False
            if partners[node].isdisjoint(result):
                result.add(node)
                queue.extend(self._neighbours[node])
