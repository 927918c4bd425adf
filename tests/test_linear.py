"""Failures of the direct solver, made on purpose, are named; after them the solver works again."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

import fenicsx_friction as ff
from fenicsx_friction.solvers import linear
from fenicsx_friction.solvers.linear import (
    factor_failure,
    forget_factor,
    out_of_memory,
    require_solver,
)
from models import block

pytestmark = pytest.mark.mpi

LU = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}


class Membrane:
    """Five-point stencil of n x n nodes, solved as a nonlinear problem."""

    def __init__(self, n, comm, **options):
        self.n, self.prefix = n, f"linear_{id(self) if comm.size == 1 else n}_"
        self.options = PETSc.Options(self.prefix)
        for key, value in {**LU, **options}.items():
            self.options[key] = value
        self.A = PETSc.Mat().createAIJ((n * n, n * n), nnz=5, comm=comm)
        self.A.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        self.fill()
        self.x, f = self.A.createVecs()
        self.snes = PETSc.SNES().create(comm)
        self.snes.setOptionsPrefix(self.prefix)
        self.good = self.A.copy()
        self.snes.setFunction(lambda snes, x, f: (self.good.mult(x, f), f.shift(-1.0)), f)
        self.snes.setJacobian(lambda snes, x, J, P: J.assemble(), self.A)
        self.snes.setFromOptions()

    def fill(self, row_3=1.0):
        """Assemble; multiply row 3."""
        n = self.n
        for row in range(*self.A.getOwnershipRange()):
            i, j = divmod(row, n)
            around = [(a, b) for a, b in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1))]
            columns = [row, *(a * n + b for a, b in around if 0 <= a < n and 0 <= b < n)]
            values = np.array([4.0] + [-1.0] * (len(columns) - 1))
            self.A.setValues([row], columns, values * (row_3 if row == 3 else 1.0))
        self.A.assemble()

    def solve(self):
        """Return whether it converged, to the solution."""
        self.x.set(0.0)
        self.snes.solve(None, self.x)
        residual = self.A.createVecLeft()
        self.good.mult(self.x, residual)
        residual.shift(-1.0)
        return self.snes.getConvergedReason() > 0 and residual.norm() < 1e-8


@pytest.mark.quick
def test_singular_matrix(comm):
    membrane = Membrane(5, comm)
    membrane.fill(0.0)
    assert not membrane.solve()
    assert membrane.snes.getConvergedReason() == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE
    assert "singular: no pivot after 24" in factor_failure(membrane.snes)
    assert not out_of_memory(membrane.snes)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_nan_is_not_called_singular(value, comm):
    membrane = Membrane(6, comm)
    membrane.fill(value)
    assert not membrane.solve()
    assert factor_failure(membrane.snes).startswith("the matrix contains NaN")


def test_solver_works_again(comm):
    membrane = Membrane(7, comm)
    assert factor_failure(membrane.snes) == ""  # there is no factor yet
    assert membrane.solve()
    assert factor_failure(membrane.snes) == ""
    membrane.fill(0.0)
    assert not membrane.solve()
    membrane.fill()
    forget_factor(membrane.snes)
    assert membrane.solve()
    assert factor_failure(membrane.snes) == ""


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("mat_mumps_icntl_23", 1, "mat_mumps_icntl_23 (MB a rank), is too small"),
        ("mat_mumps_icntl_14", -70, "'mat_mumps_icntl_14': 100"),
    ],
)
def test_memory(option, value, words, comm):
    membrane = Membrane(150, comm, **{option: value})
    assert not membrane.solve()
    assert out_of_memory(membrane.snes)
    assert words in factor_failure(membrane.snes)
    del membrane.options[option]  # there is memory now
    forget_factor(membrane.snes)
    assert membrane.solve()
    assert not out_of_memory(membrane.snes)


def test_missing_package_is_named(comm):
    with pytest.raises(ff.ContactInputError, match=r"type='nosuch'.* has .*mumps"):
        require_solver({**LU, "pc_factor_mat_solver_type": "nosuch"}, comm)
    require_solver(LU, comm)
    require_solver({"pc_type": "lu"}, comm)
    require_solver({"pc_type": "hypre", "pc_factor_mat_solver_type": "nosuch"}, comm)


@pytest.mark.parametrize("solver", ["full", "condensed"])
def test_another_package_takes_the_place_of_an_absent_mumps(solver, monkeypatch, caplog):
    """On one rank; every rank has its own problem here."""
    alone = {"comm": MPI.COMM_SELF, "solver": solver}
    wanted = block("hexahedron", 0.3, f"with_mumps_{solver}_", **alone)
    monkeypatch.setattr(linear, "has_package", lambda name: name in ("superlu_dist", "umfpack"))
    body = block("hexahedron", 0.3, f"without_mumps_{solver}_", **alone)
    assert "no MUMPS here; umfpack" in caplog.text
    for model in (wanted, body):
        model.move(0.004, 0.0, -0.01)
        assert model.problem.solve().certified
    assert body.problem.solvers.full.options["pc_factor_mat_solver_type"] == "umfpack"
    a, b = (m.problem.u.x.array for m in (wanted, body))
    assert a == pytest.approx(b, abs=1e-9 * np.max(abs(a)))


def test_without_mumps_on_several_ranks_the_error_says_so(monkeypatch):
    monkeypatch.setattr(linear, "has_package", lambda name: name == "umfpack")
    assert linear.direct_package(1) == "umfpack"
    assert linear.direct_package(4) == "mumps"  # which require_solver refuses by name


def test_solver_of_one_rank_is_refused_on_several(comm):
    options = {**LU, "pc_factor_mat_solver_type": "petsc"}
    if comm.size == 1:
        require_solver(options, comm)
    else:
        with pytest.raises(ff.ContactInputError, match=f"on {comm.size} rank"):
            require_solver(options, comm)
    require_solver(options, MPI.COMM_SELF)
