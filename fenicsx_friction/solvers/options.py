# SPDX-License-Identifier: MIT
"""PETSc options of one solver, hidden from later solvers."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from petsc4py import PETSc

from ..base.errors import ContactInputError

DEFAULT_OPTIONS: dict[str, object] = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "basic",
    "snes_max_it": 30,
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}
#: Of the solver of the whole system with multigrid. A restart would cost nearly incompressible
#: bodies many iterations; vectors are made when they are needed.
KRYLOV_OPTIONS: dict[str, object] = {
    "pc_type": "python",
    "ksp_type": "gmres",
    "ksp_gmres_restart": 150,
    "ksp_max_it": 150,
}


@dataclass(frozen=True)
class SolverOptions:
    """What a user asks of the solvers of a problem.

    Attributes:
        prefix: Prefix of the PETSc options.
        given: PETSc options.
        linear_solver: ``auto``, ``direct`` or ``multigrid``.
    """

    prefix: str
    given: Mapping[str, object]
    linear_solver: str


def options_of(linear_solver: str, options: Mapping[str, object]) -> dict[str, object]:
    """Return the options of the solvers of the whole system, those of the user over the default."""
    if linear_solver == "direct":
        return {**DEFAULT_OPTIONS, **options}
    newton = {k: v for k, v in DEFAULT_OPTIONS.items() if k.startswith("snes_")}
    gmres = {} if "ksp_type" in options else {"ksp_pc_side": "right"}  # others know no right side
    return {**newton, **KRYLOV_OPTIONS, **gmres, **options}


@contextmanager
def inside(prefix: str, options: Mapping[str, object]) -> Iterator[None]:
    """Put options of a prefix into PETSc's database inside the context only.

    A later solver with the same prefix must not find them. MUMPS reads its options only at the
    first factorisation.
    """
    database = PETSc.Options(prefix)
    before = {k: database.getString(k) for k in options if database.hasName(k)}
    try:
        for name, value in options.items():
            database.setValue(name, value)
        yield
    finally:
        for name in options:
            database.delValue(name)
        for name, text in before.items():
            database.setValue(name, text)


def set_up(solver: PETSc.SNES | PETSc.KSP | PETSc.PC, options: Mapping[str, object]) -> None:
    """Set up a solver, or say which options PETSc refuses."""
    try:
        with inside(solver.getOptionsPrefix(), options):
            solver.setFromOptions()
    except PETSc.Error as error:
        raise refused(options, error) from error


def refused(options: Mapping[str, object], error: PETSc.Error) -> ContactInputError:
    """Return the error that says which options PETSc refuses."""
    return ContactInputError(
        f"PETSc refuses the petsc_options {dict(options)}: {str(error).splitlines()[-1]}"
    )


def effective(prefix: str, options: Mapping[str, object]) -> dict[str, str]:
    """Return all options that a solver of a prefix sees inside its context."""
    found: dict[str, str] = PETSc.Options(prefix).getAll()
    return found | {name: str(value) for name, value in options.items()}


def reason_name(value: int) -> str:
    """Return PETSc's name of a converged reason."""
    names = PETSc.SNES.ConvergedReason.__dict__.items()
    return next((name for name, number in names if number == value and "_" in name), str(value))
