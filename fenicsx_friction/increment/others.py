# SPDX-License-Identifier: MIT
"""Further solutions of a step: with much friction, there may be several, each of them exact.

They are looked for from other starts. Of those found, the one nearest to the last accepted state is
taken: the contact nodes move least. That no other is found is no proof that there is none.
"""

import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

from mpi4py import MPI

import numpy as np

from ..base.collective import any_rank, largest_of_ranks
from ..base.errors import ContactInputError, OutOfMemory
from ..base.groups import Array
from ..base.log import tell as log
from . import snapshot
from .correctors import Attempt
from .report import OtherSolution, StepReport
from .system import ContactSystem
from .trial import Trials, Way

#: Starts from which solutions are looked for: as it was, sticking; and more that cost more: without
#: friction, smoothed.
CHEAP_STARTS = (Attempt("projection", predictor_iterations=0), Attempt("projection"))
STARTS = (*CHEAP_STARTS, Attempt("friction"), Attempt("smoothing"))
#: Coefficients of friction above this make steps on the boundary try the cheap starts unasked.
MUCH_FRICTION = 5.0
#: Displacements and tractions this far apart, relative to the largest, are two solutions.
APART = 1e-6


@dataclass(frozen=True)
class _Solution:
    """A certified state and what is compared: displacements (m) and tractions (Pa), local."""

    report: StepReport
    state: snapshot.ProblemSnapshot
    u: Array
    tractions: Array
    moved: float


def starts(trials: Trials, way: Way) -> Sequence[Attempt]:
    """Return from where to look for other solutions of a step solved in this way; collective."""
    system, asked = trials.system, trials.system.settings.look_for_others
    if asked is None:
        friction = [np.max(k.friction_at_unit_pressure(), initial=0.0) for k in system.contacts]
        much = any_rank(system.comm, bool(max(friction) > MUCH_FRICTION))
        cheap = much and way.condensed and way.attempt is not None
        chosen: Sequence[Attempt] = CHEAP_STARTS if cheap else ()
    else:
        chosen = STARTS if asked else ()
    return [attempt for attempt in chosen if (attempt, way.condensed) not in trials.tried]


def choose(trials: Trials, way: Way, report: StepReport) -> StepReport:
    """Look for other solutions, put the nearest one into the unknowns, report; collective."""
    system, attempts = trials.system, starts(trials, way)
    if not attempts:
        return report
    solutions = [_solution(system, report)]
    for attempt in attempts:
        try:
            found = trials.make(way._replace(attempt=attempt))
        except (OutOfMemory, ContactInputError) as error:  # on all ranks
            log(system.comm, logging.INFO, "no further search for other solutions: %s", error)
            break  # a search must not lose what was found
        if found is not None and found.report.certificate.solved:
            other = _solution(system, found.report)
            if all([_apart(system, other, known) for known in solutions]):
                solutions.append(other)
    nearest, *further = sorted(solutions, key=lambda s: s.moved)
    nearest.state.restore()
    return replace(
        nearest.report,
        substeps=report.substeps,
        searched=tuple(trials.substeps[len(report.substeps) :]),
        others=tuple(_compared(system, nearest, other) for other in further),
        factorisations=trials.factorisations,
        set_ups=trials.set_ups,
    )


def _solution(system: ContactSystem, report: StepReport) -> _Solution:
    """Keep the solution that the unknowns hold."""
    moved = 0.0
    for k in system.contacts:
        side = k.pairing.side
        way = side.owned(system.u.x.array - system.u_old.x.array)
        moved += float(np.sum(k.nodal_area()[:, None] * way**2))
    tractions = np.concatenate([k.pairing.traction() for k in system.contacts])
    total = system.comm.allreduce(moved, MPI.SUM)
    state = snapshot.ProblemSnapshot(system)
    return _Solution(report, state, system.u.x.array.copy(), tractions, total)


def _apart(system: ContactSystem, one: _Solution, other: _Solution) -> bool:
    """Tell whether both displacements and tractions differ; collective.

    Tractions alone may differ where multipliers are redundant, displacements alone by rounding.
    """
    moved = (one.u - system.u_old.x.array, other.u - system.u_old.x.array)
    pairs = (moved, (one.tractions, other.tractions))
    sizes = [[abs(a - b), np.maximum(abs(a), abs(b))] for a, b in pairs]
    local = [float(np.max(values, initial=0.0)) for pair in sizes for values in pair]
    far, largest, pulled, strongest = largest_of_ranks(system.comm, np.array(local))
    apart = max(APART, 10.0 * system.settings.tolerance)
    return bool(far > apart * largest and pulled > apart * strongest)


def _compared(system: ContactSystem, nearest: _Solution, other: _Solution) -> OtherSolution:
    """Report another solution beside the nearest one."""
    difference = np.linalg.norm(other.tractions - nearest.tractions, axis=1)
    traction = system.comm.allreduce(float(np.max(difference, initial=0.0)), MPI.MAX)
    pairs = zip(other.report.contacts, nearest.report.contacts, strict=True)
    force = max(float(np.linalg.norm(np.subtract(a.force, b.force))) for a, b in pairs)
    return OtherSolution(other.report.contacts, force, traction)


def tell(report: StepReport) -> None:
    """Warn of several solutions."""
    if not report.others:
        return
    force, traction = (
        max(getattr(o, f"{name}_difference") for o in report.others)
        for name in ("force", "traction")
    )
    warnings.warn(
        f"Step {report.step} has at least {1 + len(report.others)} certified solutions, up to "
        f"{force:.3g} N in the contact force and {traction:.3g} Pa in a nodal traction apart; the "
        "one nearest to the last accepted state was taken, see report.others.",
        stacklevel=4,
    )
