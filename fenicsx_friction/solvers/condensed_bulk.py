# SPDX-License-Identifier: MIT
"""The bulk of a problem, factored and condensed to the dofs of contact.

The factor lives as long as all that its matrix depends on: fields and Constants in the tangent, and
the mesh. This is compared, value by value, at the start of each step: a bulk that is linear in its
unknowns is factored once. One that is not is linearised at the present state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, mesh

from ..base.collective import gather_rows
from ..contact.contact import Contact
from ..equations.conditions import constrained_dofs, with_conditions
from ..equations.numbering import contact_dofs, global_dofs, num_owned
from .bulk_tangent import BulkTangent
from .linear import MORE_WORKSPACE, WORKSPACE
from .options import inside
from .schur import FactorFailed, InnerFactor, inner_factor

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
        residuals: Returns the rows of the residuals at the owned dofs, without contact; those of
            other unknowns after these.
        prefix: Prefix of the PETSc options of the factor.
        options: PETSc options.
        matrix: The tangent as it is now, without conditions, if it is at hand.

    Attributes:
        linear: Whether the tangents do not depend on the unknowns.
        dofs: The owned free dofs of the displacement at nodes that contact may load.
        origin: The unknowns when the loads were condensed.
        start: Displacements of all ranks' dofs of contact when the loads were condensed (m).
        others: The rows of the other unknowns then.
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
        self._comm = V.mesh.comm
        self._tangent = BulkTangent(tangents, unknowns, bcs, entity_maps, matrix)
        self.linear, self._held = self._tangent.linear, self._tangent.held
        self.dofs = np.setdiff1d(contact_dofs(contacts, V), constrained_dofs(V, bcs))
        rows = global_dofs([f.function_space for f in unknowns])  # the displacement's come first
        self._counts = np.array(self._comm.allgather(len(self.dofs)))
        self._chosen = gather_rows(self._comm, rows[0][self.dofs], self._counts)
        self._factor: InnerFactor | None = None
        self.factorisations = 0

    @property
    def size(self) -> int:
        """Number of dofs of contact on all ranks."""
        return int(np.sum(self._counts))

    @property
    def is_condensed(self) -> bool:
        """Whether there is a factor."""
        return self._factor is not None

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
        changed = self._tangent.has_changed()
        if self._factor is not None and not changed:
            return
        self._forget_factor()
        self._tangent.refresh(changed=changed)
        try:
            self._factor = self._factored(self._options)
        except FactorFailed as error:
            if error.code not in WORKSPACE:
                raise
            self._factor = self._factored(MORE_WORKSPACE | dict(self._options))
        self.factorisations += 1

    def _factored(self, options: Mapping[str, object]) -> InnerFactor:
        """Return a new factor."""
        package = str(self._options["pc_factor_mat_solver_type"])
        with inside(self._prefix, options):
            return inner_factor(self._matrix, self._chosen, package, self._prefix)

    @property
    def _matrix(self) -> PETSc.Mat:
        """The matrix that was factored."""
        assert self._tangent.matrix is not None
        return self._tangent.matrix

    def discard(self) -> None:
        """Forget matrix and factor."""
        self._tangent.discard()
        self._forget_factor()

    def _forget_factor(self) -> None:
        """Free the factor, before there is another one."""
        if self._factor is not None:
            self._factor.destroy()
        self._factor = None

    def enter(self) -> None:
        """Give the unknowns their prescribed values."""
        for f in self._unknowns:
            f.x.array[:] = with_conditions(f, self._bcs)

    def begin(self) -> float:
        """Condense the loads of a step, from the present state; enters.

        Returns the 2-norm of the residual without contact (N).
        """
        assert self._factor is not None
        r, y = self._matrix.createVecLeft(), self._matrix.createVecRight()
        self.origin = [f.x.array.copy() for f in self._unknowns]
        if self.linear:
            self.enter()
        rows, own = list(self._residuals()), len(self._unknowns)
        r.array[:], self.others = np.concatenate(rows[:own]) + self._tangent.lifted, rows[own:]
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
        assert self._factor is not None
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
