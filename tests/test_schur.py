"""The factor of an inner block and the Schur complement of the rest."""

from petsc4py import PETSc

import numpy as np
import pytest

import fenicsx_friction as ff
from fenicsx_friction.solvers import schur
from models import block, with_contact


def test_options_of_mumps_reach_the_bulk():
    model = block("hexahedron", 0.3, "room_")
    contact = ff.Contact(model.contact.surface, model.contact.obstacle, ff.Coulomb(0.3))
    problem = with_contact(model, contact, "room_", petsc_options={"mat_mumps_icntl_14": 77})
    model.move(0.0, 0.0, -0.01)
    assert problem.solve().solver == "condensed"
    factor = problem.solvers._boundary.equations.bulk._factor._factor
    assert factor.getMumpsIcntl(14) == 77


@pytest.mark.quick
@pytest.mark.parametrize("kind", ["positive", "indefinite", "general"])
def test_schur_complements_of_all_kinds_of_matrices(kind, monkeypatch):
    """Against NumPy, by MUMPS and by solves; the kind of factor is found out."""
    rng, n = np.random.default_rng(4), 30
    A = rng.normal(size=(n, n))
    A = {"positive": A @ A.T + np.eye(n), "indefinite": A + A.T, "general": A}[kind]
    K = PETSc.Mat().createAIJ((n, n), nnz=n, comm=PETSc.COMM_SELF)
    K.setValues(range(n), range(n), A)
    K.assemble()
    C = np.array([2, 3, 11, 29])
    inner = np.setdiff1d(np.arange(n), C)
    right = A[np.ix_(C, C)] - A[np.ix_(C, inner)] @ np.linalg.solve(
        A[np.ix_(inner, inner)], A[np.ix_(inner, C)]
    )
    b, x = K.createVecs()
    b.array[:] = rng.normal(size=n)
    for lacking in (False, True):
        if lacking:
            monkeypatch.setattr(schur, "_petsc", lambda: None)
        factor = schur.inner_factor(K, C, "mumps", f"{kind}{lacking}_")
        assert factor._pc.getType() == ("lu" if kind == "general" else "cholesky")
        assert factor.schur == pytest.approx(right, rel=1e-9, abs=1e-9)
        factor.solve(b, x)
        assert x.array[inner] == pytest.approx(
            np.linalg.solve(A[np.ix_(inner, inner)], b.array[inner]), rel=1e-8, abs=1e-8
        )
        assert not np.any(x.array[C])
