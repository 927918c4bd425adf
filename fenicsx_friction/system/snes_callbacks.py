# SPDX-License-Identifier: MIT
"""Residual and Jacobian of a ``NonlinearProblem`` as the SNES of a substep calls them."""

from collections.abc import Iterator
from contextlib import contextmanager

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt


class Callbacks:
    """Takes the place of the callbacks that DOLFINx has set; collective.

    Rows of prescribed dofs hold a displacement (m) among forces. They are multiplied by a
    stiffness, so that line searches and norms do not depend on units; Newton's steps do not change.

    It must not hold the SNES: in a cycle through PETSc, each rank's garbage collector would choose
    when to destroy collective objects.

    Args:
        snes: The solver of a ``NonlinearProblem``.
        row_scale: Factor of each owned row.

    Attributes:
        error: What a callback raised, as PETSc hands on no more than a number.
    """

    def __init__(self, snes: PETSc.SNES, row_scale: npt.NDArray[np.floating]) -> None:
        b, (residual, _, residual_data) = snes.getFunction()
        self._forms, _, (jacobian, _, jacobian_data) = snes.getJacobian()
        self._form_residual = lambda s, x, b: residual(s, x, b, **residual_data)
        self._form_jacobian = lambda s, x, A: jacobian(s, x, A, A, **jacobian_data)
        self._row_scale = row_scale
        self.error: BaseException | None = None
        snes.setFunction(self._call_residual, b)
        snes.setJacobian(self._call_jacobian, self._forms, self._forms)

    def prepare(self, snes: PETSc.SNES, x: PETSc.Vec) -> None:
        """Make ready for a solve; collective."""

    def assemble_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Assemble the residual."""
        self._form_residual(snes, x, b)

    def assemble_jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat) -> None:
        """Assemble the Jacobian."""
        self._form_jacobian(snes, x, J)

    @contextmanager
    def keeping_errors(self) -> Iterator[None]:
        """Keep what is raised inside."""
        try:
            yield
        except BaseException as error:
            self.error = error
            raise

    def _call_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Assemble the residual with scaled rows."""
        with self.keeping_errors():
            self.assemble_residual(snes, x, b)
            b.array[:] *= self._row_scale

    def _call_jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        """Assemble the Jacobian with scaled rows."""
        with self.keeping_errors():
            self.assemble_jacobian(snes, x, J)
            scale = J.createVecLeft()
            scale.array[:] = self._row_scale
            J.diagonalScale(scale)
            scale.destroy()
