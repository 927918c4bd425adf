# SPDX-License-Identifier: MIT
"""One kind of substep: rows of contact, solved by SNES with a convergence test made for contact."""

from __future__ import annotations

import logging
import sys
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from petsc4py import PETSc

from dolfinx import fem
from ufl.core.expr import Expr

from ..base.errors import OutOfMemory
from ..base.log import tell
from ..contact.contact import Contact
from ..equations.contact_terms import Law
from .boundary_newton import BoundaryNewton
from .convergence import Progress
from .linear import (
    MORE_WORKSPACE,
    factor_failure,
    forget_factor,
    krylov_failure,
    out_of_memory,
)
from .newton import Newton
from .options import inside, reason_name
from .report import SubstepReport
from .solvers import Solvers

#: The linear solve failed.
LINEAR = PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE


class Substep:
    """The residual of a problem with one kind of contact rows.

    The rows are compiled at the first use: a substep that a corrector never needs costs nothing.

    Args:
        name, prefix: The prefix of its PETSc options is ``{prefix}{name}_``.
        solvers: The solvers of all substeps.
        rows: Returns the rows of a contact.

    Attributes:
        watch: Called with the number of each iterate, while the Functions hold it; or ``None``.
    """

    def __init__(
        self, name: str, prefix: str, solvers: Solvers, rows: Callable[[Contact], Expr]
    ) -> None:
        self.name, self._prefix = name, f"{prefix}{name}_"
        self._solvers, self._rows, self._scales = solvers, rows, solvers.full.scales
        self._law: Law | None = None
        self.watch: Callable[[int], None] | None = None
        self._progress, self._failure, self._spent, self._krylov = self._new_progress(0.0), "", 0, 0

    @property
    def _newton(self) -> Newton | BoundaryNewton:
        """The solver in use."""
        return self._solvers.now

    def _new_progress(self, tolerance: float) -> Progress:
        """Return what follows a solve to this tolerance."""
        return Progress(self._newton.measure, tolerance, cheap=self._newton.cheap)

    @property
    def law(self) -> Law:
        """The rows at the nodes, with their derivatives."""
        if self._law is None:
            self._law = self._solvers.full.terms.law(self._rows)
        return self._law

    @property
    def solver(self) -> PETSc.SNES:
        """The nonlinear solver of this substep."""
        # Weak: in a cycle, each rank's garbage collector would destroy collective objects.
        test = weakref.WeakMethod(self._test)
        return self._newton.solver(self._prefix, lambda *arguments: test()(*arguments))  # type: ignore[misc]

    def jacobian(self) -> PETSc.Mat:
        """Assemble the matrix of Newton's method at the current unknowns; the SNES owns it."""
        with self._guarded():
            x = self._newton.prepare(self.solver, self.law)
            matrix = self.solver.getJacobian()[0]
            self.solver.computeJacobian(x, matrix)
        return matrix

    def residual(self) -> PETSc.Vec:
        """Return a copy of the residual at the current unknowns."""
        with self._guarded():
            return self._newton.residual(self.law)

    def unbalanced(self) -> float:
        """Return the 2-norm (N) of the residual at the current unknowns, without held rows."""
        residual = self.residual()
        residual.array[self._scales.held_rows] = 0.0
        norm = float(residual.norm())
        residual.destroy()
        return norm

    def is_solved(self, tolerance: float) -> bool:
        """Tell whether the current unknowns solve the substep to a relative tolerance."""
        residual = self.residual()
        solved = self._newton.measure.excess(residual.array_r, tolerance) <= 1.0
        residual.destroy()
        return solved

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Discard the solver after an error, and raise what a callback raised."""
        errors, outer = self._newton.errors, sys.exc_info()[1]
        errors.error = None
        try:
            yield
        except (PETSc.Error, SystemError) as error:  # the latter: an interrupt inside petsc4py
            self._solvers.discard()
            cause = errors.error or error.__cause__ or error.__context__
            if cause is not None and cause is not outer:  # which is handled further up
                raise cause from None
            raise
        except BaseException:
            self._solvers.discard()
            raise

    def solve(
        self,
        tolerance: float,
        *,
        xi: float,
        eps: float,
        line_search: str | None = None,
        max_it: int | None = None,
        target: PETSc.Vec | None = None,
    ) -> SubstepReport:
        """Solve from the current values of the unknowns; they hold the last iterate after.

        Args:
            tolerance: Newton stops when all residuals are this small, relative to the forces of
                their body and contact.
            xi: For the report.
            eps: For the report.
            line_search: PETSc line search in place of the options' one.
            max_it: Iterations in place of the options' ``snes_max_it``.
            target: Residual to reach instead of zero.

        Returns what happened. Not converging is no exception: the certificate decides.
        """
        snes, options = self.solver, self._newton.options
        chosen, limit = options["snes_linesearch_type"], options["snes_max_it"]
        snes.getLineSearch().setType(str(line_search or chosen))
        snes.setTolerances(max_it=int(str(max_it or limit)))
        self._progress = self._new_progress(tolerance)
        self._failure, self._spent, self._krylov = "", 0, 0
        converged, reason = self._run(target)
        history = self._progress.history
        iterations = self._spent + max(len(history) - 1, 0)
        message = "%s: %d iterations, %s"
        tell(self._newton.comm, logging.DEBUG, message, self.name, iterations, reason)
        return SubstepReport(
            name=self.name,
            xi=xi,
            eps=eps,
            iterations=iterations,
            converged=converged,
            reason="CYCLE" if self._progress.cycled else reason,
            residuals=tuple(history),
            failure=self._failure,
            solver=self._newton.name,
            krylov=self._krylov if self._newton.iterative else 0,
        )

    def _run(self, target: PETSc.Vec | None) -> tuple[bool, str]:
        """Solve; once more if the linear solver failed for a reason that can be mended."""
        unknowns, options = self._newton.unknowns, dict(self._newton.options)
        start = [f.x.array.copy() for f in unknowns]
        found = self._run_once(target, options)
        if self.solver.getConvergedReason() == LINEAR and self._newton.may_try_again(self.solver):
            for f, values in zip(unknowns, start, strict=True):
                f.x.array[:] = values
            self._spent = len(self._progress.history) - 1
            self._progress = self._new_progress(self._progress.tolerance)
            found = self._run_once(target, MORE_WORKSPACE | options)
        if self.solver.getConvergedReason() == LINEAR:
            self._explain_failure(self.solver)
        return found

    def _run_once(self, target: PETSc.Vec | None, options: dict[str, object]) -> tuple[bool, str]:
        """Solve as ``NonlinearProblem.solve``, which knows no right-hand side."""
        snes = self.solver
        try:
            with self._guarded(), inside(self._prefix, options):
                x = self._newton.prepare(snes, self.law)
                snes.solve(target, x)
        except PETSc.Error as error:
            # MUMPS gives up on a structurally singular matrix with an error, not a reason.
            self._failure = f"PETSc says: {str(error).splitlines()[-1]}"
            return False, f"LINEAR_SOLVER_ERROR_{error.ierr}"
        self._newton.take(x)
        self._krylov += snes.getLinearSolveIterations()
        reason = snes.getConvergedReason()
        return reason > 0, reason_name(reason)

    def _explain_failure(self, snes: PETSc.SNES) -> None:
        """Say why a factorisation failed, and forget the factor, which cannot be used then."""
        self._failure = factor_failure(snes) or krylov_failure(snes) or self._failure
        memory = out_of_memory(snes)
        forget_factor(snes)
        if memory:
            raise OutOfMemory(
                f"The {self.name} substep could not be solved: {self._failure}. The last accepted "
                "state was restored."
            )

    def _test(
        self, snes: PETSc.SNES, it: int, norms: tuple[float, float, float]
    ) -> PETSc.SNES.ConvergedReason:
        """Judge an iterate, which the Functions hold; keep what is raised."""
        with self._newton.errors():
            if self.watch is not None:
                self.watch(it)
            reason = self._progress.judge(snes, it, norms[-1])
            self._newton.aim(snes, self._progress)
            return reason


def substeps(
    prefix: str, solvers: Solvers, eps: fem.Constant, xi: fem.Constant, sign: fem.Constant
) -> tuple[Substep, Substep, Substep]:
    """Return the stick predictor, the slip corrector and the natural map."""
    return (
        Substep("stick", prefix, solvers, lambda k: k.rows.stick(eps)),
        Substep("slip", prefix, solvers, lambda k: k.rows.slip(eps, xi, sign)),
        Substep("projection", prefix, solvers, lambda k: k.rows.projection(eps, xi)),
    )
