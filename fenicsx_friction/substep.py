# SPDX-License-Identifier: MIT
"""One kind of substep: a ``NonlinearProblem`` with a convergence test made for contact."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assign
from ufl.core.expr import Expr

from .compat import jacobian_blocks
from .compilation import NonlinearProblem, compiled
from .coupled_solver import CoupledSolver
from .coupling import Coupling

if TYPE_CHECKING:
    from .contact import Contact

DEFAULT_OPTIONS: dict[str, object] = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "basic",
    "snes_max_it": 30,
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}

#: PETSc's code of an exception in a Python callback.
PYTHON_ERROR = 101
#: Reductions of the residual below which stagnation is taken for rounding.
ROUNDING = 1e-8
#: A residual that returns to this relative accuracy within 15 iterations is a cycle.
CYCLE = 1e-6
#: So many full Newton steps without a smaller residual are a cycle, too.
STALLED = 8


@dataclass(frozen=True)
class SubstepReport:
    """How one substep went.

    Attributes:
        name: ``stick``, ``slip`` or ``projection``.
        xi: Blend of the slip rows (0 where they are not used).
        eps: Smoothing of the normal complementarity (Pa).
        iterations: Newton iterations, each one linear solve.
        converged: Whether the residual met its tolerance.
        reason: PETSc's name of the reason, or ``CYCLE``.
        residuals: 2-norms of the residual (N), one an iteration and the initial one.
        accepted: Whether the substep's end state was used.
    """

    name: str
    xi: float
    eps: float
    iterations: int
    converged: bool
    reason: str
    residuals: tuple[float, ...]
    accepted: bool = True


class Substep:
    """A residual in all unknowns of the problem, solved by SNES.

    The forms are compiled at the first use: a substep that a corrector never needs costs nothing.

    Args:
        name: Name of the substep, part of its options prefix.
        forms: Residual blocks.
        unknowns: The Functions solved for.
        bcs: Dirichlet conditions on any of them.
        prefix: Prefix of the PETSc options; the substep's is ``{prefix}{name}_``.
        options: PETSc options over :data:`DEFAULT_OPTIONS`.
        entity_maps: Entity maps of all meshes in the forms.
        coupling: The pairs of contacts with deformable obstacles, if any.
        rows: Returns the contact rows, to be differentiated by the pairs' kinematics.
    """

    def __init__(
        self,
        name: str,
        forms: Sequence[ufl.Form],
        unknowns: Sequence[fem.Function],
        bcs: Sequence[fem.DirichletBC],
        prefix: str,
        options: Mapping[str, object] | None,
        entity_maps: Sequence[mesh.EntityMap],
        coupling: Coupling | None,
        rows: Callable[[Contact], Expr],
    ) -> None:
        self.name, self._forms, self._unknowns = name, forms, unknowns
        self._bcs, self._entity_maps = bcs, entity_maps
        self._prefix = f"{prefix}{name}_"
        self._options = {**DEFAULT_OPTIONS, **(options or {})}
        self._coupling, self._rows = coupling, rows
        self._problem: NonlinearProblem | None = None
        self._coupled: CoupledSolver | None = None
        self._history: list[float] = []
        self._cycled = False

    @property
    def problem(self) -> NonlinearProblem:
        """The DOLFINx problem, with its ``solver`` (SNES), ``A`` and ``b``."""
        if self._problem is None:
            self._problem = compiled(NonlinearProblem, self._unknowns[0].function_space.mesh.comm)(
                list(self._forms),
                list(self._unknowns),
                J=jacobian_blocks(self._forms, self._unknowns),
                bcs=list(self._bcs),
                petsc_options_prefix=self._prefix,
                petsc_options=self._options,
                entity_maps=list(self._entity_maps),
                kind="mpi",
            )
            # Weakly: in a cycle through PETSc, each rank's garbage collector would choose when to
            # destroy the collective objects.
            test = weakref.WeakMethod(self._test)
            self._problem.solver.setConvergenceTest(lambda *arguments: test()(*arguments))  # type: ignore[misc]
            if self._coupling is not None:
                laws = self._coupling.law_derivatives(self._rows)
                snes = self._problem.solver
                self._coupled = CoupledSolver(snes, self._unknowns, self._coupling, laws)
        return self._problem

    def residual(self) -> PETSc.Vec:
        """Return a copy of the residual at the current unknowns."""
        self.residual_norms()
        return self.problem.b.copy()

    def jacobian(self) -> PETSc.Mat:
        """Assemble the matrix of Newton's method at the current unknowns; the SNES owns it."""
        problem = self.problem
        assign(problem.u, problem.x)
        if self._coupled is not None:
            self._coupled.prepare(problem.solver, problem.x)
        matrix = problem.solver.getJacobian()[0]
        problem.solver.computeJacobian(problem.x, matrix)
        return matrix

    def residual_norms(self) -> tuple[float, float]:
        """Return 2-norm and largest entry of the residual (N) at the current unknowns."""
        problem = self.problem
        assign(problem.u, problem.x)
        problem.solver.computeFunction(problem.x, problem.b)
        return float(problem.b.norm()), float(problem.b.norm(PETSc.NormType.INFINITY))

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
            tolerance: Residual 2-norm (N) at which Newton stops.
            xi: For the report.
            eps: For the report.
            line_search: PETSc line search in place of the options' one.
            max_it: Iterations in place of the options' ``snes_max_it``.
            target: Residual to reach instead of zero.

        Returns:
            What happened. Not converging is no exception: the certificate decides.
        """
        problem = self.problem
        snes = problem.solver
        chosen, limit = self._options["snes_linesearch_type"], self._options["snes_max_it"]
        snes.getLineSearch().setType(str(line_search or chosen))
        snes.setTolerances(atol=tolerance, max_it=int(str(max_it or limit)))
        self._history, self._cycled = [], False
        converged, reason = self._run(problem, target)
        return SubstepReport(
            name=self.name,
            xi=xi,
            eps=eps,
            iterations=max(len(self._history) - 1, 0),
            converged=converged,
            reason="CYCLE" if self._cycled else reason,
            residuals=tuple(self._history),
        )

    def _run(self, problem: NonlinearProblem, target: PETSc.Vec | None) -> tuple[bool, str]:
        """Solve as ``NonlinearProblem.solve``, which knows no right-hand side."""
        assign(problem.u, problem.x)
        if self._coupled is not None:
            self._coupled.prepare(problem.solver, problem.x)
        try:
            problem.solver.solve(target, problem.x)
        except PETSc.Error as error:
            if error.ierr == PYTHON_ERROR:
                raise
            # MUMPS gives up on a structurally singular matrix with an error, not a reason, and its
            # factors cannot be used again.
            self._problem = self._coupled = None
            return False, f"LINEAR_SOLVER_ERROR_{error.ierr}"
        problem.x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
        assign(problem.x, problem.u)
        reason = problem.solver.getConvergedReason()
        return reason > 0, _reason_name(reason)

    def _test(
        self, snes: PETSc.SNES, it: int, norms: tuple[float, float, float]
    ) -> PETSc.SNES.ConvergedReason:
        """Stop at the tolerance, at rounding, at NaN, at the last iteration and in a cycle."""
        reason, norm = PETSc.SNES.ConvergedReason, norms[-1]
        _, atol, _, max_it = snes.getTolerances()
        self._history.append(norm)
        if not np.isfinite(norm):
            return reason.DIVERGED_FNORM_NAN
        if norm <= atol:
            return reason.CONVERGED_FNORM_ABS
        if it > 0 and norm <= ROUNDING / 1e-11 * atol and norm >= 0.5 * self._history[-2]:
            return reason.CONVERGED_SNORM_RELATIVE
        recent, before = self._history[-STALLED:], self._history[:-STALLED]
        self._cycled = any(abs(norm - old) <= CYCLE * norm for old in self._history[-16:-2])
        # A line search decreases the residual, if slowly; full steps should not need to wait.
        full_steps = snes.getLineSearch().getType() == PETSc.SNESLineSearch.Type.BASIC
        self._cycled |= full_steps and len(before) > 2 and min(recent) > 0.9 * min(before)
        if self._cycled or it >= max_it:
            return reason.DIVERGED_MAX_IT
        return reason.ITERATING


def _reason_name(value: int) -> str:
    """Return PETSc's name of a converged reason."""
    names = PETSc.SNES.ConvergedReason.__dict__.items()
    return next((name for name, number in names if number == value and "_" in name), str(value))
