# SPDX-License-Identifier: MIT
"""The certificate: how well a state solves the unsmoothed law, without ``eps`` and ``xi``.

Plain NumPy on nodal values, independent of the rows that the solver uses: the law enters only
through its limit, the projection is written anew.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]
OPEN, STICK, SLIP = 0, 1, 2
#: Tractions below this fraction of the step's forces set no scale.
FAINT = 1e-4
#: Limits (Pa) from here on mean permanent stick.
UNLIMITED = 1e299


@dataclass(frozen=True)
class NodalState:
    """Nodal values of one contact on this rank, one row a node.

    Attributes:
        gap: Gap (m).
        slip: Slip increment of the step (m), ``gdim - 1`` columns.
        limit: Friction limit (Pa) at the pressure ``max(c_n - r gap, 0)``.
        c: Multipliers ``(c_n, c_t)`` (Pa).
        r: Scale (Pa/m).
        area: Nodal area.
        free: False for the prescribed directions; a node with a prescribed normal is no
            contact node.
        own_map: ``|R_t|`` (Pa) of a law that states no cone, by its own residual, or ``None``.
    """

    gap: Array
    slip: Array
    limit: Array
    c: Array
    r: Array
    area: Array
    free: npt.NDArray[np.bool_]
    own_map: Array | None = None

    @property
    def takes_part(self) -> npt.NDArray[np.bool_]:
        """Nodes whose normal direction is free."""
        return self.free[:, 0]

    @property
    def trial(self) -> Array:
        """The argument ``c_t - r s`` of the tangential projection (Pa)."""
        return self.c[:, 1:] - self.r[:, None] * self.slip

    def natural_map(self) -> tuple[Array, Array]:
        """Return the natural-map residuals ``R_n`` and ``|R_t|`` of each node (Pa)."""
        normal = self.c[:, 0] - np.maximum(self.c[:, 0] - self.r * self.gap, 0.0)
        length = np.linalg.norm(self.trial, axis=1)
        outside = length > self.limit
        shrink = np.divide(self.limit, length, out=np.ones_like(length), where=outside)
        tangential = self.c[:, 1:] - shrink[:, None] * self.trial
        part = self.takes_part
        size = np.linalg.norm(tangential, axis=1) if self.own_map is None else self.own_map
        return abs(normal) * part, size * part

    def states(self) -> npt.NDArray[np.int8]:
        """Return OPEN, STICK or SLIP of each node."""
        closed = self.c[:, 0] - self.r * self.gap >= 0.0
        slips = np.linalg.norm(self.trial, axis=1) >= self.limit
        return np.where(closed & self.takes_part, np.where(slips, SLIP, STICK), OPEN).astype(
            np.int8
        )


@dataclass(frozen=True)
class Certificate:
    """Violation of each condition of eqs. (3)-(5) and of equilibrium; largest over the nodes.

    ``R_n = c_n - max(c_n - r g, 0)`` and ``R_t = c_t - P(c_t - r s)`` vanish, with equilibrium,
    if and only if the step solves the unsmoothed Signorini-Coulomb increment.

    Attributes:
        normal_map: ``|R_n|`` (Pa).
        tangential_map: ``|R_t|`` (Pa).
        penetration: ``max(-g)`` (m).
        tension: ``max(-c_n)`` (Pa).
        complementarity: ``|c_n g|`` (J/m²).
        cone: ``|c_t| - limit`` (Pa).
        alignment: ``limit |s| + c_t . s``, the power missing to slip opposite to the traction
            (J/m²).
        equilibrium: Largest nodal residual force on the free dofs (N, per unit depth in 2D).
        rounding: Force (N) that rounding hides at displacements of this size; what it hides is not
            certified. Large where a body is not held.
        boundary: Largest distance from a prescribed value, relative to the largest value.
        traction_scale: The traction (Pa) that makes the maps relative.
        force_scale: The force (N) that makes equilibrium relative.
        tolerance: Relative tolerance of :attr:`certified`.
        certifiable: False if some law states no cone: then ``tangential_map`` is its own residual,
            and the state is solved but not certified.
    """

    normal_map: float
    tangential_map: float
    penetration: float
    tension: float
    complementarity: float
    cone: float
    alignment: float
    equilibrium: float
    rounding: float
    boundary: float
    traction_scale: float
    force_scale: float
    tolerance: float
    certifiable: bool = True

    @property
    def natural_map(self) -> float:
        """Largest natural-map residual relative to the traction scale."""
        worst = float(np.max([self.normal_map, self.tangential_map]))
        return _ratio(worst, self.traction_scale)

    @property
    def relative(self) -> float:
        """The worst of natural map, equilibrium, rounding and boundary values, relative."""
        # np.max hands NaN on, max() may not.
        force = float(np.max([self.equilibrium, self.rounding]))
        return float(np.max([self.natural_map, _ratio(force, self.force_scale), self.boundary]))

    @property
    def solved(self) -> bool:
        """Whether all residuals are within the tolerance."""
        return bool(self.relative <= self.tolerance)

    @property
    def certified(self) -> bool:
        """Whether the state solves the unsmoothed increment to the tolerance."""
        return self.solved and self.certifiable

    def as_dict(self) -> dict[str, float | bool]:
        """Return all entries, relative ones included, for a table or a JSON file."""
        entries: dict[str, float | bool] = {f.name: getattr(self, f.name) for f in fields(self)}
        return entries | {"relative": self.relative, "certified": self.certified}


def certify(
    comm: MPI.Intracomm,
    states: Sequence[NodalState],
    *,
    equilibrium: float,
    force_scale: float,
    rounding: float,
    boundary: float,
    tolerance: float,
) -> Certificate:
    """Certify a state; collective.

    Args:
        comm: Communicator of the mesh.
        states: The nodal values of all contacts on this rank.
        equilibrium: Largest residual force on the free dofs (N), equal on all ranks.
        force_scale: Largest force of the state (N): contact, reaction or load.
        rounding: Force (N) that rounding hides, equal on all ranks.
        boundary: Relative distance from prescribed values, equal on all ranks.
        tolerance: Relative tolerance.

    Returns:
        The certificate, equal on all ranks. Tractions are relative to the largest contact
        traction, or to :data:`FAINT` of the force scale over the smallest nodal area where
        contact is fainter still.
    """
    names = [f.name for f in fields(Certificate)][:7]
    worst = np.zeros(len(names))
    traction = np.zeros(2)
    for state in states:
        part = state.takes_part
        c_n, c_t = state.c[:, 0], np.linalg.norm(state.c[:, 1:], axis=1)
        work = state.limit * np.linalg.norm(state.slip, axis=1) + np.einsum(
            "ij,ij->i", state.c[:, 1:], state.slip
        )
        signorini = [-state.gap, -c_n, abs(c_n * state.gap)]
        # A limit beyond any traction has no power to compare with.
        work = np.where(state.limit < UNLIMITED, work, 0.0)
        quantities = [*state.natural_map(), *signorini, c_t - state.limit, abs(work)]
        worst = np.maximum(worst, [np.max(q * part, initial=0.0) for q in quantities])
        largest = np.max(np.hypot(c_n, c_t), initial=0.0)
        per_area = np.max(1.0 / state.area, initial=0.0)
        traction = np.maximum(traction, [largest, FAINT * force_scale * per_area])
    everything = np.array([*worst, *traction])
    # NaN may pass for the smaller number in MAX; infinity does not.
    everything[~np.isfinite(everything)] = np.inf
    comm.Allreduce(MPI.IN_PLACE, everything, op=MPI.MAX)
    values = dict(zip(names, everything.tolist(), strict=False))
    scale = float(max(everything[-2:]))
    return Certificate(
        **values,
        equilibrium=equilibrium,
        rounding=rounding,
        boundary=boundary,
        traction_scale=scale,
        force_scale=force_scale,
        tolerance=tolerance,
        certifiable=all(state.own_map is None for state in states),
    )


def _ratio(value: float, scale: float) -> float:
    """Return ``value / scale``, and ``value`` itself where there is no scale (no load at all)."""
    return value / scale if 0.0 < scale < float("inf") else value
