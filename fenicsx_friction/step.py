# SPDX-License-Identifier: MIT
"""One step: stick predictor, slip corrector, polish, certificate, commit or roll back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np

from . import state
from .diagnosis import explain
from .errors import ContactInputError, StepFailed
from .report import StepReport
from .substep import SubstepReport

if TYPE_CHECKING:
    from .problem import FrictionalContactProblem

#: Forces below this fraction of stiffness times displacement at the start of a step count as
#: nothing: 1e-9 of them are what rounding leaves.
RESOLUTION = 1e-4
#: Newton stops at this fraction of the step's forces; the certificate decides what it is worth.
NEWTON_TOLERANCE = 1e-11
#: Tolerance of the ramp's stages before the last, and of the predictor.
STAGE_TOLERANCE = 1e-6
#: Smallest blend ``xi`` before 0, and the finest reduction of ``xi`` tried.
SMALLEST_XI, FINEST_REDUCTION = 1e-8, 0.95
#: Smallest smoothing before 0, relative to the expected traction.
SMALLEST_EPS = 1e-9
#: Smallest part of the increment that the continuation follows at once.
SMALLEST_CONTINUATION = 1e-4
#: Searches for the faces that nodes meet, each but the last followed by a solve.
MAX_SEARCHES = 6
#: Smallest part of the friction that is added at once.
SMALLEST_REDUCTION = 1e-3
#: A stage with at most this many iterations lets the next reduction be bolder.
EASY_STAGE = 1


@dataclass(frozen=True)
class Attempt:
    """One way to solve a step."""

    corrector: str
    line_search: str | None = None
    r_factor: float = 1.0
    max_it: int | None = None
    predictor_iterations: int | None = None


#: Full Newton steps first; the others cost more and are for steep loads and high friction.
FALLBACKS = (
    Attempt("projection", "bt", max_it=40, predictor_iterations=4),
    Attempt("projection", predictor_iterations=0),
    Attempt("friction"),
    Attempt("smoothing"),
    Attempt("continuation"),
    Attempt("projection", r_factor=10.0, max_it=100),
    Attempt("projection", "bt", r_factor=10.0, max_it=100, predictor_iterations=2),
    Attempt("ramp", "bt", max_it=60, predictor_iterations=4),
)


def advance(problem: FrictionalContactProblem) -> StepReport:
    """Solve, certify and commit one increment; see ``FrictionalContactProblem.solve``."""
    for k in problem.contacts:
        k.obstacle.anchor()
        k.refresh_frames()
    start = state.save(problem.state)
    unbalanced, largest = problem.projection.residual_norms()
    _check(problem, unbalanced)
    forces = max(unbalanced, _contact_forces(problem))
    # Of the start: what the displacement of a body that nothing holds grows to is no scale.
    largest = max(largest, RESOLUTION * problem.stiffness_force())
    forces = max(forces, largest)
    substeps: list[SubstepReport] = []
    fallbacks = FALLBACKS[: problem.settings.fallbacks]
    for attempt in (None, Attempt(problem.settings.corrector), *fallbacks):
        state.restore(problem.state, start)
        if attempt is not None:
            for k in problem.contacts:
                k.obstacle.anchor()
                k.close_touching()
            with _scaled(problem, attempt.r_factor):
                substeps += _correct(problem, attempt, forces)
                if substeps[-1].converged:
                    substeps += _settle(problem, attempt, forces)
        elif unbalanced > NEWTON_TOLERANCE * forces:
            continue  # else the loads did not change and the state is its own solution
        certificate = problem.certify(largest)
        report = StepReport(
            problem.num_steps + 1,
            problem.settings.corrector,
            tuple(substeps),
            problem.contact_reports(),
            certificate,
        )
        if certificate.solved:
            problem.commit()
            return report
    message = explain(problem, report)
    state.restore(problem.state, start)
    if problem.settings.raise_on_uncertified:
        raise StepFailed(message, report)
    return report


def _check(problem: FrictionalContactProblem, unbalanced: float) -> None:
    """Refuse loads, boundary values and friction that are no numbers, before any solve."""
    for k in problem.contacts:
        k.check_friction()
    if not np.isfinite(unbalanced):
        raise ContactInputError(
            f"The residual at the start of step {problem.num_steps + 1} is {unbalanced}: look for "
            "NaN in loads, boundary values and material fields, and for inverted cells."
        )


def _correct(
    problem: FrictionalContactProblem, attempt: Attempt, forces: float
) -> list[SubstepReport]:
    """Predict with stick, correct, polish; leave the result in the unknowns."""
    if attempt.corrector == "continuation":
        return _continue(problem, forces)
    if attempt.corrector == "smoothing":
        return _smooth(problem, forces)
    if attempt.corrector == "friction":
        return _add_friction(problem, forces)
    start = state.save(problem.state)
    eps = problem.settings.smoothing * _expected_traction(problem, forces)
    iterations = attempt.predictor_iterations
    if iterations is None:
        iterations = problem.settings.predictor_iterations
    reports = []
    if iterations > 0:
        predictor = problem.run(problem.stick, STAGE_TOLERANCE * forces, eps=eps, max_it=iterations)
        if not np.all(np.isfinite(predictor.residuals)) or "LINEAR" in predictor.reason:
            state.restore(problem.state, start)
        reports.append(predictor)
    if attempt.corrector == "ramp":
        reports += _ramp(problem, attempt, forces, eps)
    reports.append(_polish(problem, attempt, forces))
    return reports


def _settle(
    problem: FrictionalContactProblem, attempt: Attempt, forces: float
) -> list[SubstepReport]:
    """Search again for what the nodes meet, and solve again, until nothing changes.

    The certificate sees what the last search found.
    """
    reports: list[SubstepReport] = []
    for searched in range(MAX_SEARCHES):
        changed = [k.obstacle.search() for k in problem.contacts]
        if not any(changed) or searched == MAX_SEARCHES - 1:
            break
        reports.append(_polish(problem, attempt, forces))
        if not reports[-1].converged:
            break
    return reports


def _polish(problem: FrictionalContactProblem, attempt: Attempt, forces: float) -> SubstepReport:
    """Solve the natural map."""
    return problem.run(
        problem.projection,
        NEWTON_TOLERANCE * forces,
        line_search=attempt.line_search,
        max_it=attempt.max_it,
    )


def _ramp(
    problem: FrictionalContactProblem, attempt: Attempt, forces: float, eps: float
) -> list[SubstepReport]:
    """Ramp ``xi`` of eq. (12) from 1 to 0, finer where a stage fails or leaves the cone."""
    reports: list[SubstepReport] = []
    violated_only = problem.settings.ramp_nodes == "violated"
    chosen = sum(k.freeze_stick(violated_only=violated_only) for k in problem.contacts)
    if problem.comm.allreduce(chosen, MPI.SUM) == 0:
        return reports
    accepted = state.save(problem.state)
    last, xi, reduction = 1.0, 1.0, 0.1
    while True:
        report = problem.run(
            problem.slip,
            STAGE_TOLERANCE * forces,
            xi=xi,
            eps=eps * xi,
            line_search=attempt.line_search,
            max_it=attempt.max_it,
        )
        good = report.converged and not any([k.has_false_root() for k in problem.contacts])
        reports.append(replace(report, accepted=good))
        if good:
            accepted, last = state.save(problem.state), xi
            if xi == 0.0:
                return reports
            if report.iterations <= EASY_STAGE:
                reduction = reduction**2
        else:
            state.restore(problem.state, accepted)
            reduction = np.sqrt(reduction)
            if xi == 1.0 or reduction > FINEST_REDUCTION:
                return reports  # the polish starts from the last good stage
        xi = last * reduction if last * reduction > SMALLEST_XI else 0.0


def _smooth(problem: FrictionalContactProblem, forces: float) -> list[SubstepReport]:
    """Solve the projection rows with ``eps`` from the size of the tractions down to zero."""
    reports: list[SubstepReport] = []
    largest = _expected_traction(problem, forces)
    last = eps = largest
    reduction, good = 0.1, state.save(problem.state)
    while eps > 0.0 and reduction < FINEST_REDUCTION:
        report = problem.run(
            problem.projection, STAGE_TOLERANCE * forces, eps=eps, line_search="bt", max_it=40
        )
        reports.append(report)
        if report.converged:
            good, last = state.save(problem.state), eps
        else:
            state.restore(problem.state, good)
            reduction = np.sqrt(reduction)
        eps = last * reduction if last * reduction > SMALLEST_EPS * largest else 0.0
    reports.append(
        problem.run(problem.projection, NEWTON_TOLERANCE * forces, line_search="bt", max_it=100)
    )
    return reports


def _add_friction(problem: FrictionalContactProblem, forces: float) -> list[SubstepReport]:
    """Solve without friction, then add it bit by bit.

    From a state that only touches, the tip of the cone at every node, friction sends Newton
    anywhere; the pressures of the frictionless solution tell which nodes are closed.
    """
    reports: list[SubstepReport] = []
    xi, reduction, good = 1.0, 1.0, state.save(problem.state)
    while reduction > SMALLEST_REDUCTION:
        report = problem.run(problem.projection, NEWTON_TOLERANCE * forces, xi=xi)
        reports.append(report)
        if report.converged:
            good, last = state.save(problem.state), xi
            if xi == 0.0:
                break
            reduction = min(2.0 * reduction, last)
        elif xi == 1.0:
            break
        else:
            state.restore(problem.state, good)
            reduction /= 4.0
        xi = max(last - reduction, 0.0)
    return reports


def _continue(problem: FrictionalContactProblem, forces: float) -> list[SubstepReport]:
    """Follow the solution from the last state to the new loads, without committing history.

    The last state solves ``R(x) = (1 - t) R(x0)`` at ``t = 0``; at ``t = 1`` it is the increment.
    """
    reports: list[SubstepReport] = []
    unbalanced = problem.projection.residual()
    t, dt = 0.0, 0.25
    while t < 1.0 and dt > SMALLEST_CONTINUATION:
        dt = min(dt, 1.0 - t)
        good = state.save(problem.state)
        target = (1.0 - t - dt) * unbalanced
        report = problem.run(problem.projection, NEWTON_TOLERANCE * forces, target=target)
        reports.append(report)
        if report.converged:
            t, dt = t + dt, dt * 2.0
        else:
            state.restore(problem.state, good)
            dt /= 4.0
    unbalanced.destroy()
    return reports


def _contact_forces(problem: FrictionalContactProblem) -> float:
    """Return the contact forces (2-norm over the nodes, N)."""
    local = sum(float(np.sum((s.area[:, None] * s.c) ** 2)) for s in problem.nodal_states())
    return float(np.sqrt(problem.comm.allreduce(local, MPI.SUM)))


def _expected_traction(problem: FrictionalContactProblem, forces: float) -> float:
    """Return the traction (Pa) that spreads the forces over the contact nodes."""
    local = sum(float(np.sum(s.area**2)) for s in problem.nodal_states())
    return forces / float(np.sqrt(problem.comm.allreduce(local, MPI.SUM)))


@contextmanager
def _scaled(problem: FrictionalContactProblem, factor: float) -> Iterator[None]:
    """Solve with ``r_p`` multiplied by ``factor``; the certificate always uses the plain one."""
    kept = [k.r.x.array.copy() for k in problem.contacts]
    for k in problem.contacts:
        k.scale_r(factor)
    try:
        yield
    finally:
        for k, values in zip(problem.contacts, kept, strict=True):
            k.r.x.array[:] = values
