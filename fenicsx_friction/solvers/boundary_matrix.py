# SPDX-License-Identifier: MIT
"""The dense matrix of Newton's method on the boundary, and its solution.

Unknown are the displacements ``q`` of the dofs of contact and the multipliers ``c``. Most ``c``
follow from the balance of forces at their own node, a regular small block, so that a system of the
size of ``q`` remains. Those of nodes with prescribed dofs or several contacts stay unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack, lstsq
from scipy.sparse import csr_array

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]

#: The forces of a node's multipliers are regular if their determinant is more than this.
SOLVABLE = 1e-6
#: Below this reciprocal condition number a matrix counts as singular.
SINGULAR = 1e-15


@dataclass(frozen=True)
class Elements:
    """The elements of a contact, of all ranks.

    Attributes:
        columns: Numbers of their unknowns: ``q`` first, those of the node itself ahead, then ``c``;
            -1 for those that are prescribed or absent.
        matrices: Derivatives of nodal forces and rows, as numbered.
        d: Multipliers of a node.
    """

    columns: Indices
    matrices: Array
    d: int

    def split(self) -> tuple[Indices, Indices]:
        """Return the numbers of displacements and of multipliers."""
        return self.columns[:, : -self.d], self.columns[:, -self.d :]


class BoundaryMatrix:
    """The matrix of all unknowns, factored once.

    Args:
        schur: Stiffness of the bulk (N/m).
        parts: The elements of all contacts.
        size: Number of unknowns.
    """

    def __init__(self, schur: Array, parts: Sequence[Elements], size: int) -> None:
        self._schur, self._parts, self._n, self._size = schur, parts, len(schur), size
        columns = np.concatenate([part.split()[0].ravel() for part in parts])
        counts = np.bincount(columns[columns >= 0], minlength=self._n)
        self._regular = [_regular(part, counts) for part in parts]
        self._factor()

    def __matmul__(self, x: Array) -> Array:
        """Multiply."""
        result = np.zeros(self._size)
        result[: self._n] = self._schur @ x[: self._n]
        for part in self._parts:
            there = np.where(part.columns >= 0, x[part.columns], 0.0)
            values = np.einsum("nij,nj->ni", part.matrices, there)
            np.add.at(result, part.columns[part.columns >= 0], values[part.columns >= 0])
        return result

    def _factor(self) -> None:
        """Eliminate the regular multipliers and factor what remains."""
        kept = np.ones(self._size, dtype=bool)
        for part, regular in zip(self._parts, self._regular, strict=True):
            kept[part.split()[1][regular]] = False
        self._kept = np.flatnonzero(kept)
        self._place = np.full(self._size + 1, -1)  # the last one for -1
        self._place[self._kept] = np.arange(len(self._kept))
        self._steps = [
            _Eliminated(part, regular, self._place)
            for part, regular in zip(self._parts, self._regular, strict=True)
        ]
        matrix = self._assembled()
        self._finite = bool(np.all(np.isfinite(matrix)))
        # LAPACK counts by columns: the transpose needs no copy.
        self._lu, self._pivots, info = lapack.dgetrf(matrix.T, overwrite_a=True)
        rcond = lapack.dgecon(self._lu, 1.0)[0] if info == 0 and self._finite else 0.0
        self._singular = not rcond > SINGULAR

    def _assembled(self) -> Array:
        """Return the matrix of what remains, rows and columns of about unit length."""
        matrix = np.zeros((len(self._kept),) * 2)
        matrix[: self._n, : self._n] = self._schur
        for part, regular, step in zip(self._parts, self._regular, self._steps, strict=True):
            special = self._place[part.columns[~regular]]
            _scatter(matrix, special, special, part.matrices[~regular])
            _scatter(matrix, step.q, step.q, part.matrices[regular][:, : -part.d, : -part.d])
        self._balance = [matrix[step.own.ravel()] for step in self._steps]
        for step, balance in zip(self._steps, self._balance, strict=True):
            if step.others.size:
                matrix -= step.reactions(len(matrix)) @ balance
            matrix[step.own.ravel()] = -step.times(balance)
            _scatter(matrix, step.own, step.q, step.slopes_of_q)
        # Displacements and multipliers have different units.
        self._of_rows = _inverse(np.sqrt(np.einsum("ij,ij->i", matrix, matrix)))
        matrix *= self._of_rows[:, None]
        self._of_columns = np.ones(len(matrix))
        special = matrix[:, self._n :]
        self._of_columns[self._n :] = _inverse(np.max(abs(special), axis=0, initial=0.0))
        special *= self._of_columns[self._n :]
        return matrix

    def solve(self, b: Array) -> Array:
        """Solve; a consistent singular system has the solution of least squares."""
        if not self._finite:
            return np.full(self._size, np.nan)
        right = b[self._kept]
        forces = [right[step.own.ravel()] for step in self._steps]
        for step, force in zip(self._steps, forces, strict=True):
            if step.others.size:
                right -= step.reactions(len(right)) @ force
            right[step.own.ravel()] = b[step.c].ravel() - step.times(force[:, None]).ravel()
        right *= self._of_rows
        if self._singular:
            found = lstsq(self._assembled(), right, lapack_driver="gelsy")[0]
        else:
            found = lapack.dgetrs(self._lu, self._pivots, right, trans=1)[0]
        found = found * self._of_columns
        x = np.zeros(self._size)
        x[self._kept] = found
        for step, force, balance in zip(self._steps, forces, self._balance, strict=True):
            rest = (force - balance @ found).reshape(step.own.shape)
            x[step.c] = np.einsum("nij,nj->ni", step.inverse, rest)
        return x


class _Eliminated:
    """The multipliers of a contact's regular nodes, eliminated by the forces on their own dofs."""

    def __init__(self, part: Elements, regular: npt.NDArray[np.bool_], place: Indices) -> None:
        d, columns, matrices = part.d, part.columns[regular], part.matrices[regular]
        self.q, self.c = place[columns[:, :-d]], columns[:, -d:]
        self.own, self.others = self.q[:, :d], self.q[:, d:]
        self.inverse = np.linalg.inv(matrices[:, :d, -d:])
        self.slopes_of_q = matrices[:, -d:, :-d]
        self._slopes = matrices[:, -d:, -d:] @ self.inverse
        self._forces = matrices[:, d:-d, -d:] @ self.inverse

    def times(self, rows: Array) -> Array:
        """Multiply rows of the balance of forces by what multipliers do in the rows of the law."""
        n, d = self.own.shape
        return np.asarray((self._slopes @ rows.reshape(n, d, rows.shape[1])).reshape(rows.shape))

    def reactions(self, size: int) -> csr_array:
        """Return what a force on each own dof does to the forces on the others."""
        own = np.arange(self.own.size).reshape(self.own.shape)
        i = np.broadcast_to(self.others[:, :, None], self._forces.shape)
        j = np.broadcast_to(own[:, None, :], self._forces.shape)
        there = i >= 0
        shape = (size, self.own.size)
        return csr_array((self._forces[there], (i[there], j[there])), shape=shape)


def _regular(part: Elements, counts: Indices) -> npt.NDArray[np.bool_]:
    """Tell which nodes are free, only in this element, and loaded by all their multipliers.

    Args:
        part: The elements of a contact.
        counts: In how many elements each displacement is.
    """
    own, c = part.split()[0][:, : part.d], part.split()[1]
    forces = part.matrices[:, : part.d, -part.d :]
    size = np.max(abs(forces), axis=(1, 2), initial=0.0)
    solvable = abs(np.linalg.det(forces)) > SOLVABLE * size**part.d
    free = solvable & np.all(own >= 0, axis=1) & np.all(c >= 0, axis=1)
    return np.asarray(free & np.all(counts[np.where(own >= 0, own, 0)] == 1, axis=1))


def _scatter(matrix: Array, rows: Indices, columns: Indices, blocks: Array) -> None:
    """Add blocks to a dense matrix; rows and columns -1 are left out."""
    i = np.broadcast_to(rows[:, :, None], blocks.shape)
    j = np.broadcast_to(columns[:, None, :], blocks.shape)
    there = (i >= 0) & (j >= 0) & (blocks != 0.0)
    np.add.at(matrix, (i[there], j[there]), blocks[there])


def _inverse(sizes: Array) -> Array:
    """Return the inverse of sizes; one of zero."""
    return np.divide(1.0, sizes, out=np.ones_like(sizes), where=sizes != 0.0)
