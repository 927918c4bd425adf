# SPDX-License-Identifier: MIT
"""Motions of rigid bodies in a preconditioner: a few rows and columns round a large matrix.

With the matrix ``[A E; F G]`` and a preconditioner ``M`` of ``A``, the motions follow from the
small matrix ``G - F M E``. Its columns cost an application of ``M`` for each component.
"""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from .saddle import SaddleBlocks

Array = npt.NDArray[np.floating]
#: Puts into the second vector what a preconditioner makes of the first; zero for the motions.
Solve = Callable[[PETSc.Vec, PETSc.Vec], None]


class Border:
    """The rows and columns of the motions; methods are collective.

    It must not hold who preconditions, who holds it.

    Args:
        blocks: Tell where the rows of the motions are.
    """

    def __init__(self, blocks: SaddleBlocks) -> None:
        self._own = slice(blocks.num_u, blocks.num_u + blocks.num_q)
        self._mine, self._size = blocks.motions, blocks.num_motions
        self._columns: list[PETSc.Vec] = []

    def update(self, J: PETSc.Mat, solve: Solve) -> bool:
        """Eliminate all but the motions; tell whether the numbers are finite.

        Args:
            J: The whole matrix.
            solve: Preconditions displacements and multipliers.
        """
        self.destroy()
        self._comm, self._row = J.comm.tompi4py(), J.createVecLeft()
        self._matrix = np.zeros((self._size, self._size))
        unit, column = J.createVecs()
        for i in range(self._size):
            unit.zeroEntries()
            if self._mine.start <= i < self._mine.stop:
                unit.array[self._own.start + i - self._mine.start] = 1.0
            J.mult(unit, column)
            self._columns.append(unit.duplicate())
            solve(column, self._columns[-1])
            self._matrix[:, i] = self._left(J, column, self._columns[-1])
        unit.destroy()
        column.destroy()
        return bool(np.all(np.isfinite(self._matrix)))

    def apply(self, J: PETSc.Mat, solve: Solve, r: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve for all unknowns, with the arguments of :meth:`update`."""
        solve(r, x)
        # What nothing holds, yet, does not move.
        motion = np.linalg.lstsq(self._matrix, self._left(J, r, x))[0]
        x.maxpy(-motion, self._columns)
        x.array[self._own] = motion[self._mine]

    def destroy(self) -> None:
        """Free the vectors."""
        for vector in self._columns:
            vector.destroy()
        if self._columns:
            self._row.destroy()
        self._columns = []

    def _left(self, J: PETSc.Mat, r: PETSc.Vec, x: PETSc.Vec) -> Array:
        """Return the residual of the motions of all ranks."""
        J.mult(x, self._row)
        owned = r.array_r[self._own] - self._row.array_r[self._own]
        return np.concatenate(self._comm.allgather(owned))
