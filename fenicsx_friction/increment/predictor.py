# SPDX-License-Identifier: MIT
"""The predictor that all ways to solve an increment share, and their tolerances."""

from mpi4py import MPI

import numpy as np

from ..base.collective import largest_of_ranks
from ..equations.conditions import with_conditions
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


def contact_forces(system: ContactSystem) -> float:
    """Return the contact forces (2-norm over the nodes, N)."""
    return _norm(system, *(s.area[:, None] * s.c for s in system.nodal_states()))


def soft_forces(system: ContactSystem) -> float:
    """Return the forces (2-norm, N) that loads and motions of a step can bring to the contacts.

    A stiff body that is moved on a soft one is far from its balance at first, but meets the
    stiffness of the soft one only. What further unknowns bring is not known.
    """
    if len(system.unknowns) > 1:
        return float("inf")
    loads = system.balance.without_contact()[0]
    held = system.constrained_dofs
    loads[held[held < len(loads)]] = 0.0
    moved = with_conditions(system.u, system.bcs) - system.u.x.array
    (jump,) = largest_of_ranks(system.comm, np.array([np.max(abs(moved), initial=0.0)]))
    owned = [k.felt.x.array[: k.surface.num_owned] for k in system.contacts]
    stiffness = [felt * k.nodal_area() for felt, k in zip(owned, system.contacts, strict=True)]
    depths = [np.minimum(k.pairing.gaps(), 0.0) for k in system.contacts]
    pushes = [a * g for a, g in zip(stiffness, depths, strict=True)]
    return sum(_norm(system, *p) for p in ([loads], [float(jump) * a for a in stiffness], pushes))


def _norm(system: ContactSystem, *values: np.ndarray) -> float:
    """Return the 2-norm of values of all ranks."""
    local = sum(float(np.sum(a**2)) for a in values)
    return float(np.sqrt(system.comm.allreduce(local, MPI.SUM)))


def expected_traction(system: ContactSystem, forces: float) -> float:
    """Return the traction (Pa) that spreads the forces over the contact nodes."""
    return forces / _norm(system, *(s.area for s in system.nodal_states()))
