# SPDX-License-Identifier: MIT
"""One step: solve it in one way or another, search again, certify, commit or roll back."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from mpi4py import MPI

import numpy as np

from ..base.errors import ContactInputError, StepFailed
from ..contact.checks import check_normals
from ..system.report import StepReport, SubstepReport
from ..system.system import ContactSystem
from . import snapshot
from .correctors import FALLBACKS, Attempt, correct, newton_tolerance, polish
from .crossed import crossed_nodes
from .diagnosis import explain

#: Searches for the faces that nodes meet, each but the last followed by a solve.
MAX_SEARCHES = 6


def advance(system: ContactSystem) -> StepReport:
    """Solve, certify and commit one increment; see ``FrictionalContactProblem.solve``."""
    last = snapshot.ProblemSnapshot(system)
    try:
        report = _advance(system)
    except BaseException as error:
        last.restore()
        if not isinstance(error, StepFailed):  # solvers may be incomplete
            for substep in (system.stick, system.slip, system.projection):
                substep.discard()
        raise
    if not report.certificate.solved:
        last.restore()
    return report


def _advance(system: ContactSystem) -> StepReport:
    """Try the ways to solve an increment, commit the first certified solution."""
    for k in system.contacts:
        k.anchor()
        k.choose_frames()
    changed = [*system.state, *(f for k in system.contacts for f in (k.hint, k.free))]
    start = snapshot.save(changed)
    system.set_smoothing(xi=0.0, eps=0.0)
    unbalanced = system.projection.unbalanced()
    _check(system, unbalanced)
    system.scales.begin()
    forces = max(unbalanced, _contact_forces(system))
    substeps: list[SubstepReport] = []
    nearest, failed = np.inf, None
    fallbacks = FALLBACKS[: system.settings.fallbacks]
    for attempt in (None, Attempt(system.settings.corrector), *fallbacks):
        snapshot.restore(changed, start)
        if attempt is not None:
            for k in system.contacts:
                if substeps:  # an earlier attempt may have changed the pairs
                    k.anchor()
                k.close_touching()
            with _scaled(system, attempt.r_factor):
                substeps += correct(system, attempt, forces)
                if substeps[-1].converged:
                    substeps += _settle(system, attempt)
        elif not system.projection.is_solved(newton_tolerance(system)):
            continue  # solved: the loads did not change, and the state is accepted as it is
        certificate = system.certify()
        crossed = crossed_nodes(system) if certificate.solved else []
        certificate = replace(certificate, crossed=len(crossed))
        report = StepReport(
            system.num_steps + 1,
            system.settings.corrector,
            tuple(substeps),
            system.contact_reports(),
            certificate,
        )
        if certificate.solved:
            system.commit()
            return report
        far = np.nan_to_num(certificate.relative, nan=np.inf)
        if failed is None or far < nearest:
            nearest, failed = far, (report, crossed, snapshot.ProblemSnapshot(system))
        if crossed or certificate.drowned:
            break  # no other way to solve the step would help
    assert failed is not None
    report, crossed, there = failed
    report = replace(report, substeps=tuple(substeps))
    there.restore()
    if system.settings.raise_on_uncertified:
        raise StepFailed("\n".join([explain(system, report), *crossed]), report)
    return report


def _check(system: ContactSystem, unbalanced: float) -> None:
    """Refuse loads, boundary values and friction that are not finite, before any solve."""
    for k in system.contacts:
        k.check_friction()
    if not np.isfinite(unbalanced):
        for k in system.contacts:
            check_normals(k)  # an obstacle that has moved may have no normal at some node
        raise ContactInputError(
            f"The residual at the start of step {system.num_steps + 1} is {unbalanced}: look for "
            "NaN in loads, boundary values and material fields, and for inverted cells."
        )


def _settle(system: ContactSystem, attempt: Attempt) -> list[SubstepReport]:
    """Search again for what the nodes meet, and solve again, until nothing changes.

    The certificate is for the result of the last search.
    """
    reports: list[SubstepReport] = []
    for searched in range(MAX_SEARCHES):
        changed = [k.pairing.search() for k in system.contacts]
        if not any(changed) or searched == MAX_SEARCHES - 1:
            break
        reports.append(polish(system, attempt))
        if not reports[-1].converged:
            break
    return reports


def _contact_forces(system: ContactSystem) -> float:
    """Return the contact forces (2-norm over the nodes, N)."""
    local = sum(float(np.sum((s.area[:, None] * s.c) ** 2)) for s in system.nodal_states())
    return float(np.sqrt(system.comm.allreduce(local, MPI.SUM)))


@contextmanager
def _scaled(system: ContactSystem, factor: float) -> Iterator[None]:
    """Solve with ``r_p`` multiplied by ``factor``."""
    kept = [k.r.x.array.copy() for k in system.contacts]
    for k in system.contacts:
        k.scale_r(factor)
    try:
        yield
    finally:
        for k, values in zip(system.contacts, kept, strict=True):
            k.r.x.array[:] = values
