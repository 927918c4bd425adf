# SPDX-License-Identifier: MIT
"""Newton's method on the dofs of contact alone, for a bulk that is linear.

To a substep it is what :class:`~fenicsx_friction.system.newton.Newton` is: the same SNES, line
searches and convergence test. An iteration costs a dense solve.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from .boundary import BoundaryEquations
from .contact_terms import Law
from .forces import ForceScales
from .options import set_up


class BoundaryNewton:
    """Solves the substeps of a problem whose bulk is condensed; methods are collective.

    Args:
        equations: The equations on the dofs of contact.
        unknowns: All unknowns of the problem.
        options: PETSc options; those of the nonlinear solver count.
        scales: Measures residuals.

    Attributes:
        equations: As given.
        unknowns: As given.
        options: Those of the nonlinear solver.
    """

    name = "condensed"

    def __init__(
        self,
        equations: BoundaryEquations,
        unknowns: Sequence[fem.Function],
        options: Mapping[str, object],
        scales: ForceScales,
    ) -> None:
        self.equations, self.unknowns, self._scales = equations, unknowns, scales
        self.comm, self.errors = equations.comm, equations.errors
        self.options = {k: v for k, v in options.items() if k.startswith("snes_")}
        self.contact_nodes = scales.contact_nodes
        self._solvers: dict[str, PETSc.SNES] = {}
        self._x, self._b = equations.vector(), equations.vector()

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

    def take(self, x: PETSc.Vec) -> None:
        """Put a solution into the unknowns on the boundary."""
        self.equations.follow(x)

    def residual(self, law: Law) -> PETSc.Vec:
        """Return a new vector with the residual at the present unknowns."""
        b = self.equations.vector()
        self.equations.law = law
        self.equations.read(self._x)
        self.equations.residual(None, self._x, b)
        return b

    def excess(self, rows: np.ndarray, tolerance: float) -> float:
        """Return the largest residual in units of what is allowed; elsewhere there is none.

        Reactions do not count among the forces: they would cost an assembly.
        """
        every = np.zeros(len(self._scales.row_factors))
        every[self.equations.own] = rows
        return self._scales.excess(every, tolerance, reactions=False)

    def find_noise(self) -> None:
        """Do nothing: the rounding of the user's residual does not enter here."""

    def discard(self) -> None:
        """Forget the solvers."""
        self._solvers = {}
