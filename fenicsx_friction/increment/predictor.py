# SPDX-License-Identifier: MIT
"""The predictor that all ways to solve an increment share, and their tolerances."""

from mpi4py import MPI

import numpy as np

from ..solvers.report import SubstepReport
from . import snapshot
from .system import ContactSystem

#: Newton stops at this fraction of the certificate's tolerance.
NEWTON_TOLERANCE = 1e-2
#: Tolerance of the ramp's stages before the last, and of the predictor.
STAGE_TOLERANCE = 1e-6


def newton_tolerance(system: ContactSystem) -> float:
    """Return the relative tolerance of the last stage; acceptance is up to the certificate."""
    return NEWTON_TOLERANCE * system.settings.tolerance


def predict(system: ContactSystem, eps: float, iterations: int | None) -> list[SubstepReport]:
    """Let all closed nodes stick, in at most so many iterations, else those of the settings."""
    if iterations is None:
        iterations = system.settings.predictor_iterations
    if iterations == 0:
        return []
    start = snapshot.save(system.state)
    report = system.run(system.stick, STAGE_TOLERANCE, eps=eps, max_it=iterations)
    if not np.all(np.isfinite(report.residuals)) or "LINEAR" in report.reason:
        snapshot.restore(system.state, start)
    return [report]


def expected_traction(system: ContactSystem, forces: float) -> float:
    """Return the traction (Pa) that spreads the forces over the contact nodes."""
    local = sum(float(np.sum(s.area**2)) for s in system.nodal_states())
    return forces / float(np.sqrt(system.comm.allreduce(local, MPI.SUM)))
