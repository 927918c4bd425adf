# SPDX-License-Identifier: MIT
"""What resists motions of whole bodies: conditions, closed contact, springs and turning forces."""

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from ..base.collective import largest_of_ranks
from ..certificate.nodal_state import OPEN, UNLIMITED
from ..certificate.scales import DIGITS
from ..contact.contact import Contact
from ..equations.contact_terms import add_rows
from ..equations.floating import fewer_rows
from ..equations.loose import LooseMotion
from ..equations.numbering import num_owned
from .carrying import carrying
from .grip import Grip
from .system import ContactSystem

Array = npt.NDArray[np.floating]
#: Rounding of the virtual work of a body, in units of that of stiffness times motion.
SUMMED = 8.0


class Resistance:
    """Finds what resists motions; methods are collective.

    Args:
        system: The system, at a solution.
    """

    def __init__(self, system: ContactSystem) -> None:
        self._system, self._comm = system, system.comm
        self._sizes = [num_owned(f) for f in system.state]
        self._terms, self._law = system.terms, system.projection.law
        self._blocks, self._places = self._terms.matrices(self._law), self._terms.places(self._law)
        states = system.nodal_states()
        closed = [s.states() != OPEN for s in states]
        self._closed = [a & b for a, b in zip(closed, carrying(system, states), strict=True)]
        limits = [
            np.where(s.ties | (s.own_map is not None), UNLIMITED, s.limit) * c
            for c, s in zip(self._closed, states, strict=True)
        ]
        self._fast = [limit >= UNLIMITED for limit in limits]
        self._limits = [np.where(a, 0.0, b) for a, b in zip(self._fast, limits, strict=True)]
        self._metrics = [_metrics(k) for k in system.contacts]
        scales = system.scales.scales(system.balance.momentum())
        self._allowed = scales.allowed(system.settings.tolerance)
        self._forces = [
            np.linalg.norm(s.c, axis=1) * k.nodal_area() * c
            for k, s, c in zip(system.contacts, states, self._closed, strict=True)
        ]
        areas = np.array([np.max(k.nodal_area(), initial=0.0) for k in system.contacts])
        self._areas = largest_of_ranks(self._comm, areas)  # far apart, maybe

    def of(self, motions: Sequence[LooseMotion], every: Sequence[LooseMotion]) -> Array:
        """Return what resists motions whatever they do, relative, one column each.

        They meet conditions, the pressures of closed nodes and those that cannot slide, springs in
        the bulk, and forces that turn with a body or move on it. For friction see :meth:`grip`.

        Args:
            motions: The motions.
            every: All loose motions: the work of forces in each is one row.
        """
        length, held = self._system.floating.length, self._system.floating.held
        rows = np.stack([m.values[0][held] for m in motions], axis=1)
        forces = length * self._comm.allreduce(np.array([self._force_on(m) for m in every]))
        work = np.zeros((len(every), len(motions)))
        if np.any(forces > 0.0):
            work += (forces > 0.0)[:, None] * self._of_contact(motions, every)
        if any(m.deformable for m in motions):
            work += self._of_bulk(motions, every)
        largest = np.maximum(forces, np.max(abs(work), axis=1))[:, None]
        relative = np.divide(work, largest, out=np.zeros_like(work), where=largest > 0.0)
        parts = [fewer_rows(self._comm, part) / length for part in (rows, self._felt(motions))]
        return np.concatenate([_finite(p) for p in (*parts, relative)])

    def _force_on(self, m: LooseMotion) -> float:
        """Return the sum of the forces of nodes that feel a motion (N), on this rank."""
        total = 0.0
        for i, forces in enumerate(self._forces):
            steps = self._terms.at_blocks(i, self._law, m.virtual, 0.0).by_multipliers()
            feels = np.any([np.any(step != 0.0, axis=1) for step, _ in steps], axis=0)
            total += float(np.sum(forces[feels]))
        return total

    def grip(self, motions: Sequence[LooseMotion]) -> Grip:
        """Return how friction holds motions."""
        friction, doubts, scales = [], [], self._system.scales
        for i, (closed, metric) in enumerate(zip(self._closed, self._metrics, strict=True)):
            felt = self._areas[i] * self._felt_by(i, motions)[:, 1:]
            doubt = self._allowed[(1 + i) * scales.number :][scales.node_bodies[i]] * closed
            doubts.append(doubt[:, None, None] * felt)
            felt = felt if metric is None else metric @ felt
            friction.append(self._limits[i][:, None, None] * felt)
        work, doubt = (_finite(np.concatenate(part)) for part in (friction, doubts))
        return Grip(self._comm, work, doubt, self._errors(motions))

    def _felt(self, motions: Sequence[LooseMotion]) -> Array:
        """Return what closed nodes feel: motions along their normals, others if they are fast."""
        rows = [np.zeros((1, len(motions)))]
        for i, (closed, fast) in enumerate(zip(self._closed, self._fast, strict=True)):
            felt = self._felt_by(i, motions)
            rows += [felt[closed, 0], *(felt[fast, j] for j in range(1, felt.shape[1]))]
        return np.concatenate(rows)

    def _errors(self, motions: Sequence[LooseMotion]) -> Array:
        """Return the virtual work of forces that may be out of balance (N m)."""
        floating, n = self._system.floating, self._sizes[0]
        forces = np.repeat(self._allowed[floating.body], self._system.u.x.block_size)[:n]
        found = self._comm.allreduce(np.array([forces @ abs(m.virtual[0][:n]) for m in motions]))
        number = len(self._system.unknowns)  # of the groups the rigid bodies are the last
        for i in range(1, number):
            sizes = [np.max(abs(m.virtual[i]), initial=0.0) for m in motions]
            found += np.array(sizes) * self._allowed[i - number]
        return np.asarray(found)

    def _felt_by(self, i: int, motions: Sequence[LooseMotion]) -> Array:
        """Return what the nodes of a contact feel of motions (m), (nodes, d, motions)."""
        felt = []
        for m in motions:
            steps = self._terms.at_blocks(i, self._law, m.virtual, 0.0)
            pairs = zip(self._blocks[i].by_multipliers(), steps.by_multipliers(), strict=True)
            felt.append(sum(np.einsum("nij,ni->nj", block, step) for block, (step, _) in pairs))
        return np.stack(felt, axis=2) / self._areas[i]

    def _of_contact(self, motions: Sequence[LooseMotion], every: Sequence[LooseMotion]) -> Array:
        """Return the virtual work of the forces of contact that follow motions (N m)."""
        columns, shares = [], self._shares(every)
        for m in motions:
            vector = PETSc.Vec().createMPI((sum(self._sizes), None), comm=self._comm)
            for i, (blocks, places) in enumerate(zip(self._blocks, self._places, strict=True)):
                steps = self._terms.at_blocks(i, self._law, m.values, 0.0)
                parts = (blocks.stiff(), places.stiff(), steps.stiff())
                for block, (rows, _), (_, step) in zip(*parts, strict=True):
                    add_rows(vector, rows, np.einsum("nij,nj->ni", block, step))
            vector.assemble()
            columns.append(shares @ vector.array_r)
            vector.destroy()
        return np.asarray(self._comm.allreduce(np.column_stack(columns)))

    def _of_bulk(self, motions: Sequence[LooseMotion], every: Sequence[LooseMotion]) -> Array:
        """Return the virtual work of the forces in the bulk that motions make (N m)."""
        stiffness, n = self._system.stiffness.assemble(), self._sizes[0]
        motion, forces = stiffness.createVecs()
        diagonal, columns = abs(stiffness.getDiagonal().array_r), []
        shares = self._shares(every)[:, :n]
        for m in motions:
            motion.array[:] = m.values[0][:n]
            stiffness.mult(motion, forces)
            columns.append(shares @ forces.array_r)
        for o in (motion, forces, stiffness):
            o.destroy()
        with np.errstate(invalid="ignore"):  # infinite stiffness of what has flown away
            rounding = [[diagonal @ m.values[0][:n] ** 2 for m in p] for p in (every, motions)]
        work = self._comm.allreduce(np.column_stack(columns))
        a, b = (np.sqrt(self._comm.allreduce(np.array(part))) for part in rounding)
        return np.where(abs(work) > SUMMED * DIGITS * np.outer(a, b), work, 0.0)

    def _shares(self, motions: Sequence[LooseMotion]) -> Array:
        """Return the shares of motions in the owned rows, one row each."""
        return np.array(
            [
                np.concatenate([a[:n] for a, n in zip(m.virtual, self._sizes, strict=True)])
                for m in motions
            ]
        )


def _finite(resistance: Array) -> Array:
    """Return numbers: infinite motions may leave none, which resist nothing."""
    return np.where(np.isfinite(resistance), resistance, 0.0)


def _metrics(contact: Contact) -> Array | None:
    """Return the metrics of a law as its limits need them, see :class:`.LawRows`; collective."""
    metrics = contact.metrics()
    if metrics is None:
        return None
    sizes = abs(np.linalg.det(metrics)) ** (1.0 / metrics.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):  # see _finite
        return np.asarray(metrics / sizes[:, None, None])
