# SPDX-License-Identifier: MIT
"""The scales of a problem: the forces in each body and the tractions of each contact."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import largest_of_ranks
from ..base.groups import Array, Groups
from ..certificate.scales import DIGITS, SHARE, Scales, joined
from ..contact.contact import Contact
from ..surfaces.cells import extreme_sizes
from .balance import Balance
from .bodies import link_bodies
from .body_equation import BodyEquation, bodies_of
from .boundary_measure import BoundaryMeasure
from .conditions import with_conditions
from .contact_terms import ContactTerms
from .floating import FloatingBodies
from .further_equation import FurtherEquation
from .noise import caused_by, rounding_errors
from .row_groups import RowGroups
from .tractions import Tractions

#: Rounding errors of forces may be this many times those of one measurement, and at most this
#: fraction of stiffness times cell size. What comes from a pressure grows with the bulk modulus.
NOISE, MOST_NOISE, MOST_DOUBT = 4.0, 1e-11, 1e-8
#: A condition is met up to this distance, relative to the largest value.
MISSED = 1e-12


class ForceScales:
    """Finds the scale of each group of a problem; all methods are collective.

    The groups are the bodies (forces, N), the bodies of each contact (tractions, Pa), and the
    bodies of each equation beside the momentum balance.

    Args:
        unknowns: The unknowns of the bulk, displacement first.
        contacts: The contacts.
        bcs: Dirichlet conditions.
        stiffness: Diagonal of the bulk stiffness (N/m) at the owned dofs of the displacement.
        equations: The equations beside the momentum balance.
        terms: How contact enters the equations.
        balance: Assembles the rows of the equations.
        floating: Knows the bodies.

    Attributes:
        number, stiffest: Number of bodies, and the largest stiffness of each (N/m).
        extent: Size of the mesh (m).
        surfaces, node_bodies: Groups the owned nodes of each contact by body; the body of each.
        nodes_across: Number of nodes across all contacts, a root of their number in 3D.
        equilibrium: The groups of the bodies and of the further equations.
        held_rows: The owned rows of the system that are conditions.
        row_factors: What the system's rows are multiplied by, see ``RowGroups``.
    """

    #: What :meth:`begin` and :meth:`find_noise` set: arrays that are replaced, never changed.
    AT_START = ("_forces", "_given", "_length", "_doubted", "_values", "_noise")

    def __init__(
        self,
        unknowns: Sequence[fem.Function],
        contacts: Sequence[Contact],
        bcs: Sequence[fem.DirichletBC],
        stiffness: Array,
        equations: Sequence[FurtherEquation | BodyEquation],
        terms: ContactTerms,
        balance: Balance,
        floating: FloatingBodies,
    ) -> None:
        self._unknowns, self._contacts, self._bcs = list(unknowns), contacts, bcs
        self._u, self._terms, V = unknowns[0], terms, unknowns[0].function_space
        self._balance, self._equations = balance, equations
        self._comm, self.number, body = V.mesh.comm, floating.number, floating.body
        self._stiffness = abs(stiffness)
        self.node_bodies = [body[k.parent_dofs[: k.surface.num_owned]] for k in contacts]
        each = V.dofmap.index_map_bs
        self._labels = np.repeat(body, each)[: len(stiffness)]
        parts = (self._labels, self.node_bodies, self.number)
        self._rows = RowGroups(unknowns, contacts, bcs, self._stiffness, equations, *parts)
        self._all, self._held = self._rows.bodies, self._rows.held
        self.equilibrium, self.held_rows = self._rows.equilibrium, self._rows.held_rows
        self.row_factors = self._rows.row_factors
        self.stiffest = self.largest(self._stiffness)
        self._linked = link_bodies(contacts, self.node_bodies, V, body, self.number)
        nodes = sum(self._comm.allgather(sum(map(len, self.node_bodies))))
        self.nodes_across = nodes ** (1.0 / (each - 1))
        # What moves a node by the size of the mesh: more, as in a jammed corner, would hide errors.
        self._cell, self.extent = extreme_sizes(V.mesh)[1], floating.length
        self._most = self.extent * self.stiffest
        given = (self._comm, contacts, self.node_bodies, self.number, self.extent)
        self._tractions = Tractions(*given)
        self.surfaces = self._tractions.groups
        measured = [self, self._tractions, *equations]
        self._measured: list[ForceScales | Tractions | FurtherEquation | BodyEquation] = measured
        self.begin()

    def begin(self) -> None:
        """Keep the forces at the start of a step, under its new loads and boundary values."""
        forces = np.maximum(
            self._all.largest(abs(self._balance.momentum())), self._contact_forces()
        )
        self._forces = self._over_ranks(forces)
        self._noise: Array = np.zeros(self.number)
        self._tractions.begin()
        there = [
            np.maximum(abs(f.x.array), abs(with_conditions(f, self._bcs))) for f in self._unknowns
        ]
        given = self._all.largest(there[0][: len(self._stiffness)])
        given = np.maximum(self._over_ranks(given), DIGITS * self.extent)  # less is nothing
        # Bodies that meet share the rounding of their forces and displacements.
        noise = DIGITS * np.stack([self.stiffest * given, given])
        noise = np.concatenate([noise, self._doubts()[None]])
        linked = [np.max(noise[:, self._linked == part], axis=1) for part in self._linked]
        self._given, self._length, self._doubted = np.transpose(linked)
        self._values = self._over_ranks(np.array([np.max(v, initial=0.0) for v in there]))
        for equation in self._equations:
            equation.begin()

    def _doubts(self) -> Array:
        """Return the forces (N) that the rounding of further unknowns brings to each body."""
        found = np.zeros(self.number)
        for f, equation in zip(self._unknowns[1:], self._equations, strict=True):
            if (errors := equation.doubts()) is not None:
                found += self._rounding(caused_by(f, errors, self._balance.momentum), MOST_DOUBT)
        return found

    def _rounding(self, forces: Array, most: float) -> Array:
        """Return the largest of each body (N), nothing where this is no rounding.

        Displacements are out of bounds then, or there is a kink.

        Args:
            forces: Forces at the owned dofs (N).
            most: The strain that makes more than rounding.
        """
        found = self.largest(forces)
        return np.where(found <= most * self.stiffest * self._cell, found, 0.0)

    def save(self) -> object:
        """Return what :meth:`begin` has set; not collective."""
        return [(part, {k: getattr(part, k) for k in part.AT_START}) for part in self._measured]

    def restore(self, saved: Any) -> None:
        """Put back what :meth:`save` returned; not collective."""
        for part, values in saved:
            vars(part).update(values)

    def find_noise(self) -> None:
        """Measure the rounding errors of the forces at this state, until the next step or call."""
        momentum, *others = rounding_errors(self._unknowns, self._balance.rows)
        # What a body that has flown away adds to the rounding is no excuse for lost forces.
        far = self.largest(abs(self._u.x.array[: len(self._stiffness)]))
        near = self.extent + self._length / DIGITS
        self._noise = self._rounding(NOISE * momentum, MOST_NOISE) * (near / np.fmax(far, near))
        for equation, errors in zip(self._equations, others, strict=True):
            equation.find_noise(NOISE * errors)

    def residuals(self, *blocks: Array) -> tuple[Array, Array]:
        """Return the largest residuals of the groups in first blocks, see ``RowGroups``."""
        rows = np.concatenate(blocks)
        return self._rows.residuals(rows * self._rows.units[: len(rows)])

    def excess(self, rows: Array, tolerance: float) -> float:
        """Return the largest residual in units of what a relative tolerance allows.

        Args:
            rows: The owned rows of the system, multiplied by the row factors.
            tolerance: Relative tolerance.
        """
        if np.any(self._over_ranks(self._rows.missed(rows)) > MISSED * self._values):
            return np.inf
        found = self._rows.residuals(rows)
        contacts = slice(self.number, self.number * (1 + len(self._contacts)))
        for reactions in (False, True):  # reactions cost an assembly
            scales = self.scales(self._balance.momentum() if reactions else None)
            excess = scales.excess(*found, tolerance, SHARE)
            if np.max(excess) <= 1.0 or np.max(excess[contacts], initial=0.0) > 1.0:
                break
        return float(np.max(excess))

    def scales(self, momentum: Array | None = None) -> Scales:
        """Measure all groups.

        Args:
            momentum: Unbalanced forces (N) of the owned dofs: reactions at held ones count, too.
        """
        hidden = self._stiffness * abs(self._u.x.array[: len(self._stiffness)])
        bodies, contacts = self._of_forces(self._all.largest(hidden), momentum)
        return joined([bodies, contacts, *(e.scales(bodies) for e in self._equations)])

    def largest(self, values: Array) -> Array:
        """Return the largest of sizes at the owned dofs of each body."""
        return self._over_ranks(self._all.largest(values))

    def boundary(self, dofs: npt.NDArray[np.int64], rows: npt.NDArray[np.int64]) -> BoundaryMeasure:
        """Return what measures some rows of bodies and contacts, at the dofs of contact.

        Args:
            dofs: The owned dofs.
            rows: The owned rows.
        """
        groups = Groups(self._labels[dofs], self.number)
        further = self._equations if bodies_of(self._contacts) else []
        number = self.number * (1 + len(self._contacts)) + sum(e.number for e in further)
        part = self._rows.part(rows, number)

        def scales() -> Scales:
            forces = self._stiffness[dofs] * abs(self._u.x.array[dofs])
            bodies, contacts = self._of_forces(groups.largest(forces))
            return joined([bodies, contacts, *(e.scales(bodies) for e in further)])

        return BoundaryMeasure(part, scales, self.nodes_across)

    def _of_forces(self, hidden: Array, momentum: Array | None = None) -> tuple[Scales, Scales]:
        """Measure bodies and contacts.

        Args:
            hidden: Largest stiffness times displacement of each body (N).
            momentum: See :meth:`scales`.
        """
        largest = contact = self._contact_forces()
        if momentum is not None:
            largest = np.maximum(largest, self._held.largest(abs(momentum)))
        all_forces = np.stack([largest, DIGITS * hidden, contact])
        forces, hidden, contact = self._over_ranks(all_forces)
        forces, strict = np.minimum(forces, self._most), np.zeros(self.number, dtype=bool)
        # Where contact carries anything, the rounding of a pressure would be an error of it.
        given = self._given + np.where(contact <= self._given, self._doubted, 0.0)
        bodies = Scales(forces, self._forces, hidden, given, self._length, self._noise, strict)
        loads = np.maximum(forces, self._forces)
        return bodies, self._tractions.scales(loads, self._given, self._length, self._noise)

    def _contact_forces(self) -> Array:
        """Return the largest contact force on a node of each body (N), of this rank."""
        largest = self._tractions.forces()
        if any(k.pairing.deformable for k in self._contacts):  # the reactions are forces, too
            largest = np.maximum(largest, self._all.largest(abs(self._terms.momentum())))
        return largest

    def _over_ranks(self, values: Array) -> Array:
        """Return the largest values of all ranks; what is not a number counts as infinite."""
        return largest_of_ranks(self._comm, values)
