# SPDX-License-Identifier: MIT
"""A factor of a matrix without some of its rows, and the dense Schur complement of these.

MUMPS finds the Schur complement within the factorisation. petsc4py has no call for it; PETSc's own
(3.16 to 3.25) are called through ctypes, with the handles of petsc4py's objects. What is seen with
PETSc 3.25 and MUMPS 5.8:

* ``MatFactorSetSchurIS`` comes after ``setFactorSetUpSolverType`` and before ``setUp``. The
  complement is then stored by columns, whole, for symmetric factors too.
* With ``ICNTL(26) = 0``, a solve is one with the inner block alone; the chosen rows become zero.
* On several ranks PETSc refuses such a solve (error 56). There, and without MUMPS, the chosen rows
  are replaced by those of the identity and blocks of solves find the complement: slower, and equal.
"""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Callable

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]

#: Right-hand sides that are solved together.
BLOCK = 32
#: What MUMPS says of a matrix that is not positive definite.
INDEFINITE = (-10, -40)
#: A matrix is symmetric up to this difference from its transpose, relative to its largest row.
ASYMMETRY = 1e-13


class FactorFailed(Exception):
    """A factor that cannot be made: the matrix without the chosen rows is singular, say.

    Attributes:
        code: What MUMPS says (``INFOG(1)``), or 0.
    """

    def __init__(self, message: str, code: int = 0) -> None:
        super().__init__(message)
        self.code = code


class InnerFactor(ABC):
    """A factor of a matrix ``K`` without the chosen rows; all methods are collective.

    Attributes:
        schur: ``K_CC - K_CI K_II^-1 K_IC`` on all ranks, in the order of the chosen rows.
    """

    schur: Array

    @abstractmethod
    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve ``K_II x_I = b_I`` with ``x_C = 0``."""

    @abstractmethod
    def destroy(self) -> None:
        """Free the memory."""


def inner_factor(K: PETSc.Mat, chosen: Indices, package: str, prefix: str) -> InnerFactor:
    """Factor a matrix without the chosen rows; collective.

    Args:
        K: The matrix.
        chosen: Numbers of the chosen rows, ascending, the same on all ranks.
        package: PETSc's name of the package that factors, ``"mumps"`` say.
        prefix: Of the options that it reads from PETSc's database.

    Raises:
        FactorFailed: On all ranks.
    """
    symmetric = K.isSymmetric(ASYMMETRY * K.norm(PETSc.NormType.INFINITY))
    if K.comm.size == 1 and package == "mumps" and len(chosen) and _petsc() is not None:
        return _WithSchur(K, chosen, symmetric, prefix)
    return _ByBackSolves(K, chosen, package, symmetric, prefix)


class _WithSchur(InnerFactor):
    """MUMPS finds the Schur complement within the factorisation."""

    def __init__(self, K: PETSc.Mat, chosen: Indices, symmetric: bool, prefix: str) -> None:
        library = _petsc()
        assert library is not None
        rows = PETSc.IS().createGeneral(chosen.astype(PETSc.IntType), comm=PETSc.COMM_SELF)

        def prepare(factor: PETSc.Mat) -> None:
            _check(library.MatFactorSetSchurIS(_handle(factor), _handle(rows)))

        self._pc = _factored(K, "mumps", symmetric, prefix, prepare)
        rows.destroy()
        factor = self._pc.getFactorMatrix()
        self.schur = _copied_schur(library, factor, len(chosen))
        factor.setMumpsIcntl(26, 0)
        self._factor, self._chosen = factor, chosen

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        self._factor.solve(b, x)
        x.array[self._chosen] = 0.0

    def destroy(self) -> None:
        self._pc.destroy()


class _ByBackSolves(InnerFactor):
    """The identity stands in the chosen rows and columns; solves find the Schur complement."""

    def __init__(
        self, K: PETSc.Mat, chosen: Indices, package: str, symmetric: bool, prefix: str
    ) -> None:
        self._inner = K.copy()
        first, last = K.getOwnershipRange()
        self._own = chosen[(chosen >= first) & (chosen < last)]
        self._rows = self._own - first
        self._inner.zeroRowsColumns(self._own.astype(PETSc.IntType), diag=1.0)
        self._pc = _factored(self._inner, package, symmetric, prefix)
        parts = [self._block(K, chosen[i : i + BLOCK]) for i in range(0, len(chosen), BLOCK)]
        own = np.hstack(parts) if parts else np.zeros((0, 0))
        self.schur = np.concatenate(K.comm.tompi4py().allgather(own))

    def _block(self, K: PETSc.Mat, chosen: Indices) -> Array:
        """Return columns of the Schur complement, of the rows of this rank."""
        mine = self._own[(self._own >= chosen[0]) & (self._own <= chosen[-1])]
        size, first = K.getLocalSize()[0], K.getOwnershipRange()[0]
        rows = PETSc.IS().createStride(size, first, comm=K.comm)
        columns = PETSc.IS().createGeneral(mine.astype(PETSc.IntType), comm=K.comm)
        sparse = K.createSubMatrix(rows, columns)
        b = sparse.convert("dense")
        right, x = b.duplicate(copy=True), b.duplicate()
        right.getDenseArray()[self._rows] = 0.0
        self._pc.getFactorMatrix().matSolve(right, x)
        x.getDenseArray()[self._rows] = 0.0
        inner = K.matMult(x)
        found = b.getDenseArray()[self._rows] - inner.getDenseArray()[self._rows]
        for o in (rows, columns, sparse, b, right, x, inner):
            o.destroy()
        return np.asarray(found)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        right = b.copy()
        right.array[self._rows] = 0.0
        self._pc.apply(right, x)
        x.array[self._rows] = 0.0
        right.destroy()

    def destroy(self) -> None:
        self._pc.destroy()
        self._inner.destroy()


def add_diagonal(K: PETSc.Mat) -> None:
    """Give each row of a matrix a diagonal entry, zero if it has none: PETSc needs them."""
    rows = np.arange(*K.getOwnershipRange(), dtype=PETSc.IntType)
    entries = (np.arange(len(rows) + 1, dtype=PETSc.IntType), rows, np.zeros(len(rows)))
    zeros = PETSc.Mat().createAIJ(K.getSizes(), csr=entries, comm=K.comm)
    K.axpy(1.0, zeros, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    zeros.destroy()


def _factored(
    K: PETSc.Mat,
    package: str,
    symmetric: bool,
    prefix: str,
    prepare: Callable[[PETSc.Mat], None] = lambda factor: None,
) -> PETSc.PC:
    """Factor as what the matrix is: positive definite, symmetric or general; collective."""
    if package != "mumps" or not symmetric:
        return _factored_as("lu", False, K, package, prefix, prepare)
    try:
        pc = _factored_as("cholesky", True, K, package, prefix, prepare)
    except FactorFailed as error:
        if error.code not in INDEFINITE:
            raise
    else:
        if pc.getFactorMatrix().getMumpsInfog(12) == 0:  # negative pivots
            return pc
        pc.destroy()
    return _factored_as("cholesky", False, K, package, prefix, prepare)


def _factored_as(
    kind: str,
    definite: bool,
    K: PETSc.Mat,
    package: str,
    prefix: str,
    prepare: Callable[[PETSc.Mat], None],
) -> PETSc.PC:
    """Factor, or raise a :class:`FactorFailed`; collective."""
    pc = PETSc.PC().create(K.comm)
    pc.setOptionsPrefix(prefix)
    K.setOption(PETSc.Mat.Option.SYMMETRIC, kind == "cholesky")
    K.setOption(PETSc.Mat.Option.SPD, definite)
    pc.setOperators(K)
    pc.setType(kind)
    pc.setFactorSolverType(package)
    pc.setFactorSetUpSolverType()
    pc.getFactorMatrix().setOptionsPrefix(prefix)  # the set-up would name it too late
    prepare(pc.getFactorMatrix())
    try:
        pc.setUp()
    except PETSc.Error as error:
        pc.destroy()
        raise FactorFailed(str(error)) from error
    code = pc.getFactorMatrix().getMumpsInfog(1) if package == "mumps" else 0
    if code < 0 or pc.getFailedReason() > 0:
        reason = pc.getFailedReason()
        pc.destroy()
        raise FactorFailed(f"reason {reason}, MUMPS' INFOG(1) = {code}", code)
    return pc


def _copied_schur(library: ctypes.CDLL, factor: PETSc.Mat, size: int) -> Array:
    """Return a copy of the Schur complement that MUMPS has found."""
    schur, values = ctypes.c_void_p(), ctypes.POINTER(ctypes.c_double)()
    _check(library.MatFactorCreateSchurComplement(_handle(factor), ctypes.byref(schur), None))
    _check(library.MatDenseGetArrayRead(schur, ctypes.byref(values)))
    found = np.ctypeslib.as_array(values, (size, size)).T.copy()  # stored by columns
    _check(library.MatDenseRestoreArrayRead(schur, ctypes.byref(values)))
    _check(library.MatDestroy(ctypes.byref(schur)))
    return found


def _petsc() -> ctypes.CDLL | None:
    """Return PETSc's library, ``None`` if it lacks what is called here or has other numbers.

    Its functions are found by way of petsc4py's module, which is linked with it: only some programs
    happen to have them among the symbols that all modules share.
    """
    library = ctypes.CDLL(PETSc.__file__)
    numbers = PETSc.ScalarType == np.float64 and PETSc.IntType == np.int32
    return library if numbers and hasattr(library, "MatFactorCreateSchurComplement") else None


def _handle(o: PETSc.Object) -> ctypes.c_void_p:
    """Return the handle of a PETSc object."""
    return ctypes.c_void_p(o.handle)


def _check(code: int) -> None:
    """Raise unless a call of PETSc succeeded."""
    if code:
        raise FactorFailed(f"PETSc's error {code}")
