# SPDX-License-Identifier: MIT
"""One kind of substep: a ``NonlinearProblem`` with a convergence test made for contact."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assign
from ufl.core.expr import Expr

from ..base.compat import jacobian_blocks
from ..base.compilation import NonlinearProblem, compiled
from ..base.errors import ContactInputError, OutOfMemory
from ..certificate.scales import COARSEST
from .coupled_solver import CoupledCallbacks
from .coupling import Coupling
from .forces import ForceScales
from .linear import factor_failure, forget_factor, out_of_memory, require_solver
from .report import SubstepReport
from .snes_callbacks import Callbacks

if TYPE_CHECKING:
    from ..contact.contact import Contact

DEFAULT_OPTIONS: dict[str, object] = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "basic",
    "snes_max_it": 30,
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}

#: A residual that no step makes smaller, but below this, relative, is taken for rounding.
ROUNDING = 1e-8
#: A residual that returns to this relative accuracy within 15 iterations is a cycle.
CYCLE = 1e-6
#: So many full Newton steps without a smaller residual are a cycle, too, and as many as the square
#: root of the number of contact nodes: on fine meshes, fronts of slip move by a few nodes a step.
STALLED = 8


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
        scales: Measures residuals.
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
        scales: ForceScales,
        coupling: Coupling | None,
        rows: Callable[[Contact], Expr],
    ) -> None:
        self.name, self._forms, self._unknowns = name, forms, unknowns
        self._bcs, self._entity_maps = bcs, entity_maps
        self._prefix = f"{prefix}{name}_"
        self._options = {**DEFAULT_OPTIONS, **(options or {})}
        self._scales, self._coupling, self._rows = scales, coupling, rows
        require_solver(self._options, unknowns[0].function_space.mesh.comm)
        self._problem: NonlinearProblem | None = None
        self._callbacks: Callbacks | None = None
        self._history: list[float] = []
        self._cycled, self._tolerance, self._failure = False, 0.0, ""

    @property
    def problem(self) -> NonlinearProblem:
        """The DOLFINx problem, with its ``solver`` (SNES), ``A`` and ``b``."""
        if self._problem is None:
            make = compiled(NonlinearProblem, self._unknowns[0].function_space.mesh.comm)
            made = make(
                list(self._forms),
                list(self._unknowns),
                J=jacobian_blocks(self._forms, self._unknowns),
                bcs=list(self._bcs),
                petsc_options_prefix=self._prefix,
                entity_maps=list(self._entity_maps),
                kind="mpi",
            )
            _set_up(made.solver, self._options)
            snes, factors = made.solver, self._scales.row_factors
            # Weakly: in a cycle through PETSc, each rank's garbage collector would choose when to
            # destroy the collective objects.
            test = weakref.WeakMethod(self._test)
            snes.setConvergenceTest(lambda *arguments: test()(*arguments))  # type: ignore[misc]
            if self._coupling is None:
                self._callbacks = Callbacks(snes, factors)
            else:
                laws = self._coupling.law_derivatives(self._rows)
                self._callbacks = CoupledCallbacks(
                    snes, factors, self._unknowns, self._coupling, laws
                )
            self._problem = made
        return self._problem

    def jacobian(self) -> PETSc.Mat:
        """Assemble the matrix of Newton's method at the current unknowns; the SNES owns it."""
        with self._guarded():
            problem = self._prepared()
            matrix = problem.solver.getJacobian()[0]
            problem.solver.computeJacobian(problem.x, matrix)
        return matrix

    def residual(self) -> PETSc.Vec:
        """Return a copy of the residual at the current unknowns."""
        problem = self.problem
        with self._guarded():
            assign(problem.u, problem.x)
            problem.solver.computeFunction(problem.x, problem.b)
        return problem.b.copy()

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
        solved = self._scales.excess(residual.array_r, tolerance) <= 1.0
        residual.destroy()
        return solved

    def _prepared(self) -> NonlinearProblem:
        """Return the problem with the current unknowns in its vector, ready for a solve."""
        problem = self.problem
        assign(problem.u, problem.x)
        assert self._callbacks is not None
        self._callbacks.prepare(problem.solver, problem.x)
        return problem

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Discard the solver after an error, and raise what a callback raised."""
        try:
            yield
        except PETSc.Error as error:
            cause = error.__context__ if self._callbacks is None else self._callbacks.error
            self.discard()
            if cause is not None:
                raise cause from None
            raise
        except BaseException:
            self.discard()
            raise

    def discard(self) -> None:
        """Forget solver and matrices, which an error may have left half done."""
        self._problem = self._callbacks = None

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

        Returns:
            What happened. Not converging is no exception: the certificate decides.
        """
        problem = self.problem
        snes = problem.solver
        chosen, limit = self._options["snes_linesearch_type"], self._options["snes_max_it"]
        snes.getLineSearch().setType(str(line_search or chosen))
        snes.setTolerances(max_it=int(str(max_it or limit)))
        self._history, self._cycled, self._tolerance = [], False, tolerance
        self._failure = ""
        converged, reason = self._run(problem, target)
        return SubstepReport(
            name=self.name,
            xi=xi,
            eps=eps,
            iterations=max(len(self._history) - 1, 0),
            converged=converged,
            reason="CYCLE" if self._cycled else reason,
            residuals=tuple(self._history),
            failure=self._failure,
        )

    def _run(self, problem: NonlinearProblem, target: PETSc.Vec | None) -> tuple[bool, str]:
        """Solve as ``NonlinearProblem.solve``, which knows no right-hand side."""
        try:
            with self._guarded(), _options(problem.solver, self._options):
                self._prepared()
                problem.solver.solve(target, problem.x)
        except PETSc.Error as error:
            # MUMPS gives up on a structurally singular matrix with an error, not a reason.
            return False, f"LINEAR_SOLVER_ERROR_{error.ierr}"
        problem.x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
        assign(problem.x, problem.u)
        reason = problem.solver.getConvergedReason()
        if reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
            self._explain_failure(problem.solver)
        return reason > 0, _reason_name(reason)

    def _explain_failure(self, snes: PETSc.SNES) -> None:
        """Say why a factorisation failed, and forget the factor, which is spoilt then."""
        self._failure = factor_failure(snes)
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
        """Keep what the test raises, see ``Callbacks``."""
        assert self._callbacks is not None
        with self._callbacks.keeping_errors():
            return self._judge(snes, it, norms[-1])

    def _judge(self, snes: PETSc.SNES, it: int, norm: float) -> PETSc.SNES.ConvergedReason:
        """Stop at the tolerance, at rounding, at NaN, at the last iteration and in a cycle."""
        reason, max_it = PETSc.SNES.ConvergedReason, snes.getTolerances()[3]
        self._history.append(norm)
        if not np.isfinite(norm):
            return reason.DIVERGED_FNORM_NAN
        rows = snes.getFunction()[0].array_r
        if self._scales.excess(rows, self._tolerance) <= 1.0:
            return reason.CONVERGED_FNORM_ABS
        if it > 0 and norm >= 0.5 * self._history[-2] and self._is_rounding(rows):
            return reason.CONVERGED_SNORM_RELATIVE
        patience = max(STALLED, math.isqrt(self._scales.contact_nodes))
        recent, before = self._history[-patience:], self._history[:-patience]
        self._cycled = any(abs(norm - old) <= CYCLE * norm for old in self._history[-16:-2])
        # A line search decreases the residual, if slowly; full steps should not need to wait.
        full_steps = snes.getLineSearch().getType() == PETSc.SNESLineSearch.Type.BASIC
        self._cycled |= full_steps and len(before) > 2 and min(recent) > 0.9 * min(before)
        if self._cycled or it >= max_it:
            return reason.DIVERGED_MAX_IT
        return reason.ITERATING

    def _is_rounding(self, rows: np.ndarray) -> bool:
        """Tell whether a residual that no step makes smaller is rounding; collective."""
        if self._scales.excess(rows, max(ROUNDING, self._tolerance)) <= 1.0:
            return True
        if self._scales.excess(rows, COARSEST) > 1.0:
            return False
        self._scales.find_noise()
        return self._scales.excess(rows, self._tolerance) <= 1.0


@contextmanager
def _options(snes: PETSc.SNES, options: Mapping[str, object]) -> Iterator[None]:
    """Put options into PETSc's database inside the context only.

    A later solver of the same prefix must not find them; MUMPS reads its own as late as in the
    first factorisation.
    """
    database = PETSc.Options(snes.getOptionsPrefix())
    before = {k: database.getString(k) for k in options if database.hasName(k)}
    try:
        for name, value in options.items():
            database.setValue(name, value)
        yield
    finally:
        for name in options:
            database.delValue(name)
        for name, text in before.items():
            database.setValue(name, text)


def _set_up(snes: PETSc.SNES, options: Mapping[str, object]) -> None:
    """Set up a solver, or say which options PETSc refuses."""
    try:
        with _options(snes, options):
            snes.setFromOptions()
    except PETSc.Error as error:
        raise ContactInputError(
            f"PETSc refuses the petsc_options {dict(options)}: {str(error).splitlines()[-1]}"
        ) from error


def _reason_name(value: int) -> str:
    """Return PETSc's name of a converged reason."""
    names = PETSc.SNES.ConvergedReason.__dict__.items()
    return next((name for name, number in names if number == value and "_" in name), str(value))
