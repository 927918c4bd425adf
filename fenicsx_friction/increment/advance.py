# SPDX-License-Identifier: MIT
"""One step: solve it in one way or another, search again, certify, commit or roll back."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from mpi4py import MPI

import numpy as np
from dolfinx import fem

from ..base.errors import ContactInputError, StepFailed
from ..base.log import tell
from ..contact.checks import check_friction, check_metrics, check_normals
from ..equations.conditions import missed_values
from ..equations.forces import MISSED
from ..solvers.report import SubstepReport
from . import snapshot
from .correctors import CONDENSED_FALLBACKS, FALLBACKS, Attempt, correct, newton_tolerance, polish
from .crossed import crossed_nodes
from .diagnosis import explain, explain_not_finite
from .report import StepReport
from .system import ContactSystem

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
            system.solvers.discard()
        raise
    if not report.certificate.solved:
        last.restore()
    return report


def _advance(system: ContactSystem) -> StepReport:
    """Try the ways to solve an increment, commit the first certified solution."""
    changed, start = _begin(system)
    substeps: list[SubstepReport] = []
    failed: _Failed | None = None
    made, distrusted = system.solvers.factorisations, False
    for attempt, condensed, forces in _ways(system, changed, start):
        if condensed and distrusted:
            continue
        snapshot.restore(changed, start)
        if attempt is not None:
            _close(system, again=bool(substeps))
        elif missed_values(system.unknowns, system.bcs) > MISSED:
            continue  # the state is not its own solution
        with system.solvers.use(condensed=condensed):
            if attempt is not None:
                substeps += _solve(system, attempt, forces)
            elif not system.projection.is_solved(newton_tolerance(system)):
                continue  # else contact did not change and the state is its own solution
        if condensed:
            system.solvers.recover()
        report, crossed = _judge(system, substeps, made, condensed=condensed)
        if report.certificate.solved:
            check_metrics(system.contacts)  # they may depend on the slip
            system.commit()
            _tell(system, report)
            return report
        if failed is None or _far(report) < _far(failed.report):
            failed = _Failed(report, crossed, snapshot.ProblemSnapshot(system))
        if crossed or report.certificate.drowned:
            break  # another way to solve the step would not fare better
        distrusted = condensed and attempt is not None and substeps[-1].converged
    assert failed is not None
    report = replace(failed.report, substeps=tuple(substeps))
    failed.state.restore()
    if system.settings.raise_on_uncertified:
        raise StepFailed("\n".join([explain(system, report), *failed.crossed]), report)
    return report


def _ways(
    system: ContactSystem, changed: list[fem.Function], start: snapshot.Snapshot
) -> Iterator[tuple[Attempt | None, bool, float]]:
    """Yield the ways to solve a step, on the boundary first where it can be condensed.

    Yields:
        The attempt, ``None`` for the present state as it is; whether to solve on the boundary; the
        forces (2-norm, N).
    """
    first, contact = (None, Attempt(system.settings.corrector)), _contact_forces(system)
    number = system.settings.fallbacks
    solvers = system.solvers
    condensing = solvers.condensing(system.settings.solver)
    if condensing and (forces := solvers.condense()) is not None:
        for attempt in (*first, *CONDENSED_FALLBACKS[:number]):
            yield attempt, True, max(forces, contact)
        for k in system.contacts:
            k.anchor()
    snapshot.restore(changed, start)
    forces = system.projection.unbalanced()
    if not np.isfinite(forces):
        raise ContactInputError(explain_not_finite(system, forces))
    for attempt in (*first, *FALLBACKS[:number]):
        yield attempt, False, max(forces, contact)


def _tell(system: ContactSystem, report: StepReport) -> None:
    """Log an accepted step."""
    states = ", ".join(f"{k.name}: {k.open}/{k.stick}/{k.slip}" for k in report.contacts)
    message = "step %d: %d iterations, certificate %.0e, open/stick/slip %s"
    values = report.step, report.iterations, report.certificate.relative, states
    tell(system.comm, logging.INFO, message, *values)


@dataclass(frozen=True)
class _Failed:
    """An attempt that found no solution: its report, nodes that went through, the state."""

    report: StepReport
    crossed: list[str]
    state: snapshot.ProblemSnapshot


def _far(report: StepReport) -> float:
    """Return how far a state is from a solution, relative."""
    return float(np.nan_to_num(report.certificate.relative, nan=np.inf))


def _begin(system: ContactSystem) -> tuple[list[fem.Function], snapshot.Snapshot]:
    """Pair nodes, choose frames, check friction and measure forces at the start of a step.

    Returns:
        What attempts change, and its values.
    """
    for k in system.contacts:
        k.anchor()
        k.choose_frames()
    changed = [*system.state, *(f for k in system.contacts for f in (k.hint, k.free))]
    start = snapshot.save(changed)
    system.set_smoothing(xi=0.0, eps=0.0)
    _check_time(system.dt)
    for k in system.contacts:
        check_normals(k)  # an obstacle that has moved may have none at some node
        check_friction(k)
    system.scales.begin()
    return changed, start


def _close(system: ContactSystem, *, again: bool) -> None:
    """Close what touches, before conditions move anything; ``again`` after another attempt."""
    for k in system.contacts:
        if again:  # an attempt before has changed the pairs
            k.anchor()
        k.close_touching()


def _solve(system: ContactSystem, attempt: Attempt, forces: float) -> list[SubstepReport]:
    """Solve in one way and follow what the nodes meet."""
    with _scaled(system, attempt.r_factor):
        substeps = correct(system, attempt, forces)
        if substeps[-1].converged:
            substeps += _settle(system, attempt)
    return substeps


def _judge(
    system: ContactSystem, substeps: list[SubstepReport], made: int, *, condensed: bool
) -> tuple[StepReport, list[str]]:
    """Certify a state; name the nodes that went through an obstacle on the way to it."""
    certificate = system.certify()
    crossed = crossed_nodes(system) if certificate.solved else []
    report = StepReport(
        system.num_steps + 1,
        system.settings.corrector,
        tuple(substeps),
        system.contact_reports(),
        replace(certificate, crossed=len(crossed)),
        system.solvers.factorisations - made,
        "condensed" if condensed else "full",
    )
    return report, crossed


def _check_time(dt: fem.Constant) -> None:
    """Refuse a length of the step that is none."""
    if not 0.0 < dt.value < np.inf:
        raise ContactInputError(
            f"problem.dt = {float(dt.value):g} s must be positive and finite: it is the length of "
            "the step, by which slip rates are divided."
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
        tell(system.comm, logging.DEBUG, "search %d: nodes meet other faces", searched + 1)
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
