# SPDX-License-Identifier: MIT
"""Newton's method on the dofs of contact alone, for a bulk that is condensed.

To a substep it is what :class:`~fenicsx_friction.solvers.newton.Newton` is: the same SNES, line
searches and convergence test. An iteration costs a dense solve.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from petsc4py import PETSc

from dolfinx import fem

from ..equations.contact_terms import Law
from ..equations.forces import ForceScales
from .boundary import BoundaryEquations
from .convergence import Progress
from .options import set_up


class BoundaryNewton:
    """Solves the substeps of a problem whose bulk is condensed; methods are collective.

    Args:
        equations: The equations on the dofs of contact.
        unknowns: All unknowns of the problem.
        options: PETSc options; those of the nonlinear solver count.
        scales: Measures residuals of the whole system.

    Attributes:
        equations: As given.
        measure: Measures residuals.
        unknowns: As given.
        options: Those of the nonlinear solver.
    """

    name, cheap, iterative = "condensed", True, False

    def __init__(
        self,
        equations: BoundaryEquations,
        unknowns: Sequence[fem.Function],
        options: Mapping[str, object],
        scales: ForceScales,
    ) -> None:
        self.equations, self.unknowns = equations, unknowns
        self.measure = scales.boundary(equations.bulk.dofs, equations.own)
        self.comm, self.errors = equations.comm, equations.errors
        self.options = {k: v for k, v in options.items() if k.startswith("snes_")}
        self.discard()

    def solver(self, prefix: str, test: Callable[..., object]) -> PETSc.SNES:
        """Return the nonlinear solver of a substep, see ``Newton.solver``."""
        if prefix not in self._solvers:
            snes = PETSc.SNES().create(self.comm)
            snes.setOptionsPrefix(prefix)
            set_up(snes, self.options)
            size = ((self.equations.size, None),) * 2
            matrix = PETSc.Mat().createPython(size, self.equations, comm=self.comm)
            matrix.setUp()
            snes.setFunction(self.equations.residual, self._b)
            snes.setJacobian(self.equations.jacobian, matrix, matrix)
            snes.setConvergenceTest(test)  # type: ignore[arg-type]
            ksp = snes.getKSP()
            ksp.setType(PETSc.KSP.Type.PREONLY)
            ksp.getPC().setType(PETSc.PC.Type.PYTHON)
            ksp.getPC().setPythonContext(self.equations)
            self._solvers[prefix] = snes
        return self._solvers[prefix]

    def prepare(self, snes: PETSc.SNES, law: Law) -> PETSc.Vec:
        """Prepare a solve of a substep from the present unknowns; return their vector."""
        self.equations.law = law
        self.equations.read(self._x)
        return self._x

    def aim(self, snes: PETSc.SNES, progress: Progress) -> None:
        """Do nothing: linear systems are solved directly."""

    def may_try_again(self, snes: PETSc.SNES) -> bool:
        """Return ``False``: the same matrix fails again."""
        return False

    def take(self, x: PETSc.Vec) -> None:
        """Put a solution into the unknowns on the boundary."""
        self.equations.accept(x)

    def residual(self, law: Law) -> PETSc.Vec:
        """Return a new vector with the residual at the present unknowns."""
        b = self.equations.vector()
        self.equations.law = law
        self.equations.read(self._x)
        self.equations.residual(None, self._x, b)
        return b

    def discard(self) -> None:
        """Forget the solvers and the vectors, which PETSc may have left locked."""
        self._solvers: dict[str, PETSc.SNES] = {}
        self._x, self._b = self.equations.vector(), self.equations.vector()
