# SPDX-License-Identifier: MIT
"""The ways to solve the substeps of a problem: on the whole system, or on its boundary."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from contextlib import AbstractContextManager

from petsc4py import PETSc

import numpy as np

from ..base.errors import ContactInputError
from ..base.log import tell
from .boundary_newton import BoundaryNewton
from .choice import suits_boundary
from .condensed_bulk import Array
from .newton import Newton
from .schur import FactorFailed


class Solvers:
    """Knows all solvers of a problem, and which one is in use.

    Args:
        full: Solves the whole system.
        boundary: Solves on the dofs of contact, if the problem allows it.
        reason: Why it does not.
        linear_solvers: Those of the full solver, in the order in which they are tried.

    Attributes:
        full, linear_solvers: As given.
        now: The one in use; the full one but inside of :meth:`use`.
    """

    def __init__(
        self,
        full: Newton,
        boundary: BoundaryNewton | None,
        reason: str,
        linear_solvers: Sequence[str],
    ) -> None:
        self.full, self._boundary, self._reason = full, boundary, reason
        self.linear_solvers = list(linear_solvers)
        self._useful: set[str] = set()
        self.now: Newton | BoundaryNewton = full

    def condensing(self, how: str) -> bool:
        """Tell whether steps are to be solved on the boundary.

        Args:
            how: ``"auto"``, ``"condensed"`` or ``"full"``.

        Raises:
            ContactInputError: If that is not possible.
        """
        if how == "condensed" and self._boundary is None:
            raise ContactInputError(
                f"settings.solver = 'condensed': {self._reason}; take 'auto' or 'full'."
            )
        if self._boundary is None:
            return False
        bulk, unknowns = self._boundary.equations.bulk, self.full.unknowns
        cheaper = self.linear_solvers[0] == "direct" and suits_boundary(bulk, unknowns[0])
        if how == "condensed" or (how == "auto" and cheaper):
            return True
        bulk.discard()
        return False

    @property
    def factorisations(self) -> int:
        """How often the condensed bulk was factored."""
        return 0 if self._boundary is None else self._boundary.equations.bulk.factorisations

    @property
    def relinearises(self) -> bool:
        """Whether the boundary's equations hold to first order only: the bulk is not linear."""
        return self._boundary is not None and not self._boundary.equations.bulk.linear

    @property
    def approximate(self) -> bool:
        """Whether the equations in use do so."""
        return self.now is self._boundary and self.relinearises

    def linearised_at(self) -> list[Array]:
        """Return the unknowns when the bulk was condensed last, but for multipliers."""
        assert self._boundary is not None
        equations = self._boundary.equations
        return [*equations.bulk.origin, *equations.bodies.origin]

    def condense(self) -> float | None:
        """Condense the bulk under the loads of a step; the unknowns get their prescribed values.

        Returns the 2-norm of the forces without contact (N), or ``None`` if it is not possible.
        """
        assert self._boundary is not None
        bulk = self._boundary.equations.bulk
        try:
            bulk.refresh()
            forces = self._boundary.equations.begin()
        except (FactorFailed, PETSc.Error) as error:
            tell(self.full.comm, logging.DEBUG, "the bulk cannot be condensed: %s", error)
            bulk.discard()
            return None
        return forces if np.isfinite(forces) else None

    def prepared(self) -> bool:
        """Tell whether the bulk is condensed; one that is not linear is, at the present state."""
        assert self._boundary is not None
        return self._boundary.equations.bulk.linear or self.condense() is not None

    def use(self, *, condensed: bool) -> AbstractContextManager[None]:
        """Solve on the boundary inside, or the whole system."""
        return _InUse(self, condensed)

    def keep(self, linear_solver: str) -> None:
        """Note that a linear solver of the full solver has solved a step.

        Those before it, which could not, are not tried again unless they have solved a step before.
        """
        if failed := self.linear_solvers[: self.linear_solvers.index(linear_solver)]:
            useless = [name for name in failed if name not in self._useful]
            message = "%s could not solve this step, %s could" + (
                " and is used from now on" if useless else ""
            )
            tell(self.full.comm, logging.WARNING, message, " and ".join(failed), linear_solver)
            self.linear_solvers = [n for n in self.linear_solvers if n not in useless]
        self._useful.add(linear_solver)

    def take(self, condensed: bool) -> None:
        """Solve on the boundary from now on, or the whole system."""
        if not condensed:
            self.now = self.full
            return
        assert self._boundary is not None
        self._boundary.equations.bulk.enter()
        self.now = self._boundary

    def put_back(self, before: Newton | BoundaryNewton) -> None:
        """Use the solver of before again, and free the memory of a dense matrix."""
        self.now = before
        if self._boundary is not None:
            self._boundary.equations.forget_matrix()

    def recover(self) -> None:
        """Find the unknowns inside a condensed bulk from those of the boundary."""
        assert self._boundary is not None
        if self._boundary.equations.bulk.is_condensed:
            self._boundary.equations.bulk.recover()

    def begin_anew(self) -> None:
        """Forget what an iterative solver has learnt: a resumed run does not know it.

        Factors stay: they do not depend on the steps before.
        """
        if self.full.multigrid is not None:
            self.full.multigrid.forget()

    def discard(self) -> None:
        """Forget all that may be incomplete after an error."""
        self.now = self.full  # an interrupt may have come before it was put back
        self.full.discard()
        if self._boundary is not None:
            self._boundary.discard()


class _InUse(AbstractContextManager[None]):
    """One solver is in use inside.

    No generator: an interrupt between its lines would leave one behind, and its end, whenever it
    comes, would put a solver back into use.
    """

    def __init__(self, solvers: Solvers, condensed: bool) -> None:
        self._solvers, self._condensed, self._before = solvers, condensed, solvers.now

    def __enter__(self) -> None:
        self._solvers.take(self._condensed)

    def __exit__(self, *_: object) -> None:
        self._solvers.put_back(self._before)
