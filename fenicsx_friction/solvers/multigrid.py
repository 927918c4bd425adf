# SPDX-License-Identifier: MIT
"""Algebraic multigrid for the matrix of Newton's method, displacements and multipliers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.keeping import ErrorKeeper
from ..equations.numbering import num_owned
from .node_elimination import NodeBlocks, node_blocks
from .options import DEFAULT_OPTIONS, inside, set_up

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]

#: Of the solver of the whole system.
KRYLOV_OPTIONS: dict[str, object] = {
    "ksp_type": "gmres",
    "ksp_pc_side": "right",
    "ksp_gmres_restart": 50,
    "ksp_max_it": 200,
}
#: Of the V-cycle on the displacements. SOR is what matters: slipping nodes are stiff across the
#: direction of slip, not along the axes, and a pointwise smoother does not see that.
CYCLE_OPTIONS: dict[str, object] = {
    "pc_type": "gamg",
    "mg_levels_pc_type": "sor",
}


#: Names of options that begin so are those of the V-cycle.
CYCLE = "multigrid_"


def options_of(linear_solver: str, options: Mapping[str, object]) -> dict[str, object]:
    """Return the options of the solvers of the whole system."""
    if linear_solver == "direct":
        return {**DEFAULT_OPTIONS, **options}
    newton = {k: v for k, v in DEFAULT_OPTIONS.items() if k.startswith("snes_")}
    return {**newton, **KRYLOV_OPTIONS, **options}


def cycle_options(options: Mapping[str, object]) -> dict[str, object]:
    """Return the options of the V-cycle."""
    return {k.removeprefix(CYCLE): v for k, v in options.items() if k.startswith(CYCLE)}


class Multigrid:
    """A preconditioner, as PETSc calls it; collective.

    Args:
        u: The displacement.
        multipliers: Those of all contacts.
        elements: Returns columns and matrices of the elements of each contact, now.
        prefix: Of the options of the V-cycle.
        options: Over :data:`CYCLE_OPTIONS`.
        errors: Keeps what the callbacks raise.
    """

    def __init__(
        self,
        u: fem.Function,
        multipliers: Sequence[fem.Function],
        elements: Callable[[], list[tuple[Indices, Array]]],
        prefix: str,
        options: Mapping[str, object],
        errors: ErrorKeeper,
    ) -> None:
        V = u.function_space
        self._V, self._d, self._elements = V, V.mesh.geometry.dim, elements
        self._prefix, self._options = prefix, {**CYCLE_OPTIONS, **options}
        self.comm, self.errors = V.mesh.comm, errors
        self._nu, self._nc = num_owned(u), sum(num_owned(c) for c in multipliers)
        sizes = np.array(self.comm.allgather((self._nu, self._nc)))
        self._sizes = sizes[:, 0]
        self._starts = np.cumsum([0, *sizes.sum(axis=1)])
        self._u_starts, self._c_starts = (np.cumsum([0, *column]) for column in sizes.T)
        self._pc: PETSc.PC | None = None
        self.set_ups = 0

    # -- called by PETSc -------------------------------------------------------------------------

    def setUp(self, pc: PETSc.PC) -> None:  # noqa: N802 - PETSc's name
        """Eliminate the multipliers and set up the V-cycle for what remains."""
        with self.errors():
            J = pc.getOperators()[0]
            self._parts = [node_blocks(*element, self._d) for element in self._elements()]
            self._number()
            own = PETSc.IS().createStride(self._nu, int(self._starts[self.comm.rank]), comm=J.comm)
            if self._pc is None:
                self._P = J.createSubMatrix(own, own)
            else:
                J.createSubMatrix(own, own, self._P)
            own.destroy()
            self._couple()
            self._P.axpy(1.0, self._springs, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            if self._pc is None:
                self._make_cycle()
            with inside(self._prefix, self._options):  # the levels read theirs here
                self._pc.setUp()
            self.set_ups += 1

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve the block factorisation with one V-cycle."""
        with self.errors():
            given = r.array_r
            c, law = self._c, given[self._nu :]
            c.array[:] = self._inverse(law)
            self._b.array[:] = given[: self._nu]
            self._forces.mult(c, self._y)
            self._b.axpy(-1.0, self._y)
            self._pc.apply(self._b, self._y)
            self._slopes.mult(self._y, c)
            found = x.array
            found[: self._nu] = self._y.array_r
            found[self._nu :] = self._inverse(law - c.array_r)

    def reset(self, pc: PETSc.PC) -> None:
        """Forget matrices and hierarchy."""
        self.destroy(pc)

    def destroy(self, pc: PETSc.PC) -> None:
        """Destroy matrices and hierarchy."""
        if self._pc is None:
            return
        for o in (self._pc, self._P, self._springs, self._forces, self._slopes, self._c):
            o.destroy()
        self._b.destroy(), self._y.destroy()
        self._pc = None

    # -- parts -----------------------------------------------------------------------------------

    def _number(self) -> None:
        """Number displacements and multipliers apart."""
        self._q = [self._apart(part.q, self._u_starts, 0) for part in self._parts]
        self._at = [self._apart(part.c, self._c_starts, self._sizes) for part in self._parts]

    def _apart(self, rows: Indices, starts: Indices, before: Indices | int) -> Indices:
        """Return numbers among the unknowns of one kind."""
        rank = np.searchsorted(self._starts, rows, side="right") - 1
        rank[rows < 0] = 0
        first = (self._starts[:-1] + before)[rank]
        return np.where(rows < 0, -1, rows - first + starts[:-1][rank])

    def _inverse(self, rows: Array) -> Array:
        """Return the multipliers that rows of the law give where nothing moves."""
        result, first = np.zeros(self._nc), self._c_starts[self.comm.rank]
        for part, at in zip(self._parts, self._at, strict=True):
            result[at - first] = np.einsum("nij,nj->ni", part.inverse, rows[at - first])
        return result

    def _couple(self) -> None:
        """Assemble what couples displacements and multipliers, and the springs."""
        u, c = (self._nu, None), (self._nc, None)
        blocks = list(zip(self._parts, self._q, self._at, strict=True))
        new = self._pc is None
        if new:
            self._forces = self._sparse((u, c), [(q, at) for _, q, at in blocks])
            self._slopes = self._sparse((c, u), [(at, q) for _, q, at in blocks])
            self._springs = self._sparse((u, u), [(q, q) for _, q, _ in blocks])
        for matrix, name in ((self._forces, "forces"), (self._slopes, "slopes"), (self._springs, "springs")):
            values = np.concatenate([getattr(part, name).ravel() for part in self._parts])
            matrix.setValuesCOO(values, addv=PETSc.InsertMode.INSERT_VALUES)

    def _sparse(self, size, places) -> PETSc.Mat:
        """Return a matrix with entries at these rows and columns."""
        matrix = PETSc.Mat().create(self.comm)
        matrix.setSizes(size)
        matrix.setType(PETSc.Mat.Type.AIJ)
        i = np.concatenate([np.repeat(r, c.shape[1], axis=1).ravel() for r, c in places])
        j = np.concatenate([np.tile(c, (1, r.shape[1])).ravel() for r, c in places])
        out = (i < 0) | (j < 0)
        i, j = (np.where(out, -1, k).astype(PETSc.IntType) for k in (i, j))
        matrix.setPreallocationCOO(i, j)
        return matrix

    def _make_cycle(self) -> None:
        """Make the V-cycle, which knows the rigid-body modes."""
        self._b, self._y = self._P.createVecs()
        self._c = self._forces.createVecRight()
        d = self._d
        self._P.setBlockSize(d)
        x = self._V.tabulate_dof_coordinates()[: self._nu // d, :d]
        centre = self.comm.allreduce(x.sum(axis=0)) / self.comm.allreduce(len(x))
        places = PETSc.Vec().createWithArray((x - centre).ravel(), bsize=d, comm=self.comm)
        modes = PETSc.NullSpace().createRigidBody(places)
        self._P.setNearNullSpace(modes)
        self._P.setOption(PETSc.Mat.Option.SPD, True)
        places.destroy(), modes.destroy()
        self._pc = PETSc.PC().create(self.comm)
        self._pc.setOptionsPrefix(self._prefix)
        self._pc.setOperators(self._P)
        set_up(self._pc, self._options)
