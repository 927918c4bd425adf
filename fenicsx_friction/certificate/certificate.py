# SPDX-License-Identifier: MIT
"""The certificate: how well a state solves the unsmoothed law, without ``eps`` and ``xi``.

Plain NumPy on nodal values, independent of the rows that the solver uses. The law enters only
through its limit, and the projection is written a second time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

from mpi4py import MPI

import numpy as np

from ..base.groups import Array, Groups
from .nodal_state import NodalState
from .scales import Scales, coarsest
from .violations import largest_of_nodes, natural_maps, unphysical_part, worst_of_ranks

#: More relative rounding than this means that displacements are out of bounds.
DROWNED = 1e-2


@dataclass(frozen=True)
class Certificate:
    """How far a state violates each condition of the law, and equilibrium; largest over the nodes.

    The conditions are those of eqs. (3)-(5) of the paper.

    ``R_n = c_n - max(c_n - r g, 0)`` and ``R_t = c_t - P(c_t - r s)`` vanish, with equilibrium,
    if and only if the step solves the unsmoothed Signorini-Coulomb increment. Relative numbers are
    the worst of all groups, each by its own scale: a natural map by the largest traction of that
    contact on that body, equilibrium by the largest force on that body.

    Attributes:
        normal_map: ``|R_n|`` (Pa).
        tangential_map: ``|R_t|`` (Pa).
        penetration: ``max(-g)`` (m), of all nodes.
        tension: ``max(-c_n)`` (Pa).
        complementarity: ``|c_n g|`` (J/m²).
        cone: ``|c_t| - limit`` (Pa).
        alignment: ``limit |s| + c_t . s`` (J/m²): zero without slip, and where the traction has its
            limit and is opposite to the slip.
        negative_limit: How far the friction limit is below zero (Pa).
        negative_dissipation: Frictional power of the wrong sign (J/m²).
        equilibrium: Largest nodal residual force on the free dofs (N, per unit depth in 2D).
        natural_map: Largest natural-map residual, relative.
        unbalanced: Largest residual of equilibrium and of further equations, relative.
        unphysical: Largest negative limit or dissipation, relative.
        boundary: Largest distance from a prescribed value, relative to the largest value.
        pushed: How far conditions push held nodes into an obstacle (m), beyond how they started.
        resolution: The estimated relative rounding error of the faintest body or contact that
            carries forces. Where it is larger than the tolerance, it replaces the tolerance.
        excess: The largest residual in units of what tolerance and rounding allow.
        traction_scale: The largest traction (Pa).
        force_scale: The largest force (N).
        tolerance: Relative tolerance of :attr:`certified`.
        certifiable: False if some law states no cone: then ``tangential_map`` is its own residual,
            and the state is solved but not certified.
        drowned: Whether the residual of some body or contact is only rounding, but more of it than
            may pass.
        crossed: Number of contacts with nodes that went through the obstacle within the step.
        adrift: Number of bodies that have moved in a direction in which nothing holds them.
    """

    normal_map: float
    tangential_map: float
    penetration: float
    tension: float
    complementarity: float
    cone: float
    alignment: float
    negative_limit: float
    negative_dissipation: float
    equilibrium: float
    natural_map: float
    unbalanced: float
    unphysical: float
    boundary: float
    pushed: float
    resolution: float
    excess: float
    traction_scale: float
    force_scale: float
    tolerance: float
    certifiable: bool = True
    crossed: int = 0
    adrift: int = 0
    drowned: bool = False

    @property
    def relative(self) -> float:
        """The worst of natural map, equilibrium, sign of friction and boundary values, relative."""
        # np.max returns NaN if there is one, max() may not.
        parts = [self.natural_map, self.unbalanced, self.unphysical, self.boundary]
        return float(np.max(parts))

    @property
    def resolved(self) -> bool:
        """Whether rounding leaves digits to all bodies and contacts that carry forces."""
        return bool(self.resolution <= coarsest(self.tolerance))

    @property
    def solved(self) -> bool:
        """Whether all residuals are small and more than rounding, and no body went astray."""
        small = self.excess <= 1.0 and self.boundary <= self.tolerance
        astray = self.pushed > 0.0 or self.crossed > 0 or self.adrift > 0
        return bool(small and self.resolved and not astray)

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
    surfaces: Sequence[Groups],
    scales: Scales,
    unbalanced: tuple[Array, Array],
    boundary: float,
    pushed: float,
    tolerance: float,
) -> Certificate:
    """Certify a state; return the certificate, equal on all ranks; collective.

    Args:
        comm: Communicator of the mesh.
        states: The nodal values of all contacts on this rank.
        surfaces: Groups the nodes of each contact by body.
        scales: Scales of all groups, see ``ForceScales``.
        unbalanced: Largest residual of each body and further equation (N), and over the stiffness
            of its own dof (m), equal on all ranks.
        boundary: Relative distance from prescribed values, equal on all ranks.
        pushed: How far conditions push held nodes into an obstacle (m), equal on all ranks.
        tolerance: Relative tolerance.
    """
    worst = worst_of_ranks(comm, states, surfaces)
    bodies, both = worst.shape[1] // max(len(states), 1), np.stack(unbalanced)
    contacts = slice(bodies, bodies + worst.shape[1])
    parts = [both[:, :bodies], natural_maps(worst), both[:, bodies:]]
    residual, apart = np.concatenate(parts, axis=1)
    relative = scales.relative(residual, apart, tolerance)
    loud, tractions = ~scales.quiet(tolerance)[contacts], scales.largest[contacts]
    unphysical = unphysical_part(worst, tractions, scales.hidden[contacts], loud, tolerance)
    resolution = scales.resolution(residual, tolerance)
    excess = np.append(scales.excess(residual, apart, tolerance), unphysical / tolerance)
    return Certificate(
        **largest_of_nodes(worst),
        equilibrium=float(np.max(unbalanced[0][:bodies], initial=0.0)),
        natural_map=float(np.max(relative[contacts], initial=0.0)),
        unbalanced=float(np.max(np.delete(relative, contacts), initial=0.0)),
        unphysical=unphysical,
        boundary=boundary,
        pushed=pushed,
        resolution=float(np.max(resolution, initial=0.0)),
        drowned=_drowned(relative, resolution, tolerance),
        excess=float(np.max(excess)),
        traction_scale=float(np.max(scales.largest[contacts], initial=0.0)),
        force_scale=float(np.max(scales.largest[:bodies], initial=0.0)),
        tolerance=tolerance,
        certifiable=all(state.own_map is None for state in states),
    )


def _drowned(relative: Array, resolution: Array, tolerance: float) -> bool:
    """Tell whether what is left of some group is rounding, but more of it than may pass."""
    left = relative <= np.maximum(resolution, tolerance)
    return bool(np.any(left & (resolution > coarsest(tolerance)) & (resolution <= DROWNED)))
