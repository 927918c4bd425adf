# SPDX-License-Identifier: MIT
"""How far each node is from each condition of the law."""

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from ..base.groups import Array, Groups
from .nodal_state import UNLIMITED, NodalState
from .scales import coarsest

#: Rows of :func:`_violations`, by the names of the certificate, and three lengths (m).
NODAL = (
    "normal_map",
    "tangential_map",
    "penetration",
    "tension",
    "complementarity",
    "cone",
    "alignment",
    "negative_limit",
    "negative_dissipation",
)


def worst_of_ranks(
    comm: MPI.Intracomm, states: Sequence[NodalState], surfaces: Sequence[Groups]
) -> Array:
    """Return the largest violations of the bodies of each contact, of all ranks; collective.

    Returns:
        One column a body of a contact; rows as in :data:`NODAL`, then slip, elastic length, and
        the natural map as a length (m).
    """
    found = [_by_body(_violations(s), g) for s, g in zip(states, surfaces, strict=True)]
    worst = np.concatenate(found, axis=1)
    # NaN may pass for the smaller number in MAX; infinity does not.
    worst[~np.isfinite(worst)] = np.inf
    comm.Allreduce(MPI.IN_PLACE, worst, op=MPI.MAX)
    return worst


def largest_of_nodes(worst: Array) -> Any:
    """Return the largest violation of all bodies by its name."""
    return {n: float(np.max(row, initial=0.0)) for n, row in zip(NODAL, worst, strict=False)}


def natural_maps(worst: Array) -> Array:
    """Return the natural maps of the bodies (Pa), and over the stiffness (m)."""
    return np.stack([np.maximum(worst[0], worst[1]), worst[-1]])


def unphysical_part(
    worst: Array, tractions: Array, hidden: Array, loud: npt.NDArray[np.bool_], tolerance: float
) -> float:
    """Return the largest negative limit or dissipation, relative, where something acts.

    Args:
        worst: The violations.
        tractions: Scales of the contacts (Pa).
        hidden: Rounding errors of slips times the scale of the natural map (Pa).
        loud: Where something acts.
        tolerance: Relative tolerance; it limits the rounding errors that may pass.
    """
    values = dict(zip(NODAL, worst, strict=False))
    slip, elastic = worst[len(NODAL) : len(NODAL) + 2]
    negative = _worst(values["negative_limit"][loud], tractions[loud])
    power = (tractions * (slip + elastic))[loud]
    rounding = np.minimum(hidden, coarsest(tolerance) * tractions)
    with np.errstate(invalid="ignore"):  # of infinite ones nothing is left out
        lost = np.maximum(values["negative_dissipation"] - elastic * rounding, 0.0)[loud]
    return float(np.max([negative, _worst(lost, power)]))


@np.errstate(over="ignore", invalid="ignore")  # Newton may have gone to infinity
def _violations(state: NodalState) -> Array:
    """Return how far each node is from each condition, then slip, elastic length and map (m)."""
    c_n, c_t = state.c[:, 0], np.linalg.norm(state.c[:, 1:], axis=1)
    slip, part = np.linalg.norm(state.slip, axis=1), state.takes_part
    power = np.einsum("ij,ij->i", state.c[:, 1:], state.slip)
    # A limit beyond any traction has no power to compare with.
    alignment = np.where(state.limit < UNLIMITED, state.limit * slip + power, 0.0)
    normal, tangential = state.natural_map()
    rows = [
        normal,
        tangential,
        np.where(state.ties, abs(state.gap), -state.gap),
        -c_n * (part & ~state.ties),
        abs(c_n * state.gap) * part,
        (c_t - state.limit) * part,
        abs(alignment) * part,
        -state.limit * part,
        power * part,
        slip * part,
        np.hypot(c_n, c_t) / state.r,
        np.maximum(normal, tangential) / state.r,
    ]
    return np.stack(rows)


def _by_body(rows: Array, group: Groups) -> Array:
    """Return the largest of each row, body by body, at least zero."""
    return np.stack([group.largest(np.maximum(row, 0.0)) for row in rows])


def _worst(values: Array, scales: Array) -> float:
    """Return the largest ratio; a value without a scale (no load at all) counts itself."""
    known = (scales > 0.0) & np.isfinite(scales)
    ratio = np.divide(values, scales, out=values.copy(), where=known)
    return float(np.max(ratio, initial=0.0))
