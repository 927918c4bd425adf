# SPDX-License-Identifier: MIT
"""Shares of points in the averages of nodes, on surfaces of which a part is covered.

Where little of a node's test function is covered, it is added to those of the nodes beside: none of
the remaining nodes is small, none has a negative weight, and their sum is one on all that is
covered. (``hats`` are these functions here, dual or not.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

#: A node gives its hat away if less than this part of it is covered; and takes it back only at the
#: second, so that it does not change to and fro.
SMALL, LARGE = 0.05, 0.06


@dataclass(frozen=True)
class Shares:
    """The shares, one entry for each node and each point of its average, by node and point.

    Attributes:
        node, point: As said.
        value: The shares; those of a node add up to one.
        covered: What is covered of the test function of each node (m²), zero without one.
    """

    node: Indices
    point: Indices
    value: Array
    covered: Array


def find_shares(
    face_nodes: Indices, face: Indices, weights: Array, full: Array, kept_before: Mask
) -> Shares:
    """Return the shares of all nodes.

    Args:
        face_nodes: The nodes of each face.
        face: The face of each point.
        weights: Hats of the face's nodes at the points, times the area of the points.
        full: The integrals of the whole hats (m²).
        kept_before: Nodes that had a test function so far.
    """
    n, points = len(full), len(face)
    node, point = face_nodes[face].ravel(), np.repeat(np.arange(points), face_nodes.shape[1])
    hats = scipy.sparse.csr_array((weights.ravel(), (node, point)), shape=(n, points))
    covered = np.asarray(np.bincount(node, weights.ravel(), minlength=n), dtype=float)
    least = np.where(kept_before, SMALL, LARGE)
    small = (covered > 0.0) & (covered < least * full)
    if np.any(small):
        hats = (_given_away(face_nodes[np.unique(face)], covered, small) @ hats).tocsr()
        covered = hats.sum(axis=1)
    hats.sort_indices()
    found = hats.tocoo()
    row, column = found.coords
    return Shares(row, column, found.data / covered[row], covered)


def _given_away(face_nodes: Indices, covered: Array, small: Mask) -> scipy.sparse.csr_array:
    """Return the matrix that gives the hats of small nodes to nodes beside them."""
    n, corners = len(covered), face_nodes.shape[1]
    i, j = np.repeat(face_nodes, corners, axis=1).ravel(), np.tile(face_nodes, corners).ravel()
    beside = scipy.sparse.csr_array((np.ones(len(i)), (i, j)), shape=(n, n)).tocoo()
    i, j = (a[(beside.data > 0.0)] for a in beside.coords)
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
    rows, columns = np.concatenate([j, alone]), np.concatenate([i, alone])
    values = np.concatenate([covered[j] / total[i], np.ones(len(alone))])
    return scipy.sparse.csr_array((values, (rows, columns)), shape=(n, n))
