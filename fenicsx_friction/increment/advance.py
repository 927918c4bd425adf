# SPDX-License-Identifier: MIT
"""One step: solve it in one way or another, search again, certify, commit or roll back."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from dolfinx import fem

from ..base.errors import ContactInputError, StepFailed
from ..base.log import tell
from ..contact.checks import check_friction, check_metrics, check_normals
from ..equations.conditions import with_conditions
from ..equations.held import check_held
from . import others, snapshot
from .background import background
from .carrying import forget_rounding
from .correctors import CONDENSED_FALLBACKS, FALLBACKS, Attempt
from .diagnosis import explain, explain_not_finite
from .extrapolation import commit_rates
from .predictor import contact_forces, soft_forces
from .report import StepReport
from .system import ContactSystem
from .trial import Trials, Way

#: From so many nodes across the contacts on, ``r_p`` is smaller at first, but no smaller than by:
ACROSS, SOFTEST = 8, 0.02


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
    others.tell(report)
    return report


def _advance(system: ContactSystem) -> StepReport:
    """Try the ways to solve an increment, commit the first certified solution."""
    trials = _begin(system)
    failed: _Failed | None = None
    distrusted, unable = False, ""
    for way in _ways(trials):
        hopeless = distrusted if way.condensed else way.linear_solver == unable
        found = None if hopeless else trials.make(way)
        if found is None:
            continue
        report = found.report
        if report.certificate.solved:
            report = others.choose(trials, way, report)
            check_metrics(system.contacts)  # they may depend on the slip
            forget_rounding(system)
            commit_rates(system, trials.start)
            system.commit()
            if not way.condensed and way.attempt is not None:
                system.solvers.keep(way.linear_solver)
            _tell(system, report)
            return report
        if way.attempt is not None and way.attempt.onward:
            continue  # as if it had not been tried
        if failed is None or found.wrong or _far(report) < _far(failed.report):
            failed = _Failed(report, found.wrong, snapshot.ProblemSnapshot(system))
        if report.certificate.crossed or report.certificate.drowned:
            break  # another way to solve the step would not fare better
        if _cannot_solve(trials, report):
            unable = way.linear_solver
        distrusted = way.condensed and (found.converged or found.unbalanced)
    assert failed is not None
    report = replace(
        failed.report,
        substeps=tuple(trials.substeps),
        factorisations=trials.factorisations,
        set_ups=trials.set_ups,
    )
    failed.state.restore()
    if system.settings.raise_on_uncertified:
        raise StepFailed(explain(system, report, failed.wrong), report, background(system))
    return report


def _cannot_solve(trials: Trials, report: StepReport) -> bool:
    """Tell whether to give up an iterative linear solver that failed.

    If it has solved nothing in this step, it fails in the other ways, too. If it has, another way
    may do better; but a factorisation, where there is one, is surer.
    """
    solvers = trials.system.solvers
    if report.solver != "full" or not solvers.full.iterative:
        return False
    here = [s for s in report.substeps if s.solver == "full"]
    failed = ["LINEAR" in s.reason for s in here]
    another = solvers.linear_solvers[-1] != solvers.full.linear_solver
    return any(failed[-1:]) and (another or not any(s.iterations for s in here))


def _ways(trials: Trials) -> Iterator[Way]:
    """Yield the ways to solve a step, on the boundary first where it can be condensed."""
    system = trials.system
    number, solvers = system.settings.fallbacks, system.solvers
    contact, soft = contact_forces(system), soft_forces(system)
    condensing = solvers.condensing(system.settings.solver)
    if condensing and (forces := solvers.condense()) is not None:
        for attempt in (*_first(system), *CONDENSED_FALLBACKS[:number]):
            yield Way(attempt, True, max(min(forces, soft), contact))
        for k in system.contacts:
            k.anchor()
    trials.restore()
    forces = system.projection.unbalanced()
    if not np.isfinite(forces):
        raise ContactInputError(explain_not_finite(system, forces))
    for linear_solver in solvers.linear_solvers:
        same, first = _first(system, linear_solver)
        onward = (first.moved_on(),) if system.settings.extrapolates else ()
        for attempt in (same, *onward, first, *FALLBACKS[:number]):
            yield Way(attempt, False, max(min(forces, soft), contact), linear_solver)


def _first(system: ContactSystem, linear_solver: str = "") -> tuple[Attempt | None, Attempt]:
    """Return what is tried first: the present state as it is, predictor and corrector.

    On meshes for multigrid, full Newton steps cycle more often, and a residual costs little beside
    a linear solve: there the steps have a line search, but where the user asks for one.
    """
    asked = "snes_linesearch_type" in system.solvers.full.given
    damped = linear_solver == "multigrid" and not asked
    search = "bt" if damped else None
    return None, Attempt(system.settings.corrector, search, r_factor=_softening(system))


def _softening(system: ContactSystem) -> float:
    """Return what ``r_p`` is multiplied by at first, if it was not given.

    A node that slips against its friction should stick in the next iteration. With ``r_p`` from the
    stiffness of one element, a slip of many elements' length across the contact, which meets a
    far smaller stiffness, makes it slip the other way instead.
    """
    if any(k.r_p is not None for k in system.contacts):
        return 1.0
    return min(max(ACROSS / system.scales.nodes_across, SOFTEST), 1.0)


def _tell(system: ContactSystem, report: StepReport) -> None:
    """Log an accepted step."""
    states = ", ".join(f"{k.name}: {k.open}/{k.stick}/{k.slip}" for k in report.contacts)
    message = "step %d: %d iterations, certificate %.0e, open/stick/slip %s"
    values = report.step, report.iterations, report.certificate.relative, states
    tell(system.comm, logging.INFO, message, *values)


@dataclass(frozen=True)
class _Failed:
    """An attempt that found no solution: its report, what is wrong with it, the state."""

    report: StepReport
    wrong: list[str]
    state: snapshot.ProblemSnapshot


def _far(report: StepReport) -> float:
    """Return how far a state is from a solution, relative."""
    return float(np.nan_to_num(report.certificate.relative, nan=np.inf))


def _begin(system: ContactSystem) -> Trials:
    """Pair nodes, choose frames, check friction and measure forces at the start of a step."""
    driven = with_conditions(system.u, system.bcs) - system.u_old.x.array
    for k in system.contacts:
        k.anchor()
        k.choose_frames(driven)
    changed = [*system.state, *(f for k in system.contacts for f in (k.hint, k.free))]
    trials = Trials(system, changed)
    system.set_smoothing(xi=0.0, eps=0.0)
    _check_time(system.dt)
    for body in system.bodies:
        check_held(body, system.contacts)
    for k in system.contacts:
        check_normals(k)  # an obstacle that has moved may have none at some node
        check_friction(k)
    system.scales.begin()
    return trials


def _check_time(dt: fem.Constant) -> None:
    """Refuse a length of the step that is none."""
    if not 0.0 < dt.value < np.inf:
        raise ContactInputError(
            f"problem.dt = {float(dt.value):g} s must be positive and finite: it is the length of "
            "the step, by which slip rates are divided."
        )
