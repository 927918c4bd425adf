# SPDX-License-Identifier: MIT
"""Compare the derived Jacobians with finite differences of the residuals."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from ..base.validators import instance, integer, number
from ..certificate.nodal_state import OPEN, SLIP, STICK
from ..contact.contact import Contact
from ..increment import snapshot
from ..problem import FrictionalContactProblem
from . import random_state
from .differences import compare
from .jacobian_report import BlockCheck, JacobianReport

Array = npt.NDArray[np.floating]

#: Substeps with the blend ``xi`` and the smoothing ``eps`` (relative to tractions) of their check.
VARIANTS = (("stick", 0.0, 0.5), ("slip", 0.3, 0.5), ("projection", 0.0, 0.0), ("projection", 0, 1))
#: Perturbation of the displacement, relative to the size of the smallest facet.
AMPLITUDE = 1e-2


def check_jacobian(
    problem: FrictionalContactProblem,
    *,
    seed: int = 0,
    step: float = 1e-7,
    amplitude: float | None = None,
) -> JacobianReport:
    """Compare the Jacobian of each substep with central differences of its residual; collective.

    It does so twice: at the present state, and at a state near it whose contact nodes are open,
    sticking and slipping at random. In this mixed state each node is away from the kinks: the
    arguments of ``max`` and projection are at least half the perturbation, about 1e4 steps, from
    their switch. Other kinks may still lie between the differences: the cap of a limit, or a state
    that touches with ``g = c_n = 0``, where ``max`` takes the derivative of one side. Halving the
    step and the jump of the derivative show such rows. They are left out and counted.

    Args:
        problem: The problem; its state and history are the same after, bit for bit.
        seed: Seed of the random state and direction.
        step: Step of the differences, relative to the size of the smallest facet.
        amplitude: Perturbation of the displacement (m); 1/100 of the smallest facet by default.

    Returns:
        The report, equal on all ranks.
    """
    instance(problem, FrictionalContactProblem, "problem", "a FrictionalContactProblem")
    integer(seed, "seed", at_least=0)
    number(step, "step", above=0.0)
    if amplitude is not None:
        number(amplitude, "amplitude (m)", above=0.0)
    rng = np.random.default_rng([seed, problem.comm.rank])
    size = _facet_size(problem)
    amplitude = AMPLITUDE * size if amplitude is None else amplitude
    stiffness = min(np.min(k.r.x.array, initial=np.inf) for k in problem.contacts)
    traction = amplitude * float(problem.comm.allreduce(stiffness, MPI.MIN))
    checks: list[BlockCheck] = []
    with random_state.kept(problem):
        free = random_state.free_masks(problem)
        random_state.freeze(problem, rng, traction, amplitude)
        direction = random_state.direction(problem, free, size, rng)
        checks += _checks(problem, "present", traction, free, direction, step)
        random_state.mix(problem, free, amplitude, rng)
        checks += _checks(problem, "mixed", traction, free, direction, step)
        states = tuple(_count(problem, k) for k in problem.contacts)
    return JacobianReport(tuple(checks), states)


def _facet_size(problem: FrictionalContactProblem) -> float:
    """Return the size of the smallest facet (m); collective."""
    local = min(np.min(k.surface.size.x.array, initial=np.inf) for k in problem.contacts)
    dim = problem.u.function_space.mesh.topology.dim
    return float(problem.comm.allreduce(local, MPI.MIN)) ** (1.0 / (dim - 1))


def _checks(
    problem: FrictionalContactProblem,
    state: str,
    traction: float,
    free: list[npt.NDArray[np.bool_]],
    direction: list[Array],
    step: float,
) -> list[BlockCheck]:
    """Check all substeps at the present unknowns, which are put back.

    Args:
        problem: The problem.
        state: What the report calls this state.
        traction: Unit of the smoothing (Pa).
        free: Dofs of each unknown that no condition holds.
        direction: Direction of the differences.
        step: Their step.
    """
    here, checks = snapshot.save(problem.state), []
    for kind, xi, eps in VARIANTS:
        problem._xi.value = np.asarray(xi)
        problem._eps.value = np.asarray(eps * traction)
        found = compare(problem, getattr(problem, kind), free, direction, step)
        snapshot.restore(problem.state, here)
        checks += [BlockCheck(kind, xi, eps * traction, state, *entry) for entry in found]
    return checks


def _count(problem: FrictionalContactProblem, k: Contact) -> tuple[int, int, int]:
    """Count the open, sticking and slipping nodes of a contact."""
    nodal = k.present()
    counts = np.bincount(nodal.states()[nodal.takes_part], minlength=3)
    total = problem.comm.allreduce(counts, MPI.SUM)
    return int(total[OPEN]), int(total[STICK]), int(total[SLIP])
