# SPDX-License-Identifier: MIT
"""The dense matrix of Newton's method on the boundary, and its solution.

Unknown are the displacements ``q`` of the dofs of contact and the multipliers ``c``. Most ``c``
follow from the balance of forces at their own node, a regular small block, so that a system of the
size of ``q`` remains. Those of nodes with prescribed dofs or several contacts stay unknown. Then
rows of the law that contain displacements of their own node only, at closed and sticking nodes, are
solved first, so that about one unknown for each slipping node and ``d`` for each open one remain.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import scipy

from .eliminated import Block, Elements, EliminatedMultipliers, KnownDirections

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]

#: Below this reciprocal condition number a matrix counts as singular.
SINGULAR = 1e-15


class BoundaryMatrix:
    """The matrix of all unknowns, factored once.

    Args:
        schur: Stiffness of the bulk (N/m).
        springs: Those of the motions of rigid bodies, which come after the displacements.
        parts: The nodes of all contacts.
        turning: How displacements turn the forces of contact: further stiffness.
        size: Number of unknowns.
    """

    def __init__(
        self,
        schur: Array,
        springs: Array,
        parts: Sequence[Elements],
        turning: Sequence[Block],
        size: int,
    ) -> None:
        self._schur, self._springs, self._parts, self._size = schur, springs, parts, size
        self._n, self._turning = len(schur) + len(springs), turning
        columns = np.concatenate([part.q.ravel() for part in parts])
        counts = np.bincount(columns[columns >= 0], minlength=self._n)
        self._regular = [part.regular(counts) for part in parts]
        self._factor()

    def __matmul__(self, x: Array) -> Array:
        """Multiply."""
        return self._products(x, [block for part in self._parts for block in part.blocks()])

    def _products(self, x: Array, blocks: Sequence[Block]) -> Array:
        """Multiply stiffness and other blocks; displacements come first."""
        result, bulk, n = np.zeros(len(x)), len(self._schur), self._n
        result[:bulk] = self._schur @ x[:bulk]
        result[bulk:n] = self._springs * x[bulk:n]
        for rows, columns, values in (*self._turning, *blocks):
            products = np.einsum("nij,nj->ni", values, np.where(columns >= 0, x[columns], 0.0))
            there = rows >= 0
            np.add.at(result, rows[there], products[there])
        return result

    def _factor(self) -> None:
        """Eliminate multipliers and known displacements, and factor what remains."""
        kept = np.ones(self._size, dtype=bool)
        for part, regular in zip(self._parts, self._regular, strict=True):
            kept[part.c[regular]] = False
        self._kept = np.flatnonzero(kept)
        self._place = np.full(self._size + 1, -1)  # the last one for -1
        self._place[self._kept] = np.arange(len(self._kept))
        self._steps = [
            EliminatedMultipliers(part, regular, self._place)
            for part, regular in zip(self._parts, self._regular, strict=True)
        ]
        self._special = [
            (self._place[rows], self._place[columns], values)
            for part, regular in zip(self._parts, self._regular, strict=True)
            for rows, columns, values in part.take(~regular).blocks()
        ]
        self._known = KnownDirections(self._steps, len(self._kept))
        matrix = self._remaining()
        self._finite = bool(np.all(np.isfinite(matrix)))
        if not matrix.size:
            self._singular = False
            return
        # LAPACK counts by columns: the transpose needs no copy.
        self._lu, self._pivots, info = scipy.linalg.lapack.dgetrf(matrix.T, overwrite_a=True)
        rcond = scipy.linalg.lapack.dgecon(self._lu, 1.0)[0] if info == 0 and self._finite else 0.0
        self._singular = not rcond > SINGULAR

    def _remaining(self) -> Array:
        """Return the matrix of what remains, rows and columns of about unit length."""
        matrix = self._known.reduced(self._assembled(self._known.others))
        # Displacements and multipliers have different units.
        self._of_rows = _inverse(np.sqrt(np.einsum("ij,ij->i", matrix, matrix)))
        matrix *= self._of_rows[:, None]
        first = matrix.shape[1] - (len(self._kept) - self._n)
        self._of_columns = np.ones(matrix.shape[1])
        self._of_columns[first:] = _inverse(np.max(abs(matrix[:, first:]), axis=0, initial=0.0))
        matrix[:, first:] *= self._of_columns[first:]
        return matrix

    def _assembled(self, wanted: Indices) -> Array:
        """Return these rows of the matrix of all that is kept."""
        balance, bulk = np.zeros((len(self._kept),) * 2), len(self._schur)
        balance[:bulk, :bulk] = self._schur
        motions = np.arange(bulk, self._n)
        balance[motions, motions] = self._springs
        for block in (*self._turning, *self._special):
            _scatter(balance, *block)
        matrix = balance[wanted]
        at = np.full(len(balance), -1)
        at[wanted] = np.arange(len(wanted))
        for step in self._steps:
            if step.others.size:
                matrix -= step.reactions(len(balance))[wanted] @ balance[step.own.ravel()]
        for step in self._steps:
            rows = at[step.own]
            there = rows >= 0
            matrix[rows[there]] = -step.times(balance, there)
            _scatter(matrix, rows, step.q, step.slopes_of_q)
        return matrix

    def solve(self, b: Array) -> Array:
        """Solve; a consistent singular system has the solution of least squares."""
        if not self._finite:
            return np.full(self._size, np.nan)
        forces, laws = b[self._kept], [b[step.c] for step in self._steps]
        known = self._known.known(self._rows(forces, laws))
        left = forces - self._forces(known)
        laws = [a - step.law(known) for a, step in zip(laws, self._steps, strict=True)]
        right = self._rows(left, laws)[self._known.others] * self._of_rows
        found = known + self._known.expanded(self._of_columns * self._solved(right))
        rest = forces - self._forces(found)
        x = np.zeros(self._size)
        x[self._kept] = found
        for step in self._steps:
            x[step.c] = np.einsum("nij,nj->ni", step.inverse, rest[step.own])
        return x

    def _solved(self, right: Array) -> Array:
        """Solve for what remains."""
        if not right.size:
            return right
        if self._singular:
            matrix = self._remaining()
            return np.asarray(scipy.linalg.lstsq(matrix, right, lapack_driver="gelsy")[0])
        return np.asarray(scipy.linalg.lapack.dgetrs(self._lu, self._pivots, right, trans=1)[0])

    def _forces(self, x: Array) -> Array:
        """Return the forces of the bulk, and of the elements but for their multipliers."""
        return self._products(x, self._special)

    def _rows(self, forces: Array, laws: Sequence[Array]) -> Array:
        """Return rows without multipliers: of forces, and of the laws at their own dofs."""
        rows, owned = forces.copy(), [forces[step.own] for step in self._steps]
        for step, own, law in zip(self._steps, owned, laws, strict=True):
            if step.others.size:
                rows -= step.reactions(len(rows)) @ own.ravel()
            rows[step.own] = law - np.einsum("nij,nj->ni", step.slopes, own)
        return rows


def _scatter(matrix: Array, rows: Indices, columns: Indices, blocks: Array) -> None:
    """Add blocks to a dense matrix; rows and columns -1 are left out."""
    i = np.broadcast_to(rows[:, :, None], blocks.shape)
    j = np.broadcast_to(columns[:, None, :], blocks.shape)
    there = (i >= 0) & (j >= 0) & (blocks != 0.0)
    np.add.at(matrix, (i[there], j[there]), blocks[there])


def _inverse(sizes: Array) -> Array:
    """Return the inverse of sizes; one of zero."""
    return np.divide(1.0, sizes, out=np.ones_like(sizes), where=sizes != 0.0)
