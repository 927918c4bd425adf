# SPDX-License-Identifier: MIT
"""What resists motions of whole bodies: conditions, closed contact, springs and turning forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import largest_of_ranks
from ..certificate.nodal_state import OPEN, NodalState
from ..certificate.scales import DIGITS
from ..contact.contact import Contact
from .contact_terms import ContactTerms, Law, add_rows
from .floating import FloatingBodies
from .loose import LooseMotion
from .numbering import num_owned

Array = npt.NDArray[np.floating]
#: Rounding of the virtual work of a body, in units of that of stiffness times motion.
SUMMED = 8.0


class Resistance:
    """Finds what resists motions; methods are collective.

    Args:
        state: All unknowns, multipliers last.
        contacts: The contacts.
        states: Their nodal values on this rank.
        terms: How contact enters the equations.
        law: Rows of the contacts.
    """

    def __init__(
        self,
        state: Sequence[fem.Function],
        contacts: Sequence[Contact],
        states: Sequence[NodalState],
        terms: ContactTerms,
        law: Law,
    ) -> None:
        self._sizes = [num_owned(f) for f in state]
        self._comm, self._terms, self._law = contacts[0].surface.mesh.comm, terms, law
        self._blocks, self._places = terms.matrices(law), terms.places(law)
        self._closed = [s.states() != OPEN for s in states]  # what others carry is rounding
        self._rough = [
            closed & ((s.limit > 0.0) | s.ties | (s.own_map is not None))
            for closed, s in zip(self._closed, states, strict=True)
        ]
        force = sum(
            float(np.linalg.norm(s.c[closed], axis=1) @ k.nodal_area()[closed])
            for k, s, closed in zip(contacts, states, self._closed, strict=True)
        )
        self._force = self._comm.allreduce(force)
        areas = np.array([np.max(k.nodal_area(), initial=0.0) for k in contacts])
        self._areas = largest_of_ranks(self._comm, areas)  # far apart, maybe

    def of(
        self,
        motions: Sequence[LooseMotion],
        every: Sequence[LooseMotion],
        floating: FloatingBodies,
        stiffness: Callable[[], PETSc.Mat],
    ) -> Array:
        """Return what resists motions, relative, one column each.

        They meet conditions, the pressures and friction of closed nodes, springs in the bulk, and
        forces that turn with a body or move on it.

        Args:
            motions: The motions.
            every: All loose motions: the work of forces in each is one row.
            floating: Knows the conditions.
            stiffness: Assembles that of the displacement (N/m), without contact.
        """
        held = np.stack([m.values[0][floating.held] for m in motions], axis=1)
        work = np.zeros((len(every), len(motions)))
        if self._force > 0.0:
            work += self._of_contact(motions, every)
        if any(m.deformable for m in motions):
            work += self._of_bulk(motions, every, stiffness())
        parts = [self._few(held), self._few(self._felt(motions)), work]
        sizes = [floating.length, floating.length, self._force]
        sizes[-1] = max(sizes[-1], float(np.max(abs(work))))
        # Infinite motions may leave no numbers, which resist nothing.
        whole = [
            s > 0.0 and bool(np.all(np.isfinite(p / s))) for p, s in zip(parts, sizes, strict=True)
        ]
        return np.concatenate(
            [p / s if w else np.zeros_like(p) for p, s, w in zip(parts, sizes, whole, strict=True)]
        )

    def _felt(self, motions: Sequence[LooseMotion]) -> Array:
        """Return what closed nodes feel: motions along their normals, and others where rough."""
        rows = [np.zeros((1, len(motions)))]
        for i, (closed, rough) in enumerate(zip(self._closed, self._rough, strict=True)):
            felt = np.stack([self._felt_by(i, m) for m in motions], axis=2)
            rows += [felt[closed, 0], *(felt[rough, j] for j in range(1, felt.shape[1]))]
        return np.concatenate(rows)

    def _felt_by(self, i: int, m: LooseMotion) -> Array:
        """Return what the nodes of a contact feel of a motion (m), (nodes, d)."""
        steps = self._terms.at_blocks(i, self._law, m.virtual, 0.0)
        pairs = zip(self._blocks[i].by_multipliers(), steps.by_multipliers(), strict=True)
        felt = sum(np.einsum("nij,ni->nj", block, step) for block, (step, _) in pairs)
        return np.asarray(felt / self._areas[i])

    def _of_contact(self, motions: Sequence[LooseMotion], every: Sequence[LooseMotion]) -> Array:
        """Return the virtual work of the forces of contact that follow motions (N)."""
        columns = []
        for m in motions:
            vector = PETSc.Vec().createMPI((sum(self._sizes), None), comm=self._comm)
            for i, (blocks, places) in enumerate(zip(self._blocks, self._places, strict=True)):
                steps = self._terms.at_blocks(i, self._law, m.values, 0.0)
                parts = (blocks.stiff(), places.stiff(), steps.stiff())
                for block, (rows, _), (_, step) in zip(*parts, strict=True):
                    add_rows(vector, rows, np.einsum("nij,nj->ni", block, step))
            vector.assemble()
            columns.append(self._works(every, vector.array_r))
            vector.destroy()
        return np.asarray(self._comm.allreduce(np.column_stack(columns)))

    def _of_bulk(
        self, motions: Sequence[LooseMotion], every: Sequence[LooseMotion], stiffness: PETSc.Mat
    ) -> Array:
        """Return the virtual work of the forces in the bulk that motions make (N)."""
        motion, forces = stiffness.createVecs()
        diagonal, n = abs(stiffness.getDiagonal().array_r), self._sizes[0]
        columns, rounding = [], []
        for m in motions:
            motion.array[:] = m.values[0][:n]
            stiffness.mult(motion, forces)
            columns.append(self._works(every, forces.array_r))
            rounding.append(
                [abs(v.values[0][:n]) @ (diagonal * abs(m.values[0][:n])) for v in every]
            )
        for o in (motion, forces, stiffness):
            o.destroy()
        work, noise = self._comm.allreduce(
            np.stack([np.transpose(columns), np.transpose(rounding)])
        )
        return np.where(abs(work) > SUMMED * DIGITS * noise, work, 0.0)

    def _works(self, motions: Sequence[LooseMotion], forces: Array) -> Array:
        """Return the virtual work of forces at the first owned rows, on this rank."""
        shares = [
            np.concatenate([a[:n] for a, n in zip(m.virtual, self._sizes, strict=True)])
            for m in motions
        ]
        return np.array([share[: len(forces)] @ forces for share in shares])

    def _few(self, rows: Array) -> Array:
        """Return fewer rows of all ranks that resist the same."""
        triangle = np.linalg.qr(rows, mode="r")
        return np.concatenate(self._comm.allgather(triangle))
