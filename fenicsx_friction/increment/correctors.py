# SPDX-License-Identifier: MIT
"""Ways to solve an increment: predictor and corrector, and the fallbacks when they fail."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

from mpi4py import MPI

import numpy as np

from ..base.log import tell
from ..contact.slip_corrector import freeze_stick, has_false_root
from ..solvers.report import SubstepReport
from . import snapshot
from .predictor import STAGE_TOLERANCE, expected_traction, newton_tolerance, predict
from .searching import search
from .smoothing import smooth
from .system import ContactSystem

#: Smallest blend ``xi`` before 0, and the finest reduction of ``xi`` tried.
SMALLEST_XI, FINEST_REDUCTION = 1e-8, 0.95
#: Smallest part of the increment that one step of the continuation follows.
SMALLEST_CONTINUATION = 1e-4
#: Smallest part of the friction that is added in one stage.
SMALLEST_REDUCTION = 1e-3
#: After a stage with at most this many iterations, ``xi`` falls faster.
EASY_STAGE = 1


@dataclass(frozen=True)
class Attempt:
    """One way to solve a step.

    Attributes:
        corrector: ``"projection"``, ``"ramp"`` or a key of :data:`OTHER_CORRECTORS`.
        line_search: PETSc line search, full Newton steps by default.
        r_factor: Multiplies ``r_p``.
        max_it: Newton iterations of the corrector, those of the options by default.
        predictor_iterations: Newton iterations of the predictor, those of the settings by default.
        first_look: Iterations after which nodes look for their faces for the first time, where it
            does not matter on which way they get there: by then it is known about where they are.
        rough: Relative tolerance of a solve after which nodes look for their faces.
        onward: Start where the last step points to.
    """

    corrector: str
    line_search: str | None = None
    r_factor: float = 1.0
    max_it: int | None = None
    predictor_iterations: int | None = None
    first_look: int = 3
    rough: float = 1e-6
    onward: bool = False

    def moved_on(self) -> "Attempt":
        """Return the same from where the last step points to: near, and what slips goes on to."""
        return replace(self, predictor_iterations=0, first_look=1, rough=1e-4, onward=True)


#: Tried in turn after full Newton steps have failed; for steep loads and high friction.
FALLBACKS = (
    Attempt("projection", "bt", max_it=40, predictor_iterations=4),
    Attempt("projection", predictor_iterations=0),
    Attempt("friction"),
    Attempt("smoothing"),
    Attempt("continuation"),
    Attempt("projection", r_factor=10.0, max_it=100),
    Attempt("projection", "bt", r_factor=10.0, max_it=100, predictor_iterations=2),
    Attempt("ramp", "bt", max_it=60, predictor_iterations=4),
    # Bodies that only soft springs hold when all nodes slip: they slide farther than r_p expects.
    Attempt("projection", r_factor=1e-4, max_it=40, predictor_iterations=0),
)

#: The same on the boundary, where a try costs little: the surest one first.
CONDENSED_FALLBACKS = (
    Attempt("smoothing"),
    *(a for a in FALLBACKS if a.corrector != "smoothing"),
)


def correct(
    system: ContactSystem, attempt: Attempt, forces: float, *, roughly: bool = False
) -> list[SubstepReport]:
    """Predict with stick, correct, then solve the natural map; the unknowns hold the result.

    Args:
        system: The system.
        attempt: The way to solve it.
        forces: 2-norm of the forces of the step (N).
        roughly: Whether the natural map is to be solved again anyway; some correctors do not mind.
    """
    if attempt.corrector in OTHER_CORRECTORS:
        return OTHER_CORRECTORS[attempt.corrector](system, forces)
    eps = system.settings.smoothing * expected_traction(system, forces)
    reports = predict(system, eps, attempt.predictor_iterations)
    if attempt.corrector == "ramp":
        reports += _ramp(system, attempt, eps)
    early = [k for k in system.contacts if k.pairing.early]
    if roughly and early:
        reports.append(polish(system, replace(attempt, max_it=attempt.first_look), roughly=True))
        if reports[-1].converged:
            return reports
        if search(early):
            tell(system.comm, logging.DEBUG, "first look: nodes meet other faces")
    return [*reports, polish(system, attempt, roughly=roughly)]


def polish(system: ContactSystem, attempt: Attempt, *, roughly: bool = False) -> SubstepReport:
    """Solve the natural map."""
    return system.run(
        system.projection,
        attempt.rough if roughly else newton_tolerance(system),
        line_search=attempt.line_search,
        max_it=attempt.max_it,
    )


def _ramp(system: ContactSystem, attempt: Attempt, eps: float) -> list[SubstepReport]:
    """Ramp ``xi`` of eq. (12) from 1 to 0, finer where a stage fails or leaves the cone."""
    reports: list[SubstepReport] = []
    violated_only = system.settings.ramp_nodes == "violated"
    chosen = sum(freeze_stick(k, violated_only=violated_only) for k in system.contacts)
    if system.comm.allreduce(chosen, MPI.SUM) == 0:
        return reports
    accepted = snapshot.save(system.state)
    last, xi, reduction = 1.0, 1.0, 0.1
    while True:
        report = system.run(
            system.slip,
            STAGE_TOLERANCE,
            xi=xi,
            eps=eps * xi,
            line_search=attempt.line_search,
            max_it=attempt.max_it,
        )
        good = report.converged and not any([has_false_root(k) for k in system.contacts])
        reports.append(replace(report, accepted=good))
        if good:
            accepted, last = snapshot.save(system.state), xi
            if xi == 0.0:
                return reports
            if report.iterations <= EASY_STAGE:
                reduction = reduction**2
        else:
            snapshot.restore(system.state, accepted)
            reduction = np.sqrt(reduction)
            if xi == 1.0 or reduction > FINEST_REDUCTION:
                return reports  # the polish starts from the last good stage
        xi = last * reduction if last * reduction > SMALLEST_XI else 0.0


def _add_friction(system: ContactSystem, forces: float) -> list[SubstepReport]:
    """Solve without friction, then add it bit by bit.

    In a state that only touches, each node is at the tip of the cone: with friction, Newton's
    method may go anywhere. The pressures of the frictionless solution tell which nodes are closed.
    """
    reports: list[SubstepReport] = []
    xi, reduction, good = 1.0, 1.0, snapshot.save(system.state)
    while reduction > SMALLEST_REDUCTION:
        report = system.run(system.projection, newton_tolerance(system), xi=xi)
        reports.append(report)
        if report.converged:
            good, last = snapshot.save(system.state), xi
            if xi == 0.0:
                break
            reduction = min(2.0 * reduction, last)
        elif xi == 1.0:
            break
        else:
            snapshot.restore(system.state, good)
            reduction /= 4.0
        xi = max(last - reduction, 0.0)
    return reports


def _continue(system: ContactSystem, forces: float) -> list[SubstepReport]:
    """Follow the solution from the last state to the new loads, without committing history.

    The last state solves ``R(x) = (1 - t) R(x0)`` at ``t = 0``; at ``t = 1`` it is the increment.
    """
    reports: list[SubstepReport] = []
    unbalanced = system.projection.residual()
    t, dt = 0.0, 0.25
    while t < 1.0 and dt > SMALLEST_CONTINUATION:
        dt = min(dt, 1.0 - t)
        good = snapshot.save(system.state)
        target = (1.0 - t - dt) * unbalanced
        report = system.run(system.projection, newton_tolerance(system), target=target)
        reports.append(report)
        if report.converged:
            t, dt = t + dt, dt * 2.0
            search(system.contacts)  # it may slide over many faces
        else:
            snapshot.restore(system.state, good)
            dt /= 4.0
    unbalanced.destroy()
    return reports


OTHER_CORRECTORS: dict[str, Callable[[ContactSystem, float], list[SubstepReport]]] = {
    "continuation": _continue,
    "smoothing": smooth,
    "friction": _add_friction,
}
