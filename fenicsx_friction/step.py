# SPDX-License-Identifier: MIT
"""One step: try the ways to solve it, search again, certify, commit or roll back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np

from . import state
from .contact_checks import check_normals
from .correctors import FALLBACKS, Attempt, correct, newton_tolerance, polish
from .diagnosis import explain
from .errors import ContactInputError, StepFailed
from .report import StepReport
from .sides import crossed_nodes
from .substep import SubstepReport

if TYPE_CHECKING:
    from .problem import FrictionalContactProblem

#: Searches for the faces that nodes meet, each but the last followed by a solve.
MAX_SEARCHES = 6


def advance(problem: FrictionalContactProblem) -> StepReport:
    """Solve, certify and commit one increment; see ``FrictionalContactProblem.solve``."""
    last = state.ProblemSnapshot(problem)
    try:
        report = _advance(problem)
    except BaseException as error:
        last.restore()
        if not isinstance(error, StepFailed):  # it may have left solvers half done
            for substep in (problem.stick, problem.slip, problem.projection):
                substep.discard()
        raise
    if not report.certificate.solved:
        last.restore()
    return report


def _advance(problem: FrictionalContactProblem) -> StepReport:
    """Try the ways to solve an increment, commit the first certified solution."""
    for k in problem.contacts:
        k.obstacle.anchor()
        k.choose_frames()
    changed = [*problem.state, *(f for k in problem.contacts for f in (k.hint, k.free))]
    start = state.save(changed)
    problem.set_smoothing(xi=0.0, eps=0.0)
    unbalanced = problem.projection.unbalanced()
    _check(problem, unbalanced)
    problem.scales.begin()
    forces = max(unbalanced, _contact_forces(problem))
    substeps: list[SubstepReport] = []
    nearest, failed = np.inf, None
    fallbacks = FALLBACKS[: problem.settings.fallbacks]
    for attempt in (None, Attempt(problem.settings.corrector), *fallbacks):
        state.restore(changed, start)
        if attempt is not None:
            for k in problem.contacts:
                if substeps:  # an attempt before has changed the pairs
                    k.obstacle.anchor()
                k.close_touching()
            with _scaled(problem, attempt.r_factor):
                substeps += correct(problem, attempt, forces)
                if substeps[-1].converged:
                    substeps += _settle(problem, attempt)
        elif not problem.projection.is_solved(newton_tolerance(problem)):
            continue  # else the loads did not change and the state is its own solution
        certificate = problem.certify()
        crossed = crossed_nodes(problem) if certificate.solved else []
        certificate = replace(certificate, crossed=len(crossed))
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
        far = np.nan_to_num(certificate.relative, nan=np.inf)
        if failed is None or far < nearest:
            nearest, failed = far, (report, crossed, state.ProblemSnapshot(problem))
        if crossed or certificate.drowned:
            break  # another way to solve the step would not fare better
    assert failed is not None
    report, crossed, there = failed
    report = replace(report, substeps=tuple(substeps))
    there.restore()
    if problem.settings.raise_on_uncertified:
        raise StepFailed("\n".join([explain(problem, report), *crossed]), report)
    return report


def _check(problem: FrictionalContactProblem, unbalanced: float) -> None:
    """Refuse loads, boundary values and friction that are no numbers, before any solve."""
    for k in problem.contacts:
        k.check_friction()
    if not np.isfinite(unbalanced):
        for k in problem.contacts:
            check_normals(k)  # an obstacle that has moved may have none at some node now
        raise ContactInputError(
            f"The residual at the start of step {problem.num_steps + 1} is {unbalanced}: look for "
            "NaN in loads, boundary values and material fields, and for inverted cells."
        )


def _settle(problem: FrictionalContactProblem, attempt: Attempt) -> list[SubstepReport]:
    """Search again for what the nodes meet, and solve again, until nothing changes.

    The certificate sees what the last search found.
    """
    reports: list[SubstepReport] = []
    for searched in range(MAX_SEARCHES):
        changed = [k.obstacle.search() for k in problem.contacts]
        if not any(changed) or searched == MAX_SEARCHES - 1:
            break
        reports.append(polish(problem, attempt))
        if not reports[-1].converged:
            break
    return reports


def _contact_forces(problem: FrictionalContactProblem) -> float:
    """Return the contact forces (2-norm over the nodes, N)."""
    local = sum(float(np.sum((s.area[:, None] * s.c) ** 2)) for s in problem.nodal_states())
    return float(np.sqrt(problem.comm.allreduce(local, MPI.SUM)))


@contextmanager
def _scaled(problem: FrictionalContactProblem, factor: float) -> Iterator[None]:
    """Solve with ``r_p`` multiplied by ``factor``."""
    kept = [k.r.x.array.copy() for k in problem.contacts]
    for k in problem.contacts:
        k.scale_r(factor)
    try:
        yield
    finally:
        for k, values in zip(problem.contacts, kept, strict=True):
            k.r.x.array[:] = values
