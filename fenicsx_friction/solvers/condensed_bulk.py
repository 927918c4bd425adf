# SPDX-License-Identifier: MIT
"""The bulk of a problem, factored and condensed to the dofs of contact.

The factor lives as long as all that its matrix depends on: fields and Constants in the tangent, and
the mesh. This is compared, value by value, at the start of each step: a bulk that is linear in its
unknowns is factored once. One that is not is linearised at the present state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix
from ufl.algorithms import extract_coefficients
from ufl.algorithms.analysis import extract_constants

from ..base.collective import any_rank, gather_rows, largest_of_ranks
from ..base.compilation import compiled
from ..contact.contact import Contact
from ..equations.conditions import constrained_dofs, with_conditions
from ..equations.numbering import contact_dofs, global_dofs, held_rows, num_owned
from .linear import MORE_WORKSPACE, WORKSPACE
from .options import inside
from .schur import FactorFailed, InnerFactor, add_diagonal, inner_factor

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


class CondensedBulk:
    """The bulk of a problem, seen from the dofs of contact; methods are collective.

    With the displacements ``q`` of these dofs, the forces of the bulk on them are
    ``loads + schur (q - start)``; those of a bulk that is not linear, to first order.

    Args:
        tangents: Derivatives of the residuals of the bulk, expanded; ``None`` where there is none.
        unknowns: Their unknowns, displacement first.
        bcs: Dirichlet conditions.
        entity_maps: Entity maps of all meshes in the residuals.
        contacts: The contacts.
        residuals: Returns the rows of the residuals at the owned dofs, without contact.
        prefix: Prefix of the PETSc options of the factor.
        options: PETSc options.
        matrix: The tangent as it is now, without conditions, if it is at hand.

    Attributes:
        linear: Whether the tangents do not depend on the unknowns.
        dofs: The owned free dofs of the displacement at nodes that contact may load.
        origin: The unknowns when the loads were condensed.
        start: Displacements of all ranks' dofs of contact at the start of the step (m).
        loads: Forces of the bulk on this rank's dofs of contact at ``start`` (N).
        factorisations: How many there have been.
    """

    def __init__(
        self,
        tangents: Sequence[Sequence[ufl.Form | None]],
        unknowns: Sequence[fem.Function],
        bcs: Sequence[fem.DirichletBC],
        entity_maps: Sequence[mesh.EntityMap],
        contacts: Sequence[Contact],
        residuals: Callable[[], Sequence[Array]],
        prefix: str,
        options: Mapping[str, object],
        matrix: PETSc.Mat | None = None,
    ) -> None:
        self._unknowns, self._bcs, self._residuals = list(unknowns), list(bcs), residuals
        V = unknowns[0].function_space
        self._prefix, self._options = prefix, options
        self._comm, self._maps = V.mesh.comm, list(entity_maps)
        self._tangents = tangents
        self.dofs = np.setdiff1d(contact_dofs(contacts, V), constrained_dofs(V, bcs))
        rows = global_dofs([f.function_space for f in unknowns])  # the displacement's come first
        self._counts = np.array(self._comm.allgather(len(self.dofs)))
        self._chosen = gather_rows(self._comm, rows[0][self.dofs], self._counts)
        self._held_of = held_rows(unknowns, bcs)
        self._held = np.concatenate(self._held_of)
        self._factor: InnerFactor | None = None
        self._matrix: PETSc.Mat | None = None
        self._forms: Any = None
        self._offered = matrix
        self._find_dependencies()
        self.linear = not any(f in self._fields for f in unknowns)
        self._lifted: Array | float = 0.0
        self._made_of = [a.copy() for a in self._dependencies()]
        self.factorisations = 0

    @property
    def size(self) -> int:
        """Number of dofs of contact on all ranks."""
        return int(np.sum(self._counts))

    @property
    def schur(self) -> Array:
        """Stiffness (N/m) of the dofs of contact of all ranks, on all ranks."""
        assert self._factor is not None
        return self._factor.schur

    def gathered(self) -> Array:
        """Return the displacements (m) of the dofs of contact of all ranks."""
        return gather_rows(self._comm, self._unknowns[0].x.array[self.dofs], self._counts)

    def refresh(self) -> None:
        """Factor again if anything that the matrix depends on has changed.

        Raises:
            FactorFailed: On all ranks.
        """
        now = self._dependencies()
        changed = not all(map(np.array_equal, now, self._made_of))
        changed = any_rank(self._comm, changed)
        if self._factor is not None and not changed:
            return
        self._matrix = self._assemble(changed)
        self._made_of = [a.copy() for a in now]
        try:
            self._factor = self._factored(self._options)
        except FactorFailed as error:
            if error.code not in WORKSPACE:
                raise
            self._factor = self._factored(MORE_WORKSPACE | dict(self._options))
        self.factorisations += 1

    def _factored(self, options: Mapping[str, object]) -> InnerFactor:
        """Return a new factor."""
        assert self._matrix is not None
        package = str(self._options["pc_factor_mat_solver_type"])
        with inside(self._prefix, options):
            return inner_factor(self._matrix, self._chosen, package, self._prefix)

    def discard(self) -> None:
        """Forget matrix and factor."""
        for part in (self._matrix, self._factor, self._offered):
            if part is not None:
                part.destroy()
        self._matrix = self._factor = self._offered = None

    def enter(self) -> None:
        """Give the unknowns their prescribed values."""
        for f in self._unknowns:
            f.x.array[:] = with_conditions(f, self._bcs)

    def begin(self) -> float:
        """Condense the loads of a step, from the present state; enters.

        Returns the 2-norm of the residual without contact (N).
        """
        assert self._matrix is not None and self._factor is not None
        r, y = self._matrix.createVecLeft(), self._matrix.createVecRight()
        self.origin = [f.x.array.copy() for f in self._unknowns]
        if self.linear:
            self.enter()
        r.array[:] = np.concatenate(list(self._residuals())) + self._lifted
        self.enter()
        r.array[self._held] = 0.0
        norm = float(r.norm())
        self._factor.solve(r, y)
        y.array[self._held] = 0.0
        inner = self._matrix * y
        self.loads = r.array[self.dofs] - inner.array[self.dofs]
        self.start = self.gathered()
        self._resting = (
            np.concatenate([f.x.array[: num_owned(f)] for f in self._unknowns]) - y.array
        )
        for o in (r, y, inner):
            o.destroy()
        return norm

    def recover(self) -> None:
        """Set all unknowns of the bulk from the displacements of the dofs of contact."""
        assert self._matrix is not None and self._factor is not None
        moved, inner = self._matrix.createVecRight(), self._matrix.createVecRight()
        u = self._unknowns[0]
        kept = u.x.array[self.dofs].copy()
        moved.array[self.dofs] = kept - self._resting[self.dofs]
        forces = self._matrix * moved
        self._factor.solve(forces, inner)
        inner.array[self._held] = 0.0
        values, at = self._resting - inner.array, 0
        values[self.dofs] = kept
        for f in self._unknowns:
            f.x.array[: num_owned(f)] = values[at : at + num_owned(f)]
            f.x.scatter_forward()
            at += num_owned(f)
        for o in (moved, inner, forces):
            o.destroy()

    def _find_dependencies(self) -> None:
        """Find the fields, numbers and meshes that the matrix depends on."""
        parts = [J for row in self._tangents for J in row if J is not None]
        fields = {f for J in parts for f in extract_coefficients(J)}
        numbers = {c for J in parts for c in extract_constants(J)}
        domains = {d for J in parts for d in J.ufl_domains()}
        self._fields = sorted(fields, key=lambda f: f.count())
        self._numbers = sorted(numbers, key=lambda c: c.count())
        self._meshes = [d.ufl_cargo() for d in sorted(domains, key=lambda d: d.ufl_id())]

    def _dependencies(self) -> list[Array]:
        """Return all values that the matrix depends on."""
        return [
            *(f.x.array for f in self._fields),
            *(np.asarray(c.value) for c in self._numbers),
            *(m.geometry.x for m in self._meshes),
            *(with_conditions(f, self._bcs) for f in self._unknowns if not self.linear),
        ]

    def _assemble(self, changed: bool) -> PETSc.Mat:
        """Return the matrix; prescribed dofs have rows and columns of the identity, scaled."""
        matrix = self._offered
        if offered := matrix is not None and not changed:
            self._offered = None
        else:
            self.discard()
            matrix = self._assemble_anew()
        if whole := not self.linear:
            self._lift(matrix)
        first = matrix.getOwnershipRange()[0]
        for held, size in self._held_sizes(matrix):
            rows = (first + held).astype(PETSc.IntType)
            if offered or whole:
                matrix.zeroRowsColumns(rows, diag=size)
            else:  # zero already
                matrix.zeroRows(rows, diag=size)
        return matrix

    def _assemble_anew(self) -> PETSc.Mat:
        """Assemble the matrix from the user's forms."""
        if self._forms is None:
            self._forms = compiled(fem.form, self._comm)(self._tangents, entity_maps=self._maps)
        bcs = self._bcs if self.linear else []
        if len(self._unknowns) == 1:
            matrix = assemble_matrix(self._forms[0][0], bcs=bcs)
        else:
            matrix = assemble_matrix(self._forms, bcs=bcs, kind="mpi")
        matrix.assemble()
        if len(self._unknowns) > 1:
            add_diagonal(matrix)
        return matrix

    def _lift(self, matrix: PETSc.Mat) -> None:
        """Find the forces of prescribed values that the unknowns do not have yet.

        To set the values first would distort the cells beside them.
        """
        missing, forces = matrix.createVecs()
        missing.array[:] = np.concatenate(
            [(with_conditions(f, self._bcs) - f.x.array)[: num_owned(f)] for f in self._unknowns]
        )
        matrix.mult(missing, forces)
        self._lifted = forces.array.copy()
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
