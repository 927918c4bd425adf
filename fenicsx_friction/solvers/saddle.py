# SPDX-License-Identifier: MIT
"""The blocks of the whole system that couple displacements and multipliers, on all ranks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..equations.blocks import Coupling
from ..equations.numbering import num_owned
from .block_matrix import BlockMatrix
from .node_elimination import NodeBlocks, node_blocks

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


class SaddleBlocks:
    """What couples displacements and multipliers; collective.

    Args:
        u: The displacement. No other unknown of the bulk is in the system.
        motions: Those of rigid bodies that carry loads; not eliminated.
        multipliers: Those of all contacts.

    Attributes:
        num_u, num_q, num_c: How many displacements, components of motions and multipliers this rank
            owns.
        first_row: First row of this rank.
        motions: This rank's among the components of the motions of all ranks.
        num_motions: How many these are.
        forces: Matrix: what multipliers do to the balance of forces.
        slopes: Matrix: what displacements do in the rows of the law.
        roots: Matrix: the roots of the springs.
        springs: Matrix: the balance of forces when the multipliers are eliminated, without bulk.
    """

    def __init__(
        self,
        u: fem.Function,
        motions: Sequence[fem.Function],
        multipliers: Sequence[fem.Function],
    ) -> None:
        V = u.function_space
        self._comm, self._d = V.mesh.comm, V.mesh.geometry.dim
        self.num_u = num_owned(u)
        self.num_q, self.num_c = (sum(map(num_owned, fs)) for fs in (motions, multipliers))
        sizes = np.array(self._comm.allgather((self.num_u, self.num_q, self.num_c)))
        self._before_c, self._starts = sizes[:, :2].sum(axis=1), np.cumsum([0, *sizes.sum(axis=1)])
        self._u_starts, self._c_starts = (np.cumsum([0, *sizes[:, i]]) for i in (0, 2))
        self.num_motions, before = sizes[:, 1].sum(), sizes[: self._comm.rank, 1].sum()
        self.motions = slice(before, before + self.num_q)
        self.first_row = int(self._starts[self._comm.rank])
        self.forces: BlockMatrix | None = None
        self._transposed: PETSc.Mat | None = None
        self.springs: PETSc.Mat | None = None
        self._parts: list[NodeBlocks] = []

    @property
    def coupled(self) -> bool:
        """Whether springs join nodes, as between deformable bodies."""
        return any(part.q.shape[1] > self._d for part in self._parts)

    def update(self, couplings: Sequence[Coupling]) -> None:
        """Eliminate the multipliers node by node.

        Args:
            couplings: Places, values and softness of the blocks of each contact. The places are
                those of the first call until :meth:`destroy`.
        """
        self._parts = [node_blocks(*coupling, self._d) for coupling in couplings]
        if self.forces is None:
            self._allocate()
        for name in ("forces", "slopes", "roots"):
            getattr(self, name).set(getattr(part, name) for part in self._parts)
        self._transposed = self.roots.matrix.transpose(self._transposed or PETSc.Mat())
        self.springs = self.roots.matrix.matMult(self._transposed, self.springs)

    def multipliers(self, rows: Array) -> Array:
        """Return the multipliers that rows of the law give where nothing moves; of this rank."""
        result = np.zeros(self.num_c)
        for part, at in zip(self._parts, self._own, strict=True):
            result[at] = np.einsum("nij,nj->ni", part.inverse, rows[at])
        return result

    def destroy(self) -> None:
        """Free the matrices."""
        if self.forces is not None:
            for part in (self.forces, self.slopes, self.roots):
                part.destroy()
            for matrix in (self._transposed, self.springs):
                if matrix is not None:
                    matrix.destroy()
        self.forces = self._transposed = self.springs = None

    def _allocate(self) -> None:
        """Make the matrices for the stencils of now."""
        q = [
            self._numbered(part.q, self._u_starts, np.zeros_like(self._before_c))
            for part in self._parts
        ]
        c = [self._numbered(part.c, self._c_starts, self._before_c) for part in self._parts]
        self._own = [numbers - self._c_starts[self._comm.rank] for numbers in c]
        u_size, c_size = (self.num_u, None), (self.num_c, None)
        self.slopes = BlockMatrix((c_size, u_size), list(zip(c, q, strict=True)), self._comm)
        sizes = [part.roots.shape[::2] for part in self._parts]
        ends = np.cumsum([0, *(n * rank for n, rank in sizes)])
        r_size = (int(ends[-1]), None)
        first = self._comm.scan(r_size[0]) - r_size[0]
        r = [
            first + np.arange(*of_part).reshape(shape)
            for of_part, shape in zip(itertools.pairwise(ends), sizes, strict=True)
        ]
        self.roots = BlockMatrix((u_size, r_size), list(zip(q, r, strict=True)), self._comm)
        self.forces = BlockMatrix((u_size, c_size), list(zip(q, c, strict=True)), self._comm)

    def _numbered(self, rows: Indices, starts: Indices, before: Indices) -> Indices:
        """Return numbers among the unknowns of one kind, of rows of the whole system.

        Args:
            rows: The rows, -1 for those that are left out.
            starts: First number of each rank.
            before: How many rows of other unknowns come first on each rank.
        """
        rank = np.searchsorted(self._starts, np.maximum(rows, 0), side="right") - 1
        return np.where(rows < 0, -1, rows + (starts[:-1] - self._starts[:-1] - before)[rank])
