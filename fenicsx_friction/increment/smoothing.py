# SPDX-License-Identifier: MIT
"""Smoothing: one of the ways to solve an increment, the surest one where friction is high.

The smoothed complementarity has a solution that changes little with ``eps``. It is followed from
the size of the tractions down to zero, where the law is the exact one.
"""

from dataclasses import dataclass

import numpy as np

from ..solvers.report import SubstepReport
from . import snapshot
from .predictor import STAGE_TOLERANCE, expected_traction, newton_tolerance, predict
from .system import ContactSystem


@dataclass(frozen=True)
class Pace:
    """How fast the smoothing ``eps`` goes to zero.

    Attributes:
        tolerance: Of each stage before the last, relative.
        first: Factor by which ``eps`` falls at first; its square root takes over after a failure.
        slowest: No factor is nearer to one.
        easy: After a stage with at most this many iterations, ``eps`` falls faster:
        power: this power of the factor takes over.
        smallest: Smallest ``eps`` before 0, relative to the expected traction.
    """

    tolerance: float
    first: float
    slowest: float
    easy: int
    power: float
    smallest: float


#: Iterations of a stage, and of the last one where all else has failed.
STAGE, LAST_STAGE = 40, 100
#: The first stage goes on as long as the residual falls to this fraction in so many iterations.
FALLS, PART = 0.5, 10
#: Rough stages, and stages that follow the path of solutions exactly.
QUICK = Pace(1e-2, first=0.3, slowest=0.9, easy=6, power=1.5, smallest=1e-4)
CAREFUL = Pace(STAGE_TOLERANCE, first=0.1, slowest=0.95, easy=5, power=1.5, smallest=1e-9)


def smooth(system: ContactSystem, forces: float) -> list[SubstepReport]:
    """Solve the projection rows with ``eps`` from the size of the tractions down to zero.

    Where the first stage does not converge, there is no such way.
    """
    largest = expected_traction(system, forces)
    if largest == 0.0:  # nothing to start from
        return [_stage(system, 0.0, newton_tolerance(system), STAGE)]
    reports = predict(system, system.settings.smoothing * largest, None)
    reports += _begin(system, largest)
    if not reports[-1].converged:
        return reports
    start = snapshot.save(system.state)
    for pace in (QUICK, CAREFUL):
        snapshot.restore(system.state, start)
        stages = _sharpen(system, largest, pace)
        reports += stages
        if stages[-1].converged:
            return reports
    reports.append(_stage(system, 0.0, newton_tolerance(system), LAST_STAGE))
    return reports


def _begin(system: ContactSystem, largest: float) -> list[SubstepReport]:
    """Find a first smoothed state, as long as the residual falls."""
    reports: list[SubstepReport] = []
    for _ in range(STAGE // PART):
        report = _stage(system, largest, QUICK.tolerance, PART)
        reports.append(report)
        if report.converged or not _has_fallen(report):
            break
    return reports


def _has_fallen(report: SubstepReport) -> bool:
    """Tell whether the residual has fallen enough to go on; it may not even exist."""
    norms = report.residuals
    return bool(norms) and norms[-1] < FALLS * norms[0]


def _sharpen(system: ContactSystem, largest: float, pace: Pace) -> list[SubstepReport]:
    """Let the smoothing fall to zero from its largest value, where the state is a solution."""
    reports: list[SubstepReport] = []
    last, fall, good = largest, pace.first, snapshot.save(system.state)
    while last > 0.0 and fall < pace.slowest:
        eps = last * fall if last * fall > pace.smallest * largest else 0.0
        reports.append(_stage(system, eps, pace.tolerance if eps else newton_tolerance(system)))
        if reports[-1].converged:
            good, last = snapshot.save(system.state), eps
            if reports[-1].iterations <= pace.easy:
                fall = fall**pace.power
        else:
            snapshot.restore(system.state, good)
            fall = np.sqrt(fall)
    return reports


def _stage(system: ContactSystem, eps: float, tolerance: float, most: int = STAGE) -> SubstepReport:
    """Solve the projection rows, smoothed."""
    return system.run(system.projection, tolerance, eps=eps, line_search="bt", max_it=most)
