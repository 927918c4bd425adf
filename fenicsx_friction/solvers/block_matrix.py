# SPDX-License-Identifier: MIT
"""Matrices made of many small blocks, which overlap."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from ..equations.blocks import Places

Array = npt.NDArray[np.floating]


class BlockMatrix:
    """A matrix that blocks are added up to; collective.

    Entries at the same place are added up here: PETSc would sort all of them, in twice the time.

    Args:
        sizes: Sizes of rows and columns, as PETSc takes them.
        places: Numbers of the rows and columns of blocks, which may be those of other ranks; -1 for
            what is left out.
        comm: The communicator.

    Attributes:
        matrix: The matrix, of zeros until the first :meth:`set`.
    """

    def __init__(self, sizes: object, places: Sequence[Places], comm: PETSc.Comm) -> None:
        self.matrix = PETSc.Mat().create(comm)
        self.matrix.setSizes(sizes)
        self.matrix.setType(PETSc.Mat.Type.AIJ)
        rows, columns = _coordinates(places)
        keys = rows * (np.max(columns, initial=0) + 1) + columns
        order = np.argsort(keys, kind="stable")
        self._order = order[np.searchsorted(keys, 0, sorter=order) :]
        keys = keys[self._order]
        self._first = np.flatnonzero(np.diff(keys, prepend=-1))
        once = self._order[self._first]
        # PETSc may change the arrays that it is given.
        indices = (k[once].astype(PETSc.IntType) for k in (rows, columns))
        self.matrix.setPreallocationCOO(*indices)
        self._set(np.zeros(len(once)))

    def set(self, blocks: Iterable[Array]) -> None:
        """Put the values of all blocks in, in the order of their places."""
        values = np.concatenate([block.ravel() for block in blocks])[self._order]
        self._set(np.add.reduceat(values, self._first) if len(values) else values)

    def _set(self, values: Array) -> None:
        """Put values in, one for each place."""
        self.matrix.setValuesCOO(values, addv=PETSc.InsertMode.INSERT_VALUES)

    def destroy(self) -> None:
        """Free the matrix."""
        self.matrix.destroy()


def _coordinates(places: Sequence[Places]) -> tuple[npt.NDArray, npt.NDArray]:
    """Return row and column of each entry of all blocks, both -1 for those that are left out."""
    shapes = [(*r.shape, c.shape[1]) for r, c in places]
    i, j = (np.empty(sum(map(np.prod, shapes)), dtype=np.int64) for _ in range(2))
    end = 0
    for (r, c), shape in zip(places, shapes, strict=True):
        start, end = end, end + int(np.prod(shape))
        i[start:end].reshape(shape)[:] = r[:, :, None]
        j[start:end].reshape(shape)[:] = c[:, None]
    i[j < 0] = j[i < 0] = -1
    return i, j
