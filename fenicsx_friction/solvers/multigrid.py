# SPDX-License-Identifier: MIT
"""Algebraic multigrid for the matrix of Newton's method, displacements and multipliers.

The matrix ``[K B; C D]`` is solved by GMRES. Its preconditioner is a block factorisation in which
the multipliers are eliminated node by node, approximately. What remains, ``K`` with a spring at
each closed node, gets one V-cycle of smoothed aggregation, which knows the rigid-body modes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import any_rank
from ..base.keeping import ErrorKeeper
from ..equations.blocks import Coupling
from .border import Border
from .options import inside, refused, set_up
from .rigid_modes import rigid_modes
from .saddle import SaddleBlocks
from .sparsity import zeros_of_both

Array = npt.NDArray[np.floating]

#: Of the V-cycle on the displacements. SOR is what matters: slipping nodes are stiff across the
#: direction of slip, not along the axes, and a pointwise smoother does not see that.
CYCLE_OPTIONS: dict[str, object] = {
    "pc_type": "gamg",
    "mg_levels_ksp_type": "richardson",
    "mg_levels_ksp_max_it": 1,
    "mg_levels_pc_type": "sor",
}
#: Names of options that begin so are those of the V-cycle.
CYCLE = "multigrid_"
#: The levels are made anew when they have cost so many iterations more than at the rate of their
#: first solve. To make them costs as much as about a dozen V-cycles; counts vary with the states.
PATIENCE = 8


#: Of relative tolerances.
SMALLEST = 1e-16
#: What makes the linear solver fail where the matrix is not finite.
NOT_FINITE = PETSc.PC.FailedReason.SETUP_ERROR


class Multigrid:
    """A preconditioner, as PETSc calls it; collective. It must not hold the linear solver.

    The finest level always has the matrix of now. The others stay as long as they serve.

    Args:
        u: The displacement.
        motions: Those of rigid bodies that carry loads.
        multipliers: Those of all contacts.
        couplings: Returns places, values and softness of the blocks of each contact, now.
        prefix: Of the options of the V-cycle.
        options: Of the whole solver; those that begin with :data:`CYCLE` count.
        errors: Keeps what the callbacks raise.

    Attributes:
        set_ups: How often the levels were made.
        fresh: Whether they were made from the matrix of now.
    """

    def __init__(
        self,
        u: fem.Function,
        motions: Sequence[fem.Function],
        multipliers: Sequence[fem.Function],
        couplings: Callable[[], list[Coupling]],
        prefix: str,
        options: Mapping[str, object],
        errors: ErrorKeeper,
    ) -> None:
        self._V, self._couplings, self._errors = u.function_space, couplings, errors
        given = {k.removeprefix(CYCLE): v for k, v in options.items() if k.startswith(CYCLE)}
        self._prefix, self._options = f"{prefix}{CYCLE}", {**CYCLE_OPTIONS, **given}
        self._blocks = SaddleBlocks(u, motions, multipliers)
        self._border = Border(self._blocks) if motions else None
        self._cycle: PETSc.PC | None = None
        self.set_ups, self.fresh = 0, False
        self._decades, self._spent, self._worn = 1.0, 0, False
        self._rate: float | None = None
        self._waste = 0.0

    def expect(self, accuracy: float) -> None:
        """Judge the last solve; take the relative tolerance of the next one."""
        if self._spent:
            if self._rate is None:
                self._rate = self._spent / self._decades
            self._waste += max(self._spent - self._rate * self._decades, 0.0)
            self._worn |= self._waste > PATIENCE
        self._decades, self._spent = max(-np.log10(max(accuracy, SMALLEST)), 1.0), 0

    def forget(self) -> None:
        """Make all levels anew at the next solve."""
        self._worn = True

    # -- called by PETSc -------------------------------------------------------------------------

    def setUp(self, pc: PETSc.PC) -> None:
        """Eliminate the multipliers; set up the V-cycle for what remains."""
        with self._errors():
            pc.setFailedReason(PETSc.PC.FailedReason.NOERROR)  # PETSc keeps the last one
            couplings = self._couplings()
            finite = all(np.isfinite(a).all() for _, blocks, _ in couplings for a in blocks)
            if any_rank(self._V.mesh.comm, not finite):
                pc.setFailedReason(NOT_FINITE)
                return
            self._blocks.update(couplings)
            self._assemble(pc.getOperators()[1])
            cycle = self._cycle or self._new_cycle()
            self.fresh = self._cycle is None or self._worn
            if self.fresh:
                self._make_levels(cycle)
            self._cycle, self._worn = cycle, False
            if self._border and not self._border.update(pc.getOperators()[1], self._solve):
                pc.setFailedReason(NOT_FINITE)

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve with the block factorisation and one V-cycle."""
        with self._errors():
            if self._border:
                self._border.apply(pc.getOperators()[1], self._solve, r, x)
            else:
                self._solve(r, x)
            self._spent += 1

    def _solve(self, r: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve for displacements and multipliers; rigid bodies rest."""
        blocks, n = self._blocks, self._blocks.num_u
        assert self._cycle is not None and blocks.forces is not None
        forces, laws = r.array_r[:n], r.array_r[n + blocks.num_q :]
        self._c.array[:] = blocks.multipliers(laws)
        blocks.forces.matrix.mult(self._c, self._b)
        self._b.array[:] = forces - self._b.array_r
        self._cycle.apply(self._b, self._y)
        blocks.slopes.matrix.mult(self._y, self._c)
        x.array[:n] = self._y.array_r
        x.array[n : n + blocks.num_q] = 0.0
        x.array[n + blocks.num_q :] = blocks.multipliers(laws - self._c.array_r)

    def reset(self, pc: PETSc.PC) -> None:
        """Free all matrices."""
        self._blocks.destroy()
        if self._border:
            self._border.destroy()
        if self._cycle is not None:
            for o in (self._cycle, self._bulk, self._P, self._b, self._y, self._c):
                o.destroy()
        self._cycle = None

    def destroy(self, pc: PETSc.PC) -> None:
        """Free all matrices."""
        self.reset(pc)

    # -- parts -----------------------------------------------------------------------------------

    def _assemble(self, J: PETSc.Mat) -> None:
        """Put bulk and springs into one matrix."""
        own, structure = self._own_rows(J), PETSc.Mat.Structure
        if self._cycle is None:
            self._bulk = self._P = J.createSubMatrix(own, own)
            if self._blocks.coupled:  # springs join nodes that nothing in the bulk joins
                self._P = zeros_of_both(self._bulk, self._blocks.springs)
        else:
            J.createSubMatrix(own, own, self._bulk)
        own.destroy()
        if self._P != self._bulk:
            self._P.zeroEntries()
            self._P.axpy(1.0, self._bulk, structure.SUBSET_NONZERO_PATTERN)
        self._P.axpy(1.0, self._blocks.springs, structure.SUBSET_NONZERO_PATTERN)

    def _own_rows(self, J: PETSc.Mat) -> PETSc.IS:
        """Return the rows of this rank's displacements."""
        return PETSc.IS().createStride(self._blocks.num_u, self._blocks.first_row, comm=J.comm)

    def _make_levels(self, cycle: PETSc.PC) -> None:
        """Make all levels from the matrix of now."""
        cycle.setReusePreconditioner(False)
        try:
            with inside(self._prefix, self._options):  # the levels read theirs here
                cycle.setUp()
        except PETSc.Error as error:
            raise refused(self._options, error) from error
        # Other preconditioners keep a factor, which must not be an old one.
        cycle.setReusePreconditioner(cycle.getType() == PETSc.PC.Type.GAMG)
        self.set_ups += 1
        self._rate, self._waste = None, 0.0

    def _new_cycle(self) -> PETSc.PC:
        """Make a V-cycle that knows the rigid-body modes."""
        P = self._P
        assert self._blocks.forces is not None
        self._b, self._y = P.createVecs()
        self._c = self._blocks.forces.matrix.createVecRight()
        P.setBlockSize(self._V.mesh.geometry.dim)
        modes = rigid_modes(self._V)
        P.setNearNullSpace(modes)
        modes.destroy()
        P.setOption(PETSc.Mat.Option.SPD, True)
        cycle = PETSc.PC().create(P.comm)
        cycle.setOptionsPrefix(self._prefix)
        cycle.setOperators(P)
        set_up(cycle, self._options)
        return cycle
