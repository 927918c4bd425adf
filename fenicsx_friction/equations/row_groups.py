# SPDX-License-Identifier: MIT
"""The rows of the system in groups: of which body, contact or equation, and in which unit."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import largest_of_ranks
from ..base.groups import Array, Groups, Labels
from ..contact.contact import Contact
from .body_equation import BodyEquation
from .conditions import constrained_dofs
from .further_equation import FurtherEquation
from .numbering import num_owned


class MeasuredRows:
    """Rows with the group that each belongs to.

    Args:
        comm: The ranks.
        number: Number of groups.
        labels: Group of each row of this rank, or -1.
        weights: What a row is in the unit of its group (N or Pa).
        compliances: What a row is in metres.
    """

    def __init__(
        self, comm: MPI.Intracomm, number: int, labels: Labels, weights: Array, compliances: Array
    ) -> None:
        self._comm, self._labels, self.size = comm, labels, len(labels)
        self._weights, self._compliances = weights, compliances
        self._groups = Groups(labels, number)

    def part(self, rows: npt.NDArray[np.int64], number: int) -> MeasuredRows:
        """Return some rows alone, which belong to some first groups."""
        parts = (self._labels[rows], self._weights[rows], self._compliances[rows])
        return MeasuredRows(self._comm, number, *parts)

    def residuals(self, rows: Array) -> tuple[Array, Array]:
        """Return the largest residual of each group (N or Pa), and over the stiffness (m)."""
        sizes = abs(rows)
        largest = [self._groups.largest(sizes * w) for w in (self._weights, self._compliances)]
        residual, distance = largest_of_ranks(self._comm, np.stack(largest))
        return residual, distance


class RowGroups:
    """Groups the owned rows of a system and brings them to the units of their groups.

    The groups are the bodies (N), the bodies of each contact (Pa), and the bodies of each further
    equation.

    Args:
        unknowns: The unknowns of the bulk, displacement first.
        contacts: The contacts.
        bcs: Dirichlet conditions.
        stiffness: Diagonal of the bulk stiffness (N/m) at the owned dofs of the displacement.
        equations: The equations beside the momentum balance.
        bodies: Body of each owned dof of the displacement.
        of_contacts: Body of each owned node of each contact.
        number: Number of bodies.

    Attributes:
        bodies: Groups the owned dofs of the displacement by body.
        held: The same for the prescribed ones.
        equilibrium: The groups of the bodies and of the further equations.
        held_rows: The owned rows of the system that are conditions.
        units: Factors that make forces of the owned rows, but for conditions, as far as there are
            any: rows of volumes, say, would drown the forces in some units of length.
        row_factors: The same, and stiffnesses at the conditions.
    """

    def __init__(
        self,
        unknowns: Sequence[fem.Function],
        contacts: Sequence[Contact],
        bcs: Sequence[fem.DirichletBC],
        stiffness: Array,
        equations: Sequence[FurtherEquation | BodyEquation],
        bodies: Labels,
        of_contacts: Sequence[Labels],
        number: int,
    ) -> None:
        self._comm = unknowns[0].function_space.mesh.comm
        self._contacts, self._equations = contacts, equations
        fixed = [_fixed(f, bcs) for f in unknowns]
        self.bodies = Groups(bodies, number)
        self.held = Groups(np.where(fixed[0], bodies, -1), number)
        largest = largest_of_ranks(self._comm, np.array([np.max(stiffness, initial=0.0)]))
        self._typical = float(largest[0])
        self._stiffness = np.where(stiffness > 0.0, stiffness, self._typical)
        self._group(fixed, bodies, of_contacts, number)
        self._find_conditions(fixed)

    def residuals(self, rows: Array) -> tuple[Array, Array]:
        """Return the largest residual of each group (N or Pa), and over the stiffness (m).

        Args:
            rows: Some first owned rows of the system, multiplied by the row factors; collective.
        """
        every = np.zeros(len(self.row_factors))
        every[: len(rows)] = rows
        return self._measured.residuals(every)

    def part(self, rows: npt.NDArray[np.int64], number: int) -> MeasuredRows:
        """Return some owned rows alone.

        Args:
            rows: Their numbers.
            number: How many first groups they belong to.
        """
        return self._measured.part(rows, number)

    def missed(self, rows: Array) -> Array:
        """Return the largest distance of each unknown from its conditions, on this rank.

        Args:
            rows: The owned rows of the system, multiplied by the row factors.
        """
        return self._conditions.largest(abs(rows) / self.row_factors)

    def _group(
        self,
        fixed: Sequence[npt.NDArray[np.bool_]],
        bodies: Labels,
        of_contacts: Sequence[Labels],
        number: int,
    ) -> None:
        """Number the groups of the rows; what a row is in their unit, and in metres."""
        labels, weights = [np.where(fixed[0], -1, bodies)], [np.ones(len(bodies))]
        units = weights[:1]
        compliances: list[Array] = [1.0 / self._stiffness]
        first = groups = number * (1 + len(self._contacts))
        for held, equation in zip(fixed[1:], self._equations, strict=True):
            labels.append(np.where(held, -1, groups + equation.body))
            groups += equation.number
            weights.append(np.ones(len(held)))
            units.append(np.where(held, 1.0, equation.unit))
            slope = np.full(len(held), self._typical) if equation.linked else equation.slope
            compliances.append(_over(weights[-1], slope))
        for i, (k, body) in enumerate(zip(self._contacts, of_contacts, strict=True)):
            d = k.pairing.side.d
            labels.append(np.repeat(number * (1 + i) + body, d))
            weights.append(np.repeat(1.0 / k.nodal_area(), d))
            units.append(np.ones(len(weights[-1])))
            compliances.append(weights[-1] / np.repeat(k.nodal_scale(), d))
        self.equilibrium, self.units = np.r_[:number, first:groups], np.concatenate(units)
        parts = (np.concatenate(labels), np.concatenate(weights), np.concatenate(compliances))
        self._measured = MeasuredRows(self._comm, groups, *parts)

    def _find_conditions(self, fixed: Sequence[npt.NDArray[np.bool_]]) -> None:
        """Find the rows that are conditions, and what makes forces of them."""
        conditions = np.full(self._measured.size, -1)
        unknown = np.repeat(np.arange(len(fixed)), [len(held) for held in fixed])
        held = np.concatenate(fixed)
        conditions[: len(held)] = np.where(held, unknown, -1)
        self._conditions = Groups(conditions, len(fixed))
        self.held_rows = np.flatnonzero(held)
        factors = np.concatenate([self._stiffness, *(e.row_factors for e in self._equations)])
        self.row_factors = self.units.copy()
        self.row_factors[self.held_rows] = factors[self.held_rows]


def _fixed(f: fem.Function, bcs: Sequence[fem.DirichletBC]) -> npt.NDArray[np.bool_]:
    """Tell which owned dofs of a Function are under a condition."""
    fixed = np.zeros(num_owned(f), dtype=bool)
    dofs = constrained_dofs(f.function_space, bcs)
    fixed[dofs[dofs < len(fixed)]] = True
    return fixed


def _over(values: Array, by: Array) -> Array:
    """Divide; by nothing there is no limit."""
    return np.divide(values, by, out=np.full(len(by), np.inf), where=by > 0.0)
