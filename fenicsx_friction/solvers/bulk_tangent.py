# SPDX-License-Identifier: MIT
"""The tangent of the bulk: assembled anew when anything that it depends on has changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix

from ..base.collective import any_rank, largest_of_ranks
from ..base.compilation import compiled
from ..equations.conditions import with_conditions
from ..equations.dependencies import Dependencies
from ..equations.numbering import held_rows, num_owned
from .schur import add_diagonal

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


class BulkTangent:
    """The matrix of a bulk under its Dirichlet conditions; methods are collective.

    It depends on fields and Constants in the forms, and on the mesh. Their values are compared.

    Args:
        forms: Derivatives of the residuals of the bulk, expanded; ``None`` where there is none.
        unknowns: Their unknowns, displacement first.
        bcs: Dirichlet conditions.
        entity_maps: Entity maps of all meshes in the residuals.
        matrix: The tangent as it is now, without conditions, if it is at hand.

    Attributes:
        linear: Whether the forms do not depend on the unknowns.
        held: The owned rows that are prescribed.
        matrix: The matrix; prescribed dofs have rows and columns of the identity, scaled.
        lifted: For a bulk that is not linear, forces (N) of the prescribed values that the unknowns
            did not have yet; to set the values first would distort the cells beside them.
    """

    def __init__(
        self,
        forms: Sequence[Sequence[ufl.Form | None]],
        unknowns: Sequence[fem.Function],
        bcs: Sequence[fem.DirichletBC],
        entity_maps: Sequence[mesh.EntityMap],
        matrix: PETSc.Mat | None = None,
    ) -> None:
        self._unknowns, self._bcs = list(unknowns), list(bcs)
        self._comm, self._maps = unknowns[0].function_space.mesh.comm, list(entity_maps)
        self._forms, self._offered = forms, matrix
        self._compiled: Any = None
        self._held_of = held_rows(unknowns, bcs)
        self.held = np.concatenate(self._held_of)
        self.matrix: PETSc.Mat | None = None
        self.lifted: Array | float = 0.0
        self._of = Dependencies(forms)
        self.linear = not self._of.include(unknowns)
        self._made_of = [a.copy() for a in self._dependencies()]

    def has_changed(self) -> bool:
        """Tell whether the matrix would be another one now."""
        same = all(map(np.array_equal, self._dependencies(), self._made_of))
        return any_rank(self._comm, not same)

    def refresh(self, *, changed: bool) -> None:
        """Make the matrix of now; the one at hand serves if nothing has changed."""
        now = self._dependencies()
        self._assemble(changed)
        self._made_of = [a.copy() for a in now]

    def discard(self) -> None:
        """Forget the matrix."""
        for matrix in (self.matrix, self._offered):
            if matrix is not None:
                matrix.destroy()
        self.matrix = self._offered = None

    def _dependencies(self) -> list[Array]:
        """Return all values that the matrix depends on."""
        return [*self._of.values(), *([] if self.linear else self._lifted_by())]

    def _lifted_by(self) -> list[Array]:
        """Return what the forces of missing prescribed values depend on, beside the matrix."""
        wanted = [with_conditions(f, self._bcs) for f in self._unknowns]
        return [*wanted, *(f.x.array for f in self._unknowns)]

    def _assemble(self, changed: bool) -> None:
        """Assemble the matrix, or take the one at hand, and put the conditions into it."""
        matrix = self._offered
        if offered := matrix is not None and not changed:
            self._offered = None
        else:
            self.discard()
            matrix = self._assemble_anew()
        self.matrix = matrix
        if not self.linear:
            self._lift(matrix)
        first = matrix.getOwnershipRange()[0]
        for held, size in self._held_sizes(matrix):
            rows = (first + held).astype(PETSc.IntType)
            if offered or not self.linear:
                matrix.zeroRowsColumns(rows, diag=size)
            else:  # zero already
                matrix.zeroRows(rows, diag=size)

    def _assemble_anew(self) -> PETSc.Mat:
        """Assemble the matrix from the user's forms; of a linear bulk without prescribed rows."""
        if self._compiled is None:
            self._compiled = compiled(fem.form, self._comm)(self._forms, entity_maps=self._maps)
        bcs = self._bcs if self.linear else []
        if len(self._unknowns) == 1:
            matrix = assemble_matrix(self._compiled[0][0], bcs=bcs)
        else:
            matrix = assemble_matrix(self._compiled, bcs=bcs, kind="mpi")
        matrix.assemble()
        if len(self._unknowns) > 1:
            add_diagonal(matrix)
        return matrix

    def _lift(self, matrix: PETSc.Mat) -> None:
        """Find the forces of prescribed values that the unknowns do not have yet."""
        missing, forces = matrix.createVecs()
        missing.array[:] = np.concatenate(
            [(with_conditions(f, self._bcs) - f.x.array)[: num_owned(f)] for f in self._unknowns]
        )
        matrix.mult(missing, forces)
        self.lifted = forces.array.copy()
        missing.destroy()
        forces.destroy()

    def _held_sizes(self, matrix: PETSc.Mat) -> list[tuple[Indices, float]]:
        """Return the prescribed rows of each unknown, and the largest diagonal of its free ones.

        With a diagonal of this size MUMPS loses no digits.
        """
        vector, at, found = matrix.getDiagonal(), 0, []
        for f, held in zip(self._unknowns, self._held_of, strict=True):
            free = np.delete(vector.array[at : at + num_owned(f)], held - at)
            local = np.array([np.max(abs(free), initial=0.0)])
            largest = float(largest_of_ranks(self._comm, local)[0])
            found.append((held, largest if 0.0 < largest < np.inf else 1.0))
            at += num_owned(f)
        vector.destroy()
        return found
