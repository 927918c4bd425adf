# SPDX-License-Identifier: MIT
"""Shares of points in the averages of nodes, on surfaces of which a part is covered.

Gaps are averages with the hats of the nodes, slips with functions that are
:mod:`dual <fenicsx_friction.obstacles.dual_hats>` to them, by which forces act, too.
Where little of a node's hat is covered, both functions are added to those of the nodes beside: none
of the remaining nodes is small, and the sum of each kind is one on all that is covered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .segments import ranges

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

#: A node gives its hat away if less than this part of it is covered; and takes it back only at the
#: second, so that it does not change to and fro.
SMALL, LARGE = 0.05, 0.06


@dataclass(frozen=True)
class Shares:
    """The shares of points in the averages of nodes.

    Attributes:
        node, point: Those of each share; a point may have several in one node.
        values: The shares in gap, and in slip and force, (2, shares); each kind adds up to one.
        covered: What is covered of the test functions of each node (m²), zero without one.
    """

    node: Indices
    point: Indices
    values: Array
    covered: Array

    def of_nodes(self, nodes: slice) -> Shares:
        """Return the shares of some nodes, numbered from the first of them."""
        mine = (self.node >= nodes.start) & (self.node < nodes.stop)
        node = self.node[mine] - nodes.start
        return Shares(node, self.point[mine], self.values[:, mine], self.covered[nodes])

    def renumbered(self) -> tuple[Shares, Indices]:
        """Return them by the numbers of the points among those that count; and these."""
        counts = np.bincount(self.point) > 0
        point = (np.cumsum(counts) - 1)[self.point]
        return Shares(self.node, point, self.values, self.covered), np.flatnonzero(counts)


def find_shares(
    face_nodes: Indices, face: Indices, weights: Array, full: Array, kept_before: Mask
) -> Shares:
    """Return the shares of all nodes.

    Args:
        face_nodes: The nodes of each face.
        face: The face of each point.
        weights: Hats and dual functions of the face's nodes at the points, times the area of the
            points: (2, points, nodes).
        full: The integrals of the whole hats (m²).
        kept_before: Nodes that had a test function so far.
    """
    n, corners = len(full), face_nodes.shape[1]
    node, point = face_nodes[face].ravel(), np.repeat(np.arange(len(face)), corners)
    values = weights.reshape(2, len(node))
    covered = np.asarray(np.bincount(node, values[0], minlength=n), dtype=float)
    least = np.where(kept_before, SMALL, LARGE)
    small = (covered > 0.0) & (covered < least * full)
    if np.any(small):
        giver, taker, part = _given_away(face_nodes[np.unique(face)], covered, small)
        rows, number = ranges(giver, node)
        point, node = np.repeat(point, number), taker[rows]
        values = np.repeat(values, number, axis=1) * part[rows]
        covered = np.asarray(np.bincount(node, values[0], minlength=n))
    return Shares(node, point, values / covered[node], covered)


def _given_away(face_nodes: Indices, covered: Array, small: Mask) -> tuple[Indices, Indices, Array]:
    """Return who gives functions (ascending), to whom, and which part; others keep their own."""
    n, corners = len(covered), face_nodes.shape[1]
    i, j = np.repeat(face_nodes, corners, axis=1).ravel(), np.tile(face_nodes, corners).ravel()
    i, j = np.divmod(np.unique(i * n + j), n)
    # Where all are small, the largest of them stays.
    largest = np.zeros(n)
    np.maximum.at(largest, i, np.where(i == j, 0.0, covered[j]))
    others = np.zeros(n, dtype=bool)
    np.logical_or.at(others, i, ~small[j] & (covered[j] > 0.0))
    stays = (covered > 0.0) & (~small | (~others & (covered >= largest)))
    gives = ~stays[i] & stays[j] & (covered[i] > 0.0)
    i, j = i[gives], j[gives]
    total = np.bincount(i, covered[j], minlength=n)
    alone = np.flatnonzero((covered > 0.0) & ((total == 0.0) | stays))
    giver, taker = np.concatenate([i, alone]), np.concatenate([j, alone])
    part = np.concatenate([covered[j] / total[i], np.ones(len(alone))])
    order = np.argsort(giver, kind="stable")
    return giver[order], taker[order], part[order]
