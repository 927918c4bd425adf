# SPDX-License-Identifier: MIT
"""The scales of a problem: the forces in each body and the tractions of each contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..certificate.groups import Array, Groups, Labels, connected, number_bodies
from ..certificate.scales import DIGITS, FAINT, Scales
from ..contact.contact import Contact
from .conditions import constrained_dofs, with_conditions
from .contact_terms import ContactTerms
from .equations import FurtherEquation
from .noise import rounding_errors

#: Newton stops where a residual is this share of its estimated rounding error.
SHARE = 0.25
#: Rounding errors of forces may be this many times those of one measurement, and at most this
#: fraction of stiffness times cell size.
NOISE, MOST_NOISE = 4.0, 1e-11
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
        residuals: Returns these, and the rows of the further equations.
        momentum: Returns the unbalanced nodal forces (N) of the owned dofs, reactions included.

    Attributes:
        number: Number of bodies.
        surfaces: Groups the owned nodes of each contact, by body.
        contact_nodes: Number of nodes of all contacts.
        equilibrium: The groups of the bodies and of the further equations.
        held_rows: The owned rows of the system that are conditions.
        row_factors: Factors that make all owned rows forces: a stiffness at conditions, else 1.
    """

    #: What :meth:`begin` and :meth:`find_noise` set: arrays that are replaced, never changed.
    AT_START = ("_forces", "_tractions", "_coordinates", "_given", "_length", "_values", "_noise")

    def __init__(
        self,
        unknowns: Sequence[fem.Function],
        contacts: Sequence[Contact],
        bcs: Sequence[fem.DirichletBC],
        stiffness: Array,
        equations: Sequence[FurtherEquation],
        terms: ContactTerms,
        momentum: Callable[[], Array],
        residuals: Callable[[], list[Array]],
    ) -> None:
        self._unknowns, self._contacts, self._bcs = list(unknowns), contacts, bcs
        self._u, self._terms, self._momentum = unknowns[0], terms, momentum
        self._comm, self._equations = self._u.function_space.mesh.comm, equations
        self._measured: list[ForceScales | FurtherEquation] = [self, *equations]
        self.number, body = number_bodies(self._u.function_space)
        self._stiffness = abs(stiffness)
        dofs = np.repeat(body, self._u.function_space.dofmap.index_map_bs)[: len(stiffness)]
        self._bodies = [body[k.parent_dofs[: k.surface.num_owned]] for k in contacts]
        self.surfaces = [Groups(bodies, self.number) for bodies in self._bodies]
        self._group_rows(dofs)
        self._stiffest = self._over_ranks(self._all.largest(self._stiffness))
        self._per_area = self._by_contact([1.0 / k.nodal_area() for k in contacts])
        self._linked = self._link(body)
        self.contact_nodes = self._comm.allreduce(sum(len(n) for n in self._bodies), MPI.SUM)
        msh = self._u.function_space.mesh
        cells = np.arange(msh.topology.index_map(msh.topology.dim).size_local, dtype=np.int32)
        sizes = msh.h(msh.topology.dim, cells)
        self._size = self._comm.allreduce(float(np.max(sizes, initial=0.0)), MPI.MAX)
        self._residuals = residuals
        self.begin()

    def begin(self) -> None:
        """Keep the forces at the start of a step, under its new loads and boundary values."""
        forces = np.maximum(self._all.largest(abs(self._momentum())), self._contact_forces())
        self._forces = self._over_ranks(forces)
        self._noise = np.zeros(self.number)
        self._tractions = self._by_contact(self._traction_lengths())
        self._coordinates = [k.pairing.rounding() for k in self._contacts]
        there = [
            np.maximum(abs(f.x.array), abs(with_conditions(f, self._bcs))) for f in self._unknowns
        ]
        given = self._over_ranks(self._all.largest(there[0][: len(self._stiffness)]))
        # Bodies that meet share the rounding of their forces and displacements.
        noise = DIGITS * np.stack([self._stiffest * given, given])
        linked = [np.max(noise[:, self._linked == part], axis=1) for part in self._linked]
        self._given, self._length = np.transpose(linked)
        values = np.array([np.max(values, initial=0.0) for values in there])
        self._values = self._over_ranks(values)
        for equation in self._equations:
            equation.begin()

    def save(self) -> object:
        """Return what :meth:`begin` has set; not collective."""
        return [(part, {k: getattr(part, k) for k in part.AT_START}) for part in self._measured]

    def restore(self, saved: Any) -> None:
        """Put back what :meth:`save` returned; not collective."""
        for part, values in saved:
            vars(part).update(values)

    def find_noise(self) -> None:
        """Measure the rounding errors of the forces at this state, until the next step or call."""
        momentum, *others = rounding_errors(self._unknowns, self._residuals)
        # More than this is not rounding: displacements are out of bounds, or there is a kink.
        most = MOST_NOISE * self._stiffest * self._size
        noise = self._over_ranks(NOISE * self._all.largest(momentum))
        self._noise = np.where(noise <= most, noise, 0.0)
        for equation, errors in zip(self._equations, others, strict=True):
            equation.find_noise(NOISE * errors)

    def residuals(self, *blocks: Array) -> tuple[Array, Array]:
        """Return the largest residual of each group (N or Pa), and over the stiffness (m).

        Args:
            blocks: The owned rows of some first blocks of the system.
        """
        rows = np.zeros(len(self._weights))
        given = np.concatenate(blocks)
        rows[: len(given)] = abs(given)
        largest = [self._rows.largest(rows * w) for w in (self._weights, self._compliances)]
        residual, distance = self._over_ranks(np.stack(largest))
        return residual, distance

    def excess(self, rows: Array, tolerance: float) -> float:
        """Return the largest residual in units of what a relative tolerance allows.

        Args:
            rows: The owned rows of the system, multiplied by the row factors.
            tolerance: Relative tolerance.
        """
        missed = self._conditions.largest(abs(rows) / self.row_factors)
        if np.any(self._over_ranks(missed) > MISSED * self._values):
            return np.inf
        found = self.residuals(rows)
        contacts = slice(self.number, self.number * (1 + len(self._contacts)))
        for reactions in (False, True):  # reactions cost an assembly
            excess = self.scales(reactions=reactions).excess(*found, tolerance, SHARE)
            if np.max(excess) <= 1.0 or np.max(excess[contacts], initial=0.0) > 1.0:
                break
        return float(np.max(excess))

    def scales(self, *, reactions: bool = True) -> Scales:
        """Measure all groups, with or without the reactions at held dofs."""
        largest = self._contact_forces()
        if reactions:
            largest = np.maximum(largest, self._held.largest(abs(self._momentum())))
        u = self._u.x.array[: len(self._stiffness)]
        local = np.stack([largest, DIGITS * self._all.largest(self._stiffness * abs(u))])
        forces, hidden = self._over_ranks(local)
        strict = np.zeros(self.number, dtype=bool)
        bodies = Scales(
            forces, self._forces, hidden, self._given, self._length, self._noise, strict
        )
        tractions = self._by_contact(self._traction_lengths())
        rounded = [
            k.nodal_scale() * (k.distance() + lengths)
            for k, lengths in zip(self._contacts, self._coordinates, strict=True)
        ]
        unresolved = DIGITS * self._by_contact(rounded)
        each = len(self._contacts)
        faint = FAINT * np.tile(np.maximum(forces, self._forces), each) * self._per_area
        contacts = Scales(
            tractions,
            np.maximum(self._tractions, faint),
            unresolved,
            np.tile(self._given, each) * self._per_area,
            np.tile(self._length, each),
            np.zeros(each * self.number),
            np.tile(strict, each),
        )
        return _joined([bodies, contacts, *(e.scales(bodies) for e in self._equations)])

    def _group_rows(self, bodies: Labels) -> None:
        """Number the groups of the rows of the system, and bring the rows to their units."""
        fixed = [_fixed(f, self._bcs) for f in self._unknowns]
        self._all = Groups(bodies, self.number)
        self._held = Groups(np.where(fixed[0], bodies, -1), self.number)
        typical = float(self._over_ranks(np.array([np.max(self._stiffness, initial=0.0)]))[0])
        stiffness = np.where(self._stiffness > 0.0, self._stiffness, typical)
        labels, weights = [np.where(fixed[0], -1, bodies)], [np.ones(len(bodies))]
        compliances: list[Array] = [1.0 / stiffness]
        first = self.number * (1 + len(self._contacts))
        groups = first
        for held, equation in zip(fixed[1:], self._equations, strict=True):
            labels.append(np.where(held, -1, groups + equation.body))
            groups += equation.number
            weights.append(np.full(len(held), equation.unit))
            slope = np.full(len(held), typical) if equation.linked else equation.slope
            compliances.append(_over(weights[-1], slope))
        d = self._u.function_space.mesh.geometry.dim
        for i, (k, body) in enumerate(zip(self._contacts, self._bodies, strict=True)):
            labels.append(np.repeat(self.number * (1 + i) + body, d))
            weights.append(np.repeat(1.0 / k.nodal_area(), d))
            compliances.append(weights[-1] / np.repeat(k.nodal_scale(), d))
        self._rows = Groups(np.concatenate(labels), groups)
        self.equilibrium = np.r_[: self.number, first:groups]
        self._weights, self._compliances = np.concatenate(weights), np.concatenate(compliances)
        conditions = np.full(len(self._weights), -1)
        unknown = np.repeat(np.arange(len(fixed)), [len(held) for held in fixed])
        held = np.concatenate(fixed)
        conditions[: len(held)] = np.where(held, unknown, -1)
        self._conditions = Groups(conditions, len(fixed))
        self.held_rows = np.flatnonzero(held)
        self.row_factors = np.ones(len(self._weights))
        own = self.held_rows[self.held_rows < len(bodies)]
        self.row_factors[own] = stiffness[own]
        others = self.held_rows[self.held_rows >= len(bodies)]
        factors = [e.row_factors for e in self._equations]
        self.row_factors[others] = np.concatenate([*factors, []])[others - len(bodies)]

    def _link(self, body: Labels) -> Labels:
        """Number the groups of bodies that may meet each other; the group of each body."""
        links = [np.column_stack([np.arange(self.number)] * 2)]
        for k, secondary in zip(self._contacts, self._bodies, strict=True):
            if k.pairing.deformable:
                dofs = k.pairing.partners(self._u.function_space)
                meets = np.unique(np.concatenate([secondary, body[dofs]]))
                found = np.concatenate(self._comm.allgather(meets))
                links.append(np.column_stack([np.full_like(found, found[0]), found]))
        a, b = np.concatenate(links).T
        return connected(self.number, a, b)[1]

    def _contact_forces(self) -> Array:
        """Return the largest contact force on a node of each body (N), of this rank."""
        largest = np.zeros(self.number)
        for k, group, lengths in zip(
            self._contacts, self.surfaces, self._traction_lengths(), strict=True
        ):
            largest = np.maximum(largest, group.largest(k.nodal_area() * lengths))
        largest = np.maximum(largest, self._all.largest(abs(self._terms.momentum())))
        return largest

    def _traction_lengths(self) -> list[Array]:
        """Return the length of each node's traction (Pa), one array a contact."""
        return [np.linalg.norm(k.multipliers(), axis=1) for k in self._contacts]

    def _by_contact(self, values: Sequence[Array]) -> Array:
        """Return the largest values of each contact, body by body, of all ranks."""
        largest = [g.largest(v) for g, v in zip(self.surfaces, values, strict=True)]
        return self._over_ranks(np.concatenate(largest))

    def _over_ranks(self, values: Array) -> Array:
        """Return the largest values of all ranks; NaN counts as infinite."""
        values = np.nan_to_num(values, nan=np.inf, posinf=np.inf)
        self._comm.Allreduce(MPI.IN_PLACE, values, op=MPI.MAX)
        return values


def _fixed(f: fem.Function, bcs: Sequence[fem.DirichletBC]) -> npt.NDArray[np.bool_]:
    """Tell which owned dofs of a Function are under a condition."""
    V = f.function_space
    fixed = np.zeros(V.dofmap.index_map.size_local * V.dofmap.index_map_bs, dtype=bool)
    dofs = constrained_dofs(V, bcs)
    fixed[dofs[dofs < len(fixed)]] = True
    return fixed


def _over(values: Array, by: Array) -> Array:
    """Divide; a division by zero gives infinity."""
    return np.divide(values, by, out=np.full(len(by), np.inf), where=by > 0.0)


def _joined(parts: Sequence[Scales]) -> Scales:
    """Put groups together."""
    return Scales(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Scales)))
