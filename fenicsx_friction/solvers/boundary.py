# SPDX-License-Identifier: MIT
"""The equations on the dofs of contact alone, as SNES calls them, for a bulk that is condensed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import gather_rows
from ..base.keeping import ErrorKeeper
from ..contact.contact import Contact
from ..equations.blocks import Blocks, Places, columns_of_laws
from ..equations.contact_terms import ContactTerms, Law
from ..equations.numbering import num_owned, spread
from .boundary_matrix import BoundaryMatrix
from .condensed_bulk import CondensedBulk
from .eliminated import Block, Elements
from .loaded_bodies import LoadedBodies

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]

#: Tractions on open nodes below this fraction of the largest are rounding.
FAINT = 1e-13


class BoundaryEquations:
    """Balance of forces on the dofs of contact, and the rows of the laws; collective.

    Unknown are, rank by rank, the displacements of these dofs, the motions of rigid bodies that
    carry loads, and the multipliers. It serves PETSc
    as the context of matrix and preconditioner, too. It must not hold the SNES, see ``Callbacks``.

    Args:
        bulk: The condensed bulk.
        bodies: The rigid bodies that carry loads.
        unknowns: All unknowns of the problem, displacement first, multipliers last.
        contacts: The contacts.
        bcs: Dirichlet conditions.

    Attributes:
        bulk, bodies: As given.
        terms: The terms of contact, by these numbers.
        own: Where the unknowns of this rank are among the owned rows of the whole system.
        law: The rows of the substep that is being solved.
        errors: What the callbacks have raised.
    """

    def __init__(
        self,
        bulk: CondensedBulk,
        bodies: LoadedBodies,
        unknowns: Sequence[fem.Function],
        contacts: Sequence[Contact],
        bcs: Sequence[fem.DirichletBC],
    ) -> None:
        self.comm = unknowns[0].function_space.mesh.comm
        self.bulk, self.bodies, self._unknowns = bulk, bodies, list(unknowns)
        self._contacts = contacts
        #: Unknowns whose own dofs are all here.
        self._whole = self._unknowns[len(unknowns) - len(contacts) - len(bodies.motions) :]
        self.law: Law | None = None
        self.errors = ErrorKeeper()
        self._matrix: BoundaryMatrix | None = None
        self._number()
        self.terms = ContactTerms(contacts, unknowns, bcs, self._rows)

    def _number(self) -> None:
        """Number the unknowns of this and of all ranks."""
        owned = [num_owned(f) for f in self._unknowns]
        bulk, moving = len(owned) - len(self._whole), len(self.bodies.motions)
        sizes = [len(self.bulk.dofs), *owned[bulk:]]
        all_sizes = np.array(self.comm.allgather(sizes))
        d = self._unknowns[0].function_space.mesh.geometry.dim
        self._nodes = all_sizes[:, 1 + moving :].T // d  # of each contact, on each rank
        self._components = all_sizes[:, 1 : 1 + moving].sum(axis=1)
        self.size, self._counts = sum(sizes), all_sizes.sum(axis=1)
        first = int(np.sum(self._counts[: self.comm.rank]))
        ends = np.cumsum([first, *sizes])
        self._rows = [np.full(len(f.x.array), -1) for f in self._unknowns]
        self._rows[0] = spread(self._unknowns[0].function_space, self.bulk.dofs, ends[0])
        for i, f in enumerate(self._whole):
            every = np.arange(sizes[1 + i])
            self._rows[bulk + i] = spread(f.function_space, every, ends[1 + i])
        starts = np.cumsum([0, *owned])
        self.own = np.concatenate([self.bulk.dofs, np.arange(starts[bulk], starts[-1])])
        # Displacements of all ranks, in the order of the Schur complement, motions, multipliers.
        kinds = np.repeat([0, 1, 2], [1, moving, len(self._contacts)])
        kind = np.concatenate([np.repeat(kinds, row) for row in all_sizes])
        self._place = np.empty(len(kind) + 1, dtype=np.int64)
        self._place[np.argsort(kind, kind="stable")] = np.arange(len(kind))
        self._place[-1] = -1
        at = int(np.sum(all_sizes[: self.comm.rank, 0]))
        self._own_forces = slice(at, at + sizes[0])

    # -- unknowns --------------------------------------------------------------------------------

    def vector(self) -> PETSc.Vec:
        """Return a new vector of the unknowns."""
        return PETSc.Vec().createMPI((self.size, None), comm=self.comm)

    def read(self, x: PETSc.Vec) -> None:
        """Take the present values of the unknowns."""
        parts = [self._unknowns[0].x.array[self.bulk.dofs]]
        parts += [f.x.array[: num_owned(f)] for f in self._whole]
        x.array[:] = np.concatenate(parts)

    @contextmanager
    def _at(self, x: PETSc.Vec) -> Iterator[None]:
        """Put an iterate into the unknowns; inside, the kinematics are those there."""
        values, at = x.array_r, len(self.bulk.dofs)
        self._unknowns[0].x.array[self.bulk.dofs] = values[:at]
        self._unknowns[0].x.scatter_forward()
        for f in self._whole:
            f.x.array[: num_owned(f)] = values[at : at + num_owned(f)]
            f.x.scatter_forward()
            at += num_owned(f)
        with (
            np.errstate(over="ignore", invalid="ignore"),
            self.terms.still(),
        ):
            yield

    def accept(self, x: PETSc.Vec) -> None:
        """Put a solution into the unknowns; what carries nothing carries no rounding, either.

        Multipliers follow from forces. Those of prescribed directions and of open nodes are zero up
        to the rounding of these.
        """
        with self._at(x):
            for k in self._contacts:
                c = k.c.x.array.reshape(-1, k.pairing.side.d)
                c[k.free.x.array.reshape(c.shape) < 0.5] = 0.0
                size = np.linalg.norm(c[: k.surface.num_owned], axis=1)
                largest = self.comm.allreduce(float(np.max(size, initial=0.0)), MPI.MAX)
                c[: len(size)][(k.pairing.gaps() > 0.0) & (size < FAINT * largest)] = 0.0
                k.c.x.scatter_forward()

    def begin(self) -> float:
        """Condense the loads of a step; return the 2-norm of the rows without contact (N)."""
        forces = self.bulk.begin()
        of_bodies = self.bodies.begin(self.bulk.others)
        return float(np.sqrt(forces**2 + self.comm.allreduce(of_bodies**2)))

    def forget_matrix(self) -> None:
        """Free the memory of the dense matrix."""
        self._matrix = None

    # -- called by PETSc -------------------------------------------------------------------------

    def residual(self, snes: PETSc.SNES | None, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Evaluate the equations."""
        with self.errors(), self._at(x):
            bulk, n = self.bulk, len(self.bulk.dofs)
            b.zeroEntries()
            moved = bulk.gathered() - bulk.start
            b.array[:n] = bulk.loads + bulk.schur[self._own_forces] @ moved
            b.array[n : n + self.bodies.size] = self.bodies.rows()
            assert self.law is not None
            self.terms.add_residual(b, self.law)

    def jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        """Evaluate and factor the matrix."""
        with self.errors(), self._at(x):
            assert self.law is not None
            places, blocks = self.terms.places(self.law), self.terms.matrices(self.law)
            parts = [
                self._nodes_of_all(*part) for part in zip(self._nodes, places, blocks, strict=True)
            ]
            turning = [
                self._of_all(place, values)
                for p, b in zip(places, blocks, strict=True)
                for place, values in zip(p.stiff(), b.stiff(), strict=True)
            ]
            self._matrix = None  # two would take twice the memory
            springs = gather_rows(self.comm, self.bodies.slopes, self._components)
            size = len(self._place) - 1
            self._matrix = BoundaryMatrix(self.bulk.schur, springs, parts, turning, size)

    def mult(self, J: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Multiply by the matrix."""
        with self.errors():
            assert self._matrix is not None
            self._exchange(x, y, self._matrix.__matmul__)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve with the matrix."""
        with self.errors():
            assert self._matrix is not None
            self._exchange(b, x, self._matrix.solve)

    def _exchange(self, given: PETSc.Vec, found: PETSc.Vec, work: Callable[[Array], Array]) -> None:
        """Let every rank work on the values of all, and keep its own results."""
        order = self._place[:-1]
        values = np.empty(len(order))
        values[order] = gather_rows(self.comm, given.array_r, self._counts)
        first = int(np.sum(self._counts[: self.comm.rank]))
        found.array[:] = work(values)[order][first : first + self.size]

    def _nodes_of_all(self, counts: Indices, at: Blocks[Places], blocks: Blocks[Array]) -> Elements:
        """Return the nodes of a contact of all ranks."""
        stencil, multipliers, motion = columns_of_laws(at, blocks)
        parts = (*at.laws, blocks.laws, np.concatenate(blocks.by_multipliers(), axis=1))
        c, columns, laws, forces = (gather_rows(self.comm, rows, counts) for rows in parts)
        # What the multipliers load comes first: nodes, then a rigid body.
        loaded = blocks.levers.shape[1]
        q = np.r_[:loaded, motion, loaded : stencil.stop]
        by_q, by_c = laws[:, :, q], laws[:, :, multipliers]
        return Elements(self._place[columns[:, q]], self._place[c], by_q, by_c, forces)

    def _of_all(self, places: Places, values: Array) -> Block:
        """Return blocks of all ranks, as many as there are on each."""
        counts = np.array(self.comm.allgather(len(values)))
        rows, columns, values = (gather_rows(self.comm, part, counts) for part in (*places, values))
        return self._place[rows], self._place[columns], values
