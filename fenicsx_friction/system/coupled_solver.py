# SPDX-License-Identifier: MIT
"""Residual and Jacobian of a ``NonlinearProblem`` with the pairs of deformable obstacles added."""

from collections.abc import Callable, Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np
from dolfinx.fem.petsc import assign

from ..surfaces.face_cells import Array
from .coupling import Coupling
from .snes_callbacks import Callbacks


class CoupledCallbacks(Callbacks):
    """Adds the pairs to what the forms give; collective.

    The matrix of the forms keeps its own sparsity. The SNES solves with the sum of it and the
    element matrices, whose sparsity is made anew when the pairs change.

    Args:
        snes: The solver of a ``NonlinearProblem``.
        row_scale: Factor of each owned row.
        unknowns: Its unknowns.
        coupling: The pairs.
        laws: Derivatives of the laws' rows, see ``Coupling.law_derivatives``.
    """

    def __init__(
        self,
        snes: PETSc.SNES,
        row_scale: Array,
        unknowns: Sequence[Any],
        coupling: Coupling,
        laws: Sequence[Callable[[], Array]],
    ) -> None:
        super().__init__(snes, row_scale)
        self._coupling, self._laws, self._unknowns = coupling, laws, list(unknowns)
        self._total: PETSc.Mat | None = None
        self._elements: PETSc.Mat | None = None
        self._versions: tuple[int, ...] = ()

    def prepare(self, snes: PETSc.SNES, x: PETSc.Vec) -> None:
        """Give the SNES a matrix that fits to the pairs; collective."""
        if self._versions == self._coupling.versions:
            return
        self._destroy()
        if not self._forms.isAssembled():
            self._form_jacobian(snes, x, self._forms)  # only then it has its sparsity
        size, comm = self._forms.getLocalSize(), self._forms.comm
        self._elements = PETSc.Mat().create(comm)
        self._elements.setSizes(((size[0], None), (size[1], None)))
        self._elements.setType(PETSc.Mat.Type.AIJ)
        columns = [p.columns() for p in self._coupling.pairs]
        rows = np.concatenate([np.repeat(c, c.shape[1], axis=1).ravel() for c in columns])
        cols = np.concatenate([np.tile(c, (1, c.shape[1])).ravel() for c in columns])
        left_out = (rows < 0) | (cols < 0)
        rows, cols = (np.where(left_out, -1, i).astype(PETSc.IntType) for i in (rows, cols))
        self._elements.setPreallocationCOO(rows, cols)
        self._elements.setValuesCOO(np.zeros(len(rows)), addv=PETSc.InsertMode.INSERT_VALUES)
        self._total = self._forms.duplicate(copy=False)
        self._total.axpy(1.0, self._elements, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        snes.setJacobian(self._call_jacobian, self._total, self._total)
        self._versions = self._coupling.versions

    def assemble_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Assemble the residual."""
        self._follow(x)
        self._form_residual(snes, x, b)
        self._coupling.add_residual(b, lambda: self._coupling.matrices(self._laws))

    def assemble_jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat) -> None:
        """Assemble the Jacobian."""
        self._follow(x)
        self._form_jacobian(snes, x, self._forms)
        values = [m.ravel() for m in self._coupling.matrices(self._laws)]
        assert self._elements is not None
        self._elements.setValuesCOO(np.concatenate(values), addv=PETSc.InsertMode.INSERT_VALUES)
        J.zeroEntries()
        for part in (self._forms, self._elements):
            J.axpy(1.0, part, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)

    def _follow(self, x: PETSc.Vec) -> None:
        """Put the iterate into the unknowns and the kinematics."""
        x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
        assign(x, self._unknowns)
        self._coupling.update()

    def _destroy(self) -> None:
        """Destroy the matrices; collective."""
        for matrix in (self._total, self._elements):
            if matrix is not None:
                matrix.destroy()
