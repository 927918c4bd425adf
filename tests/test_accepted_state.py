"""What a contact tells after a step, and what a failed constructor leaves behind."""

import numpy as np
import pytest

import fenicsx_friction as ff
from bodies import stack
from fenicsx_friction.obstacles import node_to_face
from fenicsx_friction.surfaces.face_cells import FACE_CELLS, project
from models import block, with_contact


@pytest.mark.mpi
def test_nodal_values_after_a_step_are_those_accepted():
    """Evaluated anew they would have no slip, and slipping nodes be on the edge of sticking."""
    model = block("hexahedron", 0.3, "accepted_")
    for move in ((0.0, 0.0, -0.01), (0.02, 0.01, -0.01)):
        model.move(*move)
        report = model.problem.solve()
    nodal = model.contact.nodal()
    assert nodal is model.problem.accepted[0]
    counts = model.problem.comm.allreduce(np.bincount(nodal.states(), minlength=3))
    totals = report.contacts[0]
    assert counts.tolist() == [totals.open, totals.stick, totals.slip]
    assert totals.slip > 0
    assert not np.any(model.contact.present().slip)


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["rigid", "deformable"])
def test_contacts_of_a_failed_constructor_are_free(kind):
    make = {"rigid": lambda p: block("hexahedron", 0.3, p), "deformable": lambda p: stack(0.3, p)}
    model = make[kind](f"first_{kind}_")
    surface, obstacle = model.contact.surface, model.contact.obstacle
    contact = ff.Contact(surface, obstacle, ff.Coulomb(0.3))
    with pytest.raises(ff.ContactInputError, match="no positive stiffness"):
        with_contact(model, contact, f"wrong_{kind}_", sign=-1.0)
    problem = with_contact(model, contact, f"right_{kind}_")
    model.move(0.0, 0.0, -0.01)
    assert problem.solve().certified


def test_a_projection_that_is_not_found_is_never_certified(monkeypatch):
    model = stack(0.3, "lost_")
    model.move(0.0, 0.0, -0.01)
    assert model.problem.solve().certified
    assert model.problem.certify().certified
    monkeypatch.setattr(node_to_face, "project", lambda cell, face, x, start: np.nan * start)
    pairing = model.contact.pairing
    pairing.restore(pairing.save())  # what was evaluated before is forgotten
    assert not model.problem.certify().certified


def test_projections_are_found_or_told():
    """Far points of warped faces may have none; what is returned is a projection."""
    rng, cell = np.random.default_rng(2), FACE_CELLS["quadrilateral"]
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    face = flat + rng.normal(0.0, 0.4, (4000, 4, 3))
    x = rng.normal(0.0, 3.0, (4000, 3))
    xi = project(cell, face, x)
    found = np.all(np.isfinite(xi), axis=1)
    assert 0 < np.sum(~found) < 2000
    a, b = xi[found].T
    weights = np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], axis=1)
    away = x[found] - np.einsum("ni,nid->nd", weights, face[found])
    for slopes in ([b - 1, 1 - b, -b, b], [a - 1, -a, 1 - a, a]):
        tangent = np.einsum("in,nid->nd", np.array(slopes), face[found])
        size = np.linalg.norm(tangent, axis=1) * (1.0 + np.linalg.norm(away, axis=1))
        assert np.max(abs(np.sum(tangent * away, axis=1)) / size) < 1e-6


@pytest.mark.mpi
def test_settings_are_live_or_refused():
    model = block("hexahedron", 0.3, "live_")
    model.problem.settings = ff.StepSettings(corrector="ramp", ramp_sign=1, ramp_nodes="all")
    model.move(0.02, 0.0, -0.01)
    report = model.problem.solve()
    assert "slip" in {s.name for s in report.substeps}
    assert float(model.problem._ramp_sign.value) == 1.0
    with pytest.raises(ff.ContactInputError, match="normal"):
        model.problem.settings = ff.StepSettings(normal="min")
    with pytest.raises(ff.ContactInputError, match="settings"):
        model.problem.settings = {"corrector": "ramp"}


@pytest.mark.mpi
def test_problems_of_one_prefix_keep_their_options_apart():
    models = [block("hexahedron", 0.3, "same_") for _ in range(2)]
    problems = []
    for model, option in zip(models, (77, 33), strict=True):
        contact = ff.Contact(model.contact.surface, model.contact.obstacle, ff.Coulomb(0.3))
        options = {"mat_mumps_icntl_14": option}
        settings = ff.StepSettings(solver="full")
        parts = {"petsc_options": options, "settings": settings}
        problems.append(with_contact(model, contact, "same_", **parts))
    for model, problem in zip(models, problems, strict=True):
        model.move(0.0, 0.0, -0.01)
        assert problem.solve().certified
    found = []
    for problem in problems:
        pc = problem.projection.solver.getKSP().getPC()
        found.append(pc.getFactorMatrix().getMumpsIcntl(14))
    assert found == [77, 33]
    contact = ff.Contact(model.contact.surface, model.contact.obstacle, ff.Coulomb(0.3))
    wrong = with_contact(
        model, contact, "wrong_", petsc_options={"snes_linesearch_type": "nonsense"}
    )
    with pytest.raises(ff.ContactInputError, match=r"PETSc refuses the petsc_options"):
        wrong.solve()


def test_an_audit_balances_each_step_once():
    """Neither before the first step nor twice, nor after one that was refused."""
    model = block("hexahedron", 0.3, "audited_")
    audit = ff.EnergyAudit(model.problem, model.stored)
    with pytest.raises(ff.ContactInputError, match="no step was accepted since step 0"):
        audit.update()
    model.move(0.0, 0.0, -0.01)
    assert model.problem.solve().certified
    assert audit.update().stored > 0.0
    model.problem.settings = ff.StepSettings(raise_on_uncertified=False, tolerance=1e-300)
    model.move(0.01, 0.0, -0.01)
    assert not model.problem.solve().certified
    with pytest.raises(ff.ContactInputError, match="no step was accepted since step 1"):
        audit.update()
