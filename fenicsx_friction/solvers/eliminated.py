# SPDX-License-Identifier: MIT
"""What can be eliminated from the matrix of the boundary node by node, before it is factored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]

#: Rows, columns and values of blocks; entries at -1 are left out.
Block = tuple[Indices, Indices, Array]

#: The forces of a node's multipliers are regular if their determinant is more than this.
SOLVABLE = 1e-6
#: The rows that a node's displacement solves alone are regular if their pivots are more than this.
REGULAR = 1e-8


@dataclass(frozen=True)
class Elements:
    """The nodes of a contact, of all ranks, with their stencils.

    Attributes:
        q: Numbers of displacements, those of the node itself ahead; -1 for those that are
            prescribed or absent.
        c: Numbers of the multipliers.
        by_q: Derivatives of the rows of the law by the displacements.
        by_c: By the multipliers.
        forces: Derivatives of the balance of forces by the multipliers, at the first of ``q``.
    """

    q: Indices
    c: Indices
    by_q: Array
    by_c: Array
    forces: Array

    @property
    def loaded(self) -> Indices:
        """Numbers of the displacements on which the forces act."""
        return self.q[:, : self.forces.shape[1]]

    def take(self, nodes: npt.NDArray) -> Elements:
        """Return some nodes."""
        parts = (self.q, self.c, self.by_q, self.by_c, self.forces)
        return Elements(*(part[nodes] for part in parts))

    def blocks(self) -> list[Block]:
        """Return all blocks."""
        by_q, by_c = (self.c, self.q, self.by_q), (self.c, self.c, self.by_c)
        return [by_q, by_c, (self.loaded, self.c, self.forces)]

    def regular(self, counts: Indices) -> npt.NDArray[np.bool_]:
        """Tell which nodes are free, only in this element, and loaded by all their multipliers.

        Args:
            counts: In how many elements each displacement is.
        """
        d = self.c.shape[1]
        own, forces = self.q[:, :d], self.forces[:, :d]
        size = np.max(abs(forces), axis=(1, 2), initial=0.0)
        solvable = abs(np.linalg.det(forces)) > SOLVABLE * size**d
        free = solvable & np.all(own >= 0, axis=1) & np.all(self.c >= 0, axis=1)
        return np.asarray(free & np.all(counts[np.where(own >= 0, own, 0)] == 1, axis=1))


class EliminatedMultipliers:
    """The multipliers of a contact's regular nodes, eliminated by the forces on their own dofs.

    Args:
        part: The nodes of the contact.
        regular: Which nodes are regular.
        place: Where the unknowns are among those that are kept.
    """

    def __init__(self, part: Elements, regular: npt.NDArray[np.bool_], place: Indices) -> None:
        part, d = part.take(regular), part.c.shape[1]
        self.q, self.c = place[part.q], part.c
        self.own, self.others = self.q[:, :d], place[part.loaded[:, d:]]
        self.inverse = np.linalg.inv(part.forces[:, :d])
        self.slopes_of_q = part.by_q
        self.slopes = part.by_c @ self.inverse
        self._forces = part.forces[:, d:] @ self.inverse

    def times(self, balance: Array, there: npt.NDArray[np.bool_]) -> Array:
        """Return what the multipliers do in rows of the law.

        Args:
            balance: Rows of the balance of forces, of all that is kept.
            there: Which rows of the law, of each node.
        """
        node, row = np.nonzero(there)
        return np.asarray((self.slopes[node, row][:, None] @ balance[self.own[node]])[:, 0])

    def law(self, x: Array) -> Array:
        """Return what displacements do in the rows of the law."""
        values = np.where(self.q >= 0, x[self.q], 0.0)
        return np.asarray(np.einsum("nij,nj->ni", self.slopes_of_q, values))

    def reactions(self, size: int) -> scipy.sparse.csr_array:
        """Return what a force on each own dof does to the forces on the others."""
        own = np.arange(self.own.size).reshape(self.own.shape)
        i = np.broadcast_to(self.others[:, :, None], self._forces.shape)
        j = np.broadcast_to(own[:, None, :], self._forces.shape)
        there = i >= 0
        shape = (size, self.own.size)
        return scipy.sparse.csr_array((self._forces[there], (i[there], j[there])), shape=shape)

    def alone(self) -> npt.NDArray[np.bool_]:
        """Tell which rows of the law contain displacements of their own node only."""
        d = self.own.shape[1]
        others = np.any(self.slopes != 0.0, axis=2)
        return ~(others | np.any(self.slopes_of_q[:, :, d:] != 0.0, axis=2))


class KnownDirections:
    """Displacements that rows of the law give by themselves.

    A closed node stays at its gap, a sticking one where it is, whatever all others do: up to ``d``
    equations for the ``d`` displacements of a node. An orthonormal basis of each such node has
    first the directions that these equations give, then those that remain unknown.

    Args:
        steps: The multipliers of all contacts, eliminated.
        size: Number of unknowns that are kept.

    Attributes:
        others: Rows that are left.
    """

    def __init__(self, steps: Sequence[EliminatedMultipliers], size: int) -> None:
        d = steps[0].own.shape[1]
        own = np.concatenate([step.own for step in steps])
        slopes = np.concatenate([step.slopes_of_q[:, :, :d] for step in steps])
        alone = np.concatenate([step.alone() for step in steps])
        some = alone.any(axis=1)
        self._split(own[some], slopes[some], alone[some])
        self.others = _without(size, self._rows[self._given])
        self._plain = _without(size, self._own)
        self._size = size

    def _split(self, own: Indices, slopes: Array, alone: npt.NDArray[np.bool_]) -> None:
        """Find the bases of nodes that have such rows, and keep those that are regular."""
        order = np.argsort(~alone, axis=1, kind="stable")  # these rows first
        given = np.take_along_axis(alone, order, axis=1)
        rows = np.take_along_axis(slopes, order[:, :, None], axis=1) * given[:, :, None]
        length = np.linalg.norm(rows, axis=2)
        length[length == 0.0] = 1.0
        rows /= length[:, :, None]
        basis, upper = np.linalg.qr(rows.transpose(0, 2, 1))
        pivots = np.where(given, abs(np.einsum("nii->ni", upper)), 1.0)
        good = np.all(pivots > REGULAR, axis=1)
        self._own, self._rows = own[good], np.take_along_axis(own, order, axis=1)[good]
        self._given, self._length, self._basis = given[good], length[good], basis[good]
        self._lower = upper.transpose(0, 2, 1)[good] + np.eye(own.shape[1]) * ~given[good][:, None]

    def reduced(self, matrix: Array) -> Array:
        """Return rows with columns of what remains unknown.

        The last columns are those of whole nodes and of multipliers that are kept.
        """
        node, direction = np.nonzero(~self._given)
        basis = self._basis[node, :, direction]
        columns = sum(matrix[:, self._own[node, i]] * basis[:, i] for i in range(basis.shape[1]))
        return np.hstack([columns, matrix[:, self._plain]])

    def known(self, right: Array) -> Array:
        """Return the displacements that these rows give, zero elsewhere."""
        found = np.zeros(self._size)
        values = np.where(self._given, right[self._rows] / self._length, 0.0)
        found[self._own] = self._turned(np.linalg.solve(self._lower, values[:, :, None])[:, :, 0])
        return found

    def expanded(self, unknown: Array) -> Array:
        """Return the displacements of what remained unknown."""
        found = np.zeros(self._size)
        free = np.zeros(self._given.shape)
        free[~self._given] = unknown[: np.count_nonzero(~self._given)]
        found[self._own] = self._turned(free)
        found[self._plain] = unknown[len(unknown) - len(self._plain) :]
        return found

    def _turned(self, values: Array) -> Array:
        """Return displacements with these components in the bases."""
        return np.asarray(np.einsum("nij,nj->ni", self._basis, values))


def _without(size: int, numbers: Indices) -> Indices:
    """Return the numbers up to a size that are not among these."""
    left = np.ones(size, dtype=bool)
    left[numbers] = False
    return np.flatnonzero(left)
