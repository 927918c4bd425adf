# SPDX-License-Identifier: MIT
"""One step: try the ways to solve it, search again, certify, commit or roll back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np

from . import state
from .correctors import FALLBACKS, NEWTON_TOLERANCE, Attempt, correct, polish
from .diagnosis import explain
from .errors import ContactInputError, StepFailed
from .report import StepReport
from .sides import crossed_nodes
from .substep import SubstepReport

if TYPE_CHECKING:
    from .problem import FrictionalContactProblem

#: Forces below this fraction of stiffness times displacement at the start of a step count as
#: nothing: 1e-9 of them are what rounding leaves.
RESOLUTION = 1e-4
#: Searches for the faces that nodes meet, each but the last followed by a solve.
MAX_SEARCHES = 6


def advance(problem: FrictionalContactProblem) -> StepReport:
    """Solve, certify and commit one increment; see ``FrictionalContactProblem.solve``."""
    obstacles = [k.obstacle.save() for k in problem.contacts]
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
                if substeps:  # an attempt before has changed the pairs
                    k.obstacle.anchor()
                k.close_touching()
            with _scaled(problem, attempt.r_factor):
                substeps += correct(problem, attempt, forces)
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
        crossed = crossed_nodes(problem)
        if certificate.solved and not crossed:
            problem.commit()
            return report
    message = "\n".join([explain(problem, report), *crossed])
    state.restore(problem.state, start)
    for k, saved in zip(problem.contacts, obstacles, strict=True):
        k.obstacle.restore(saved)
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
        reports.append(polish(problem, attempt, forces))
        if not reports[-1].converged:
            break
    return reports


def _contact_forces(problem: FrictionalContactProblem) -> float:
    """Return the contact forces (2-norm over the nodes, N)."""
    local = sum(float(np.sum((s.area[:, None] * s.c) ** 2)) for s in problem.nodal_states())
    return float(np.sqrt(problem.comm.allreduce(local, MPI.SUM)))


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
