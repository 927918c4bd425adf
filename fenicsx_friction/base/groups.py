# SPDX-License-Identifier: MIT
"""Connected parts; largest values over groups of entries."""

import numpy as np
import numpy.typing as npt
import scipy

Array = npt.NDArray[np.floating]
Labels = npt.NDArray[np.int64]


def connected(n: int, a: Labels, b: Labels) -> tuple[int, Labels]:
    """Return the number of connected parts of a graph, and the part of each vertex."""
    graph = scipy.sparse.coo_array((np.ones(len(a)), (a, b)), shape=(n, n))
    number, part = scipy.sparse.csgraph.connected_components(graph.tocsr(), directed=False)
    return int(number), part.astype(np.int64)


class Groups:
    """Takes the largest value of each group of entries.

    Args:
        labels: Group of each entry, or -1 for entries that do not count.
        number: Number of groups.
    """

    def __init__(self, labels: Labels, number: int) -> None:
        self._number = number
        self._entries = np.argsort(labels, kind="stable")
        self._entries = self._entries[labels[self._entries] >= 0]
        ordered = labels[self._entries]
        self._starts = np.flatnonzero(np.diff(ordered, prepend=-1))
        self._groups = ordered[self._starts]

    def largest(self, values: Array) -> Array:
        """Return the largest of the (non-negative) values of each group, 0 where it is empty."""
        result = np.zeros(self._number)
        if len(self._starts):
            result[self._groups] = np.maximum.reduceat(values[self._entries], self._starts)
        return result
