# SPDX-License-Identifier: MIT
"""Residual and Jacobian as the SNES calls them: the forms of the bulk, plus contact."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from dolfinx.fem.petsc import assign

from ..base.collective import any_rank
from ..base.keeping import ErrorKeeper
from ..equations.blocks import Blocks, Coupling
from ..equations.contact_terms import ContactTerms, Law
from ..equations.dependencies import Dependencies
from ..obstacles.kinematics import Array
from .block_matrix import BlockMatrix
from .sparsity import zeros_of_both


class Callbacks:
    """Replaces the callbacks that DOLFINx has set; collective.

    Rows of prescribed dofs hold a displacement (m), the others forces. The former are multiplied by
    a stiffness, so that line searches and norms do not depend on units. Newton's steps stay the
    same.

    The matrix of the forms keeps its own sparsity. The SNES solves with the sum of it and the
    elements of contact, whose sparsity is made anew when stencils change.

    It must not hold the SNES: a cycle through PETSc would leave it to each rank's garbage collector
    when to destroy collective objects.

    Args:
        snes: The solver of a ``NonlinearProblem``.
        row_scale: Factor of each owned row.
        unknowns: Its unknowns.
        terms: The terms of contact.
        errors: Keeps what the callbacks raise.
        tangent: What the matrix of the forms depends on.

    Attributes:
        law: The rows of the substep that is being solved.
    """

    def __init__(
        self,
        snes: PETSc.SNES,
        row_scale: Array,
        unknowns: Sequence[fem.Function],
        terms: ContactTerms,
        errors: ErrorKeeper,
        tangent: Dependencies,
    ) -> None:
        self._b, (residual, _, residual_data) = snes.getFunction()
        self._forms, _, (jacobian, _, jacobian_data) = snes.getJacobian()
        self._form_residual = lambda x, b: residual(None, x, b, **residual_data)
        self._form_jacobian = lambda x, A: jacobian(None, x, A, A, **jacobian_data)
        self._row_scale, self._unknowns, self._terms = row_scale, list(unknowns), terms
        self.errors = errors
        self.law: Law | None = None
        self._total: PETSc.Mat | None = None
        self._elements: BlockMatrix | None = None
        self._pattern: tuple[object, ...] = ()
        self._blocks: list[Blocks[Array]] | None = None
        self._tangent = tangent
        self._made_of: list[Array] | None = None

    def attach(self, snes: PETSc.SNES) -> None:
        """Give a solver this residual."""
        snes.setFunction(self._call_residual, self._b)

    def use(self, snes: PETSc.SNES) -> None:
        """Give a solver this Jacobian."""
        snes.setJacobian(self._call_jacobian, self._total, self._total)

    def prepare(self, x: PETSc.Vec, law: Law) -> bool:
        """Make a matrix with the sparsity of the stencils; collective.

        Args:
            x: The iterate.
            law: The rows of the substep.

        Returns:
            Whether it is another matrix than before.
        """
        self.law = law
        pattern = (self._terms.versions, law.others)
        if self._pattern == pattern:
            return False
        self._destroy()
        if not self._forms.isAssembled():
            self._assemble_forms(x)  # sets its sparsity
        places = [place for blocks in self._terms.places(law) for place in blocks]
        self._elements = BlockMatrix(self._forms.getSizes(), places, self._forms.comm)
        self._total = zeros_of_both(self._forms, self._elements.matrix)
        self._pattern = pattern
        return True

    def couplings(self) -> list[Coupling]:
        """Return places, values and softness of the blocks of each contact, of the Jacobian."""
        assert self.law is not None
        law, terms = self.law, self._terms
        blocks = terms.matrices(law) if self._blocks is None else self._blocks
        return list(zip(terms.places(law), blocks, terms.softness(), strict=True))

    def evaluate(self, x: PETSc.Vec, b: PETSc.Vec, law: Law) -> None:
        """Evaluate the residual of a substep; no matrix is made."""
        self.law = law
        self._call_residual(None, x, b)

    def _call_residual(self, snes: PETSc.SNES | None, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Assemble the residual with scaled rows."""
        with self.errors(), self._at(x):
            self._blocks = None  # those of another iterate
            self._form_residual(x, b)
            assert self.law is not None
            self._terms.add_residual(b, self.law)
            self._terms.lift(b, self.law)
            b.array[:] *= self._row_scale

    def _call_jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        """Assemble the Jacobian with scaled rows."""
        with self.errors(), self._at(x):
            self._assemble_forms(x)
            assert self.law is not None and self._elements is not None
            self._blocks = self._terms.matrices(self.law)
            self._elements.set(block for blocks in self._blocks for block in blocks)
            J.zeroEntries()
            for part in (self._forms, self._elements.matrix):
                J.axpy(1.0, part, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            scale = J.createVecLeft()
            scale.array[:] = self._row_scale
            J.diagonalScale(scale)
            scale.destroy()

    def _assemble_forms(self, x: PETSc.Vec) -> None:
        """Assemble the matrix of the forms, unless it would be the same."""
        now, made_of = self._tangent.values(), self._made_of
        same = made_of is not None and all(map(np.array_equal, now, made_of))
        if any_rank(self._forms.comm.tompi4py(), not same):
            self._made_of = None  # an error or an interrupt may come
            self._form_jacobian(x, self._forms)
            self._made_of = [a.copy() for a in now]

    @contextmanager
    def _at(self, x: PETSc.Vec) -> Iterator[None]:
        """Put the iterate into the unknowns; inside, the kinematics are those there."""
        x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
        assign(x, self._unknowns)
        with (
            np.errstate(over="ignore", invalid="ignore"),
            self._terms.still(),
        ):
            yield

    def _destroy(self) -> None:
        """Destroy the matrices; collective."""
        for matrix in (self._total, self._elements):
            if matrix is not None:
                matrix.destroy()
