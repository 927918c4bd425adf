# SPDX-License-Identifier: MIT
"""The direct solver: whether it is installed, and why a factorisation failed.

How failures surface in PETSc 3.25 (seen with MUMPS 5.8, on 1 and 2 ranks):

* A factorisation that fails raises nothing. ``SNES.solve`` ends with reason -3 (linear solve), its
  KSP with -11 (preconditioner set-up), and the solution of a bare ``KSP.solve`` is infinite.
  ``PC.getFailedReason`` is coarse: MUMPS' -10 is 2, -9 is 3, -19 is 4. ``INFOG`` tells more, the
  same on all ranks, until the next factorisation. (Before the first one PETSc crashes when asked.)
* A NaN in the matrix is a zero pivot for MUMPS (-10): only the matrix itself tells the difference.
* The factor is then unusable. The next solve, with a good matrix, raises ``PETSc.Error`` 76 (MUMPS
  says -3, calls out of order), or returns the old failure: :func:`forget_factor` first. A SNES
  works again after that. (A bare KSP needs ``setOperators`` again, else error 73.)
* A new factor reads its ``mat_mumps_...`` options from PETSc's database, under the prefix of the
  SNES. They must be there when the factor is made: at the first solve, not before.
* A missing package raises ``PETSc.Error`` 92 at the first solve: :func:`require_solver` before it.
"""

from collections.abc import Mapping

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from ..base.errors import ContactInputError

#: Solvers of PETSc's external packages, as ``pc_factor_mat_solver_type`` calls them.
SOLVERS = (
    *("mumps", "superlu_dist", "superlu", "umfpack", "klu", "cholmod", "mkl_pardiso"),
    *("mkl_cpardiso", "pastix", "strumpack"),
)

#: For MUMPS, in per cent above what it estimates.
MORE_WORKSPACE: dict[str, object] = {"mat_mumps_icntl_14": 200}
ASK_FOR_WORKSPACE = (
    "its workspace was estimated too small: pass petsc_options={'mat_mumps_icntl_14': 100} (per "
    "cent above the estimate), or more"
)
ASK_FOR_MEMORY = (
    "use a machine with more memory or more ranks on several machines, a coarser mesh, or factors "
    "on disk with petsc_options={'mat_mumps_icntl_22': 1}"
)
#: MUMPS' codes (INFOG(1), MUMPS users' guide, "Error and warning diagnostics"), by meaning.
WORKSPACE = (-8, -9, -11, -12, -14, -15, -17, -20)
ALLOCATION = (-5, -7, -13, -22)
LIMITED = -19
STRUCTURE, ZERO_PIVOT = -6, -10
INTEGERS = (-51, -52)
ORDER = -3
OUT_OF_CORE = -90


#: Packages that take MUMPS' place on one rank where PETSc is built without it. SuperLU_DIST would
#: on several, but does not pivot: it found zero pivots, and aborts where it is built without MC64.
IN_PLACE_OF_MUMPS = ("umfpack", "klu", "superlu")


def direct_package(num_ranks: int) -> str:
    """Return the package that factors: MUMPS, or another one if PETSc is built without it."""
    usable = ("mumps", *(IN_PLACE_OF_MUMPS if num_ranks == 1 else ()))
    return next((name for name in usable if has_package(name)), "mumps")


def has_package(name: str) -> bool:
    """Tell whether PETSc is built with a package."""
    return bool(PETSc.Sys.hasExternalPackage(name))


def require_solver(options: Mapping[str, object], comm: MPI.Intracomm) -> None:
    """Check that PETSc can factorise on these ranks with the package asked for; collective.

    Args:
        options: PETSc options of the solver; only those with ``pc_type`` ``lu`` or ``cholesky``
            are looked at.
        comm: The ranks that solve.

    Raises:
        ContactInputError: If it cannot; names the option and the packages that PETSc has.
    """
    if options.get("pc_type") not in ("lu", "cholesky"):
        return
    solver = options.get("pc_factor_mat_solver_type")
    matrix = PETSc.Mat().createAIJ((comm.size, comm.size), nnz=1, comm=comm)
    matrix.setValue(comm.rank, comm.rank, 1.0)
    matrix.assemble()
    pc = PETSc.PC().create(comm)
    pc.setOperators(matrix)
    pc.setType(str(options["pc_type"]))
    try:
        if solver is not None:
            pc.setFactorSolverType(str(solver))
        pc.setFactorSetUpSolverType()
    except PETSc.Error as error:
        present = [name for name in SOLVERS if has_package(name)]
        raise ContactInputError(
            f"petsc_options: PETSc cannot factorise with pc_type={options['pc_type']!r}, "
            f"pc_factor_mat_solver_type={solver!r} on {comm.size} rank(s): not installed, or not "
            f"made for that. This PETSc has {', '.join(present) or 'no external solver'}. MUMPS "
            f"is in PETSc of conda-forge, Debian and Ubuntu."
        ) from error
    finally:
        pc.destroy()
        matrix.destroy()


def factor_failure(snes: PETSc.SNES) -> str:
    """Say in plain words why the last factorisation failed; collective.

    Args:
        snes: A solver whose linear solve failed.

    Returns:
        The reason and what to do; empty if the factorisation did not fail.
    """
    pc = snes.getKSP().getPC()
    if pc.getType() not in ("lu", "cholesky"):
        return ""
    code, more = _mumps_code(snes.getKSP())
    if code >= 0 and pc.getFailedReason() <= 0:
        return ""
    if not np.isfinite(pc.getOperators()[1].norm(PETSc.NormType.FROBENIUS)):
        return "the matrix contains NaN or infinite numbers: look at loads, materials and fields"
    solver = pc.getFactorSolverType()
    if code < 0:
        return f"{_meaning(code, more)} (MUMPS' INFOG(1) = {code}, INFOG(2) = {more})"
    return f"{solver} could not factorise the matrix (PETSc's reason {pc.getFailedReason()})"


def krylov_failure(snes: PETSc.SNES) -> str:
    """Say in plain words how the last iterative linear solve failed; empty if it did not."""
    ksp = snes.getKSP()
    pc, reason = ksp.getPC(), ksp.getConvergedReason()
    if ksp.getType() == "preonly" or reason >= 0:
        return ""
    if not np.isfinite(pc.getOperators()[1].norm(PETSc.NormType.FROBENIUS)):
        return "the matrix contains NaN or infinite numbers: look at loads, materials and fields"
    kind = "multigrid" if pc.getType() == "python" else pc.getType()
    names = PETSc.KSP.ConvergedReason.__dict__.items()
    name = next((n for n, number in names if number == reason and "_" in n), str(reason))
    return (
        f"the linear solver {ksp.getType()} with {kind} ended after {ksp.getIterationNumber()} "
        f"iterations, {name}; is the body held? Take linear_solver='direct', or other petsc_options"
    )


def out_of_memory(snes: PETSc.SNES) -> bool:
    """Tell whether the last factorisation ran out of memory; smaller steps do not help then."""
    code, _ = _mumps_code(snes.getKSP())
    return code in (*WORKSPACE, *ALLOCATION, LIMITED, OUT_OF_CORE)


def workspace_too_small(snes: PETSc.SNES) -> bool:
    """Tell whether MUMPS has estimated the workspace of the last factorisation too small."""
    return _mumps_code(snes.getKSP())[0] in WORKSPACE


def forget_factor(snes: PETSc.SNES) -> None:
    """Discard the factor, so that the next solve makes a new one; collective."""
    snes.getKSP().getPC().reset()


def _mumps_code(ksp: PETSc.KSP) -> tuple[int, int]:
    """Return ``INFOG(1)`` and ``INFOG(2)``; zeros before a factorisation or with other solvers."""
    pc = ksp.getPC()
    if pc.getType() not in ("lu", "cholesky") or pc.getFactorSolverType() != "mumps":
        return 0, 0
    factor = pc.getFactorMatrix()
    if not factor or ksp.getConvergedReason() == 0:  # reset, or never solved
        return 0, 0
    return int(factor.getMumpsInfog(1)), int(factor.getMumpsInfog(2))


def _meaning(code: int, more: int) -> str:
    """Translate a negative ``INFOG(1)``."""
    if code in WORKSPACE:
        return f"MUMPS ran out of memory: {ASK_FOR_WORKSPACE}"
    if code in ALLOCATION:
        size = f"{-more} million" if more < 0 else str(more)
        return f"out of memory: MUMPS could not get {size} entries; {ASK_FOR_MEMORY}"
    if code == LIMITED:
        return (
            "MUMPS may not use more memory: its limit, option mat_mumps_icntl_23 (MB a rank), is "
            f"too small; raise it or leave it out, or {ASK_FOR_MEMORY}"
        )
    if code == OUT_OF_CORE:
        return (
            "MUMPS could not write its factors on disk: is there room in the folder named by the "
            "environment variable MUMPS_OOC_TMPDIR?"
        )
    if code == STRUCTURE:
        return f"the matrix is singular: entries allow a rank of {more} only (empty rows, say)"
    if code == ZERO_PIVOT:
        return f"the matrix is singular: no pivot after {more} of its rows"
    if code in INTEGERS:
        return "the matrix is too large for the 32-bit integers of MUMPS' ordering: use more ranks"
    if code == ORDER:
        return "the factor was spoilt by an earlier failure and not made again"
    return "MUMPS failed, see its users' guide"
