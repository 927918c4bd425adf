# SPDX-License-Identifier: MIT
"""Viscous relaxation: from a limit point, where a body snaps, to the next equilibrium."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from ufl.core.expr import Expr

from ..base.errors import ContactInputError, StepFailed
from ..base.validators import instance
from ..increment.report import StepReport

if TYPE_CHECKING:
    from ..problem import FrictionalContactProblem

#: First damping, in units of the stiffness of a cell at the contact surface.
FIRST = 0.01
#: Factors of the damping after an increment and after a failure.
LESS, MORE = 0.3, 4.0
#: Largest damping in the same unit; with it, nothing moves.
MOST = 100.0
#: Increments that are tried at most, the failed ones included.
MAX_INCREMENTS = 100


class ViscousRelaxation:
    """Lets a body that has no equilibrium nearby creep to the next one, at fixed loads.

    A quasi-static path ends at a limit point: the body snaps, and its motion until it rests is
    dynamics. The relaxation replaces inertia by viscous forces ``eta (u - reference)`` a volume::

        relaxation = ff.ViscousRelaxation(u)
        F = internal + relaxation.residual(v)
        stepper = ff.LoadStepper(problem, loads, ..., relaxation=relaxation)

    Where the smallest step fails, the stepper sets the loads of its end and makes damped
    increments. ``eta`` falls after each increment and grows after a failure. Each increment is a
    step with history: contact, friction and slip path obey the unsmoothed law. At the end
    ``eta = 0``: only a state that is certified without damping is accepted.

    The increments do not follow the body in time. But a law that depends on the slip rate divides
    by ``problem.dt``. Therefore the times of the increments add up to that of the step. The
    ``k``-th damped increment takes ``1 / (k + 1)`` of the time that is left, the last increment all
    of it. The last one, whose state is kept, thus has an equal share of the step. Earlier ones move
    the body further and have larger shares.

    Args:
        u: The displacement.

    Attributes:
        damping: ``eta`` (Pa/m²), zero outside the relaxation.
        reference: The displacement of the last increment.
    """

    def __init__(self, u: fem.Function) -> None:
        self._u = instance(u, fem.Function, "u", "the displacement, a fem.Function")
        self.damping = fem.Constant(u.function_space.mesh, default_scalar_type(0.0))
        self.reference = fem.Function(u.function_space, name="relaxation_reference")

    def residual(self, v: Expr) -> ufl.Form:
        """Return the virtual work of the viscous forces, to be added to the bulk residual."""
        mesh = self._u.function_space.mesh
        return ufl.inner(self.damping * (self._u - self.reference), v) * ufl.dx(mesh)

    def check(self, problem: FrictionalContactProblem) -> None:
        """Raise a ContactInputError unless the viscous forces are in the problem's residual."""
        if self.damping not in problem.bulk.constants():
            raise ContactInputError(
                "The problem's F does not contain the relaxation: add relaxation.residual(v) to it."
            )

    def settle(
        self, problem: FrictionalContactProblem, accepted: Callable[[], None]
    ) -> tuple[StepReport, int]:
        """Lead the problem from its last accepted state to equilibrium under the present loads.

        Args:
            problem: The problem, with the loads and ``dt`` of the step set. Afterwards ``dt`` is
                that of the last increment.
            accepted: Called after each increment.

        Returns:
            The report of the last increment, without damping, and the number of increments.

        Raises:
            StepFailed: If it finds no equilibrium; the problem is then in an intermediate state.
        """
        settings = problem.settings
        try:
            # More damping is cheaper than fallbacks.
            problem.settings = replace(settings, fallbacks=0, raise_on_uncertified=True)
            return self._creep(problem, accepted)
        finally:
            problem.settings = settings

    def _creep(
        self, problem: FrictionalContactProblem, accepted: Callable[[], None]
    ) -> tuple[StepReport, int]:
        """Make damped increments until one without damping succeeds."""
        unit = _stiffness(problem)
        eta, increments = FIRST * unit, 0
        left = float(problem.dt.value)
        failure: StepFailed | None = None
        for _ in range(MAX_INCREMENTS):
            try:
                share = left / (increments + 2)
                self._solve(problem, eta, share)
            except StepFailed as error:
                failure, eta = error.with_traceback(None), eta * MORE
                if eta > MOST * unit:
                    break
                continue
            increments += 1
            left -= share
            accepted()
            eta *= LESS
            try:
                report = self._solve(problem, 0.0, left)
            except StepFailed as error:
                failure = error.with_traceback(None)
                continue
            accepted()
            return report, increments + 1
        assert failure is not None
        try:
            raise failure
        finally:
            del failure  # its traceback holds this frame, which must not hold it

    def _solve(self, problem: FrictionalContactProblem, eta: float, dt: float) -> StepReport:
        """Make one increment of length ``dt`` with damping ``eta``; then set it to zero."""
        problem.dt.value = np.asarray(dt)
        self.reference.x.array[:] = self._u.x.array
        self.damping.value = np.asarray(eta)
        try:
            return problem.solve()
        finally:
            self.damping.value = np.asarray(0.0)


def _stiffness(problem: FrictionalContactProblem) -> float:
    """Return the mean stiffness of the contact nodes over their volume (Pa/m²); collective."""
    d = problem.u.function_space.mesh.geometry.dim
    nodes = problem.nodal_states()
    values = [s.r / s.area ** (1.0 / (d - 1)) for s in nodes]
    local = np.array([sum(np.sum(v) for v in values), sum(len(v) for v in values)])
    total, number = problem.comm.allreduce(local, MPI.SUM)
    return float(total / number)
