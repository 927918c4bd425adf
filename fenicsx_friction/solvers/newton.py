# SPDX-License-Identifier: MIT
"""Newton's method for the whole system: forms, terms of contact, one matrix and one factor."""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping, Sequence

from mpi4py import MPI
from petsc4py import PETSc

import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assign

from ..base.compat import jacobian_blocks
from ..base.compilation import NonlinearProblem, compiled
from ..base.keeping import ErrorKeeper
from ..equations.conditions import with_conditions
from ..equations.contact_terms import ContactTerms, Law
from ..equations.dependencies import Dependencies
from ..equations.forces import ForceScales
from .convergence import Progress
from .inexact import accuracy
from .linear import forget_factor, require_solver, workspace_too_small
from .multigrid import Multigrid
from .options import effective, options_of, set_up
from .snes_callbacks import Callbacks


class Newton:
    """A ``NonlinearProblem`` of all unknowns; each substep brings its rows of contact.

    The matrix and its factor belong to all substeps. Forms are compiled at the first use.

    Args:
        forms: Residual blocks; those of the multipliers are empty and only keep their place.
        unknowns: The Functions solved for.
        bcs: Dirichlet conditions on any of them.
        prefix: Prefix of the PETSc options.
        options: PETSc options over :data:`DEFAULT_OPTIONS`.
        entity_maps: Entity maps of all meshes in the forms.
        scales: Measures residuals.
        terms: The terms of contact.
        linear_solver: The one to begin with, ``direct`` or ``multigrid``.

    Attributes:
        unknowns: As given.
        given, options: The options as given, and all.
        scales: As given.
        terms: As given.
        errors: What callbacks have raised.
        linear_solver: The one in use.
        multigrid: The preconditioner, once there is one.
    """

    name, cheap = "full", False

    def __init__(
        self,
        forms: Sequence[ufl.Form],
        unknowns: Sequence[fem.Function],
        bcs: Sequence[fem.DirichletBC],
        prefix: str,
        options: Mapping[str, object] | None,
        entity_maps: Sequence[mesh.EntityMap],
        scales: ForceScales,
        terms: ContactTerms,
        linear_solver: str,
    ) -> None:
        self._forms, self.unknowns, self._bcs = forms, unknowns, bcs
        self._prefix, self._entity_maps = prefix, entity_maps
        self.given = options or {}
        self.options = options_of(linear_solver, self.given)
        self.scales, self.terms = scales, terms
        self.comm = unknowns[0].function_space.mesh.comm
        self.linear_solver = linear_solver
        require_solver(self.options, self.comm)
        self._problem: NonlinearProblem | None = None
        self._callbacks: Callbacks | None = None
        self.errors = ErrorKeeper()
        self._solvers: dict[str, PETSc.SNES] = {}
        self._linear_options: dict[str, str] = {}
        self.multigrid: Multigrid | None = None
        self._earlier = 0
        self._discarded: list[object] = []

    @property
    def problem(self) -> NonlinearProblem:
        """The DOLFINx problem, with its vectors, the matrix of its forms, and the linear solver."""
        if self._problem is None:
            self._free()
            J = jacobian_blocks(self._forms, self.unknowns)
            made = compiled(NonlinearProblem, self.comm)(
                list(self._forms),
                list(self.unknowns),
                J=J,
                bcs=list(self._bcs),
                petsc_options_prefix=self._prefix,
                entity_maps=list(self._entity_maps),
                kind="mpi",
            )
            factors = self.scales.row_factors
            self._callbacks = Callbacks(
                made.solver, factors, self.unknowns, self.terms, self.errors, Dependencies(J)
            )
            if self.linear_solver == "multigrid":
                self._precondition(made.solver.getKSP().getPC())
            self._linear_options, self._problem = {}, made
        return self._problem

    def _precondition(self, pc: PETSc.PC) -> None:
        """Give the linear solver its preconditioner."""
        assert self._callbacks is not None
        displacement, *others = self.unknowns
        motions = len(others) - len(self.terms.versions)  # one a contact
        unknowns = (displacement, others[:motions], others[motions:])
        settings = (self._prefix, self.options, self.errors)
        self.multigrid = Multigrid(*unknowns, self._callbacks.couplings, *settings)
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(self.multigrid)

    @property
    def iterative(self) -> bool:
        """Whether the linear systems are solved up to a tolerance."""
        return self.options["ksp_type"] != "preonly"

    def _free(self) -> None:
        """Free what was discarded; collective.

        On several ranks PETSc keeps objects whose last reference has gone until all ranks agree.
        """
        if not self._discarded:
            return
        while self._discarded:
            part = self._discarded.pop()
            if isinstance(part, PETSc.SNES):
                part.destroy()
            del part
        gc.collect()
        V = self.unknowns[0].function_space
        for comm in (MPI.COMM_WORLD, self.comm, V.dofmap.index_map.comm):
            PETSc.garbage_cleanup(comm)

    @property
    def set_ups(self) -> int:
        """How often the levels of multigrid were made."""
        return self._earlier + (0 if self.multigrid is None else self.multigrid.set_ups)

    def take_linear_solver(self, name: str) -> None:
        """Take another linear solver, ``direct`` or ``multigrid``, if it is not in use."""
        if name != self.linear_solver:
            self.discard()
            self.options, self.linear_solver = options_of(name, self.given), name

    def discard(self) -> None:
        """Forget solvers and matrix, which may be incomplete after an error; not collective."""
        self._earlier = self.set_ups
        if self.comm.size > 1:  # on one rank, the last reference frees them at once
            self._discarded += [*self._solvers.values(), self._problem]
        self._problem = self._callbacks = self.multigrid = None
        self._solvers = {}

    def solver(self, prefix: str, test: Callable[..., object]) -> PETSc.SNES:
        """Return the nonlinear solver of a substep, which has the linear solver of all.

        Args:
            prefix: Of its PETSc options.
            test: Its convergence test; must not hold the substep.
        """
        problem = self.problem
        if prefix not in self._solvers:
            snes = PETSc.SNES().create(self.comm)
            snes.setOptionsPrefix(prefix)
            snes.setKSP(problem.solver.getKSP())
            assert self._callbacks is not None
            self._callbacks.attach(snes)
            snes.setConvergenceTest(test)  # type: ignore[arg-type]
            set_up(snes, self.options)
            self._solvers[prefix] = snes
        return self._solvers[prefix]

    def prepare(self, snes: PETSc.SNES, law: Law) -> PETSc.Vec:
        """Prepare a solve of a substep from the present unknowns; return their vector."""
        problem = self.problem
        assign(problem.u, problem.x)
        assert self._callbacks is not None
        if self._callbacks.prepare(problem.x, law):
            forget_factor(snes)
        self._callbacks.use(snes)
        prefix, ksp = snes.getOptionsPrefix(), snes.getKSP()
        ksp.setOptionsPrefix(prefix)  # MUMPS looks there when it makes a factor
        if (options := effective(prefix, self.options)) != self._linear_options:
            set_up(ksp, self.options)
            forget_factor(snes)
            self._linear_options = options
        return problem.x

    def aim(self, snes: PETSc.SNES, progress: Progress) -> None:
        """Tell an iterative solver how exactly the next linear system is to be solved."""
        if self.multigrid is None:
            return
        ksp = snes.getKSP()
        if "ksp_rtol" not in self.options:
            last = ksp.getTolerances()[0]
            ksp.setTolerances(rtol=accuracy(progress.history, last, progress.excess))
        self.multigrid.expect(ksp.getTolerances()[0])

    def may_try_again(self, snes: PETSc.SNES) -> bool:
        """Tell whether a linear solver that failed may do better when it is made anew."""
        if self.multigrid is not None:
            self.multigrid.forget()
            return not self.multigrid.fresh
        if too_small := workspace_too_small(snes):
            # MUMPS analysed the matrix of another substep, where fewer pivots had to wait.
            forget_factor(snes)
        return too_small

    def take(self, x: PETSc.Vec) -> None:
        """Put a solution into the unknowns."""
        x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
        assign(x, self.unknowns)
        if self.iterative:  # such a solver meets conditions up to its tolerance only
            for f in self.unknowns:
                f.x.array[:] = with_conditions(f, self._bcs)

    def residual(self, law: Law) -> PETSc.Vec:
        """Return a new vector with the residual at the present unknowns."""
        problem = self.problem
        assign(problem.u, problem.x)
        assert self._callbacks is not None
        b = problem.b.duplicate()
        self._callbacks.evaluate(problem.x, b, law)
        return b

    @property
    def measure(self) -> ForceScales:
        """Measures residuals."""
        return self.scales
