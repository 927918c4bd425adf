"""Break the method on purpose: each break must be refused or seen, never accepted."""

from mpi4py import MPI

import numpy as np
import pytest

import fenicsx_friction as ff
from fenicsx_friction import laws
from fenicsx_friction.contact.slip_corrector import freeze_stick, has_false_root
from fenicsx_friction.equations import contact_terms
from fenicsx_friction.laws import rows
from fenicsx_friction.verification.exact import ExactReference
from models import block, gathered, raous

projection_row, stick_row = laws.projection_row, laws.stick_row


def flipped_sign(s, c_t, limit, r, eps):
    return projection_row(-s, c_t, limit, r, eps)


def without_friction(s, c_t, limit, r, eps):
    return projection_row(s, c_t, 0.0 * limit, r, eps)


def too_much_friction(s, c_t, limit, r, eps):
    return projection_row(s, c_t, 1.01 * limit, r, eps)


def always_stick(s, c_t, limit, r, eps):
    return r * s


@pytest.mark.parametrize(
    "broken",
    [
        pytest.param(flipped_sign, marks=pytest.mark.mpi),
        without_friction,
        too_much_friction,
        always_stick,
    ],
)
def test_wrong_friction_rows_are_refused(broken, monkeypatch):
    monkeypatch.setattr(rows, "projection_row", broken)
    model = raous(8, 8, 1.0, "broken_")
    with pytest.raises(ff.StepFailed, match="no certified solution") as failure:
        model.problem.solve()
    report = failure.value.report
    assert not report.certified
    assert report.certificate.relative > 1e-3
    # The last accepted state is there, bit for bit: here the initial one.
    assert not np.any(model.problem.u.x.array)
    assert not np.any(model.contact.c.x.array)
    assert model.problem.num_steps == 0


@pytest.mark.mpi
def test_adhesive_contact_is_refused(monkeypatch):
    """A normal row that lets nodes pull: zero gap everywhere."""
    monkeypatch.setitem(laws.NORMAL_ROWS, "chen-mangasarian", lambda g, c_n, r, eps: -r * g)
    with pytest.raises(ff.StepFailed):
        raous(8, 8, 1.0, "adhesive_").problem.solve()


def test_forgotten_history_is_seen_by_the_exact_reference(monkeypatch):
    monkeypatch.setattr(ff.FrictionalContactProblem, "commit", lambda self: None)
    model = block("hexahedron", 0.3, "forgetful_")
    exact = ExactReference(model.problem)
    errors = []
    for displacement in [(0, 0, -0.01), (0.012, 0, -0.01), (0.004, 0, -0.01)]:
        model.move(*displacement)
        expected = exact.advance()
        model.problem.solve()
        scale = np.max(np.abs(expected.c))
        errors.append(np.max(np.abs(model.contact.nodal().c - expected.c)) / scale)
    assert errors[0] < 1e-9  # the first step has no history
    assert max(errors[1:]) > 1e-2


@pytest.mark.parametrize("row", [0, 1])
def test_missing_coupling_block_of_the_jacobian_is_not_accepted(row, monkeypatch):
    """Without ``dR/dc`` of equilibrium, or ``dR/du`` of contact, Newton gets nowhere."""
    original = contact_terms.derivatives_of

    def crippled(k, kernel):
        blocks = original(k, kernel)
        block = (blocks.levers, blocks.laws[:, :, :2])[row]
        block[:] = 0.0
        return blocks

    monkeypatch.setattr(contact_terms, "derivatives_of", crippled)
    with pytest.raises(ff.StepFailed):
        raous(8, 8, 1.0, "crippled_").problem.solve()


@pytest.mark.mpi
def test_a_false_root_of_the_ramp_is_not_accepted():
    """Straight from stick to the slip rows at xi = 0: Newton may converge outside the cone."""
    model = raous(16, 16, 1.0, "false_", corrector="ramp", ramp_nodes="all")
    problem = model.problem
    problem.run(problem.stick, 1e-6, eps=0.0, max_it=20)
    freeze_stick(model.contact, violated_only=False)
    report = problem.run(problem.slip, 1e-11, xi=0.0)
    if report.converged:
        (state,) = problem.nodal_states()
        outside = np.linalg.norm(state.c[:, 1:], axis=1) - state.limit
        worst = problem.comm.allreduce(float(np.max(outside, initial=0.0)), MPI.MAX)
        assert worst > 1e6  # Pa: converged, equilibrated, and wrong
        assert has_false_root(model.contact)
        assert not problem.certify().certified
    else:
        assert not problem.certify().certified
    # The step as a whole finds the solution all the same.
    fresh = raous(16, 16, 1.0, "fresh_", corrector="ramp", ramp_nodes="all")
    assert fresh.problem.solve().certified


@pytest.mark.mpi
def test_failure_keeps_the_last_accepted_step_and_names_nodes():
    model = raous(8, 8, 1.0, "keep_")
    model.problem.solve()
    before = model.problem.u.x.array.copy(), model.contact.c.x.array.copy()
    model.load(3.0, -1.0)  # pulled off the base: nothing holds the body any more
    with pytest.raises(ff.StepFailed) as failure:
        model.problem.solve()
    for kept, now in zip(before, (model.problem.u, model.contact.c), strict=True):
        assert np.array_equal(kept, now.x.array)
    message = str(failure.value)
    assert "node" in message
    assert "last accepted state was restored" in message
    assert "Try a smaller load step" in message
    model.load(1.0, 0.9)
    assert model.problem.solve().step == 2


def test_uncertified_report_instead_of_an_exception(monkeypatch):
    monkeypatch.setattr(rows, "projection_row", flipped_sign)
    model = raous(8, 8, 1.0, "report_", raise_on_uncertified=False)
    report = model.problem.solve()
    assert not report.certified
    assert not np.any(model.problem.u.x.array)


@pytest.mark.parametrize("name", ["stick", "slip", "projection"])
def test_jacobian_equals_finite_differences(name):
    """Of all rows at once, at a 3D state with open, sticking and slipping nodes."""
    model = block("hexahedron", 0.3, "fd_", energy="finite", corrector="ramp")
    for displacement in ((0, 0, -0.02), (0.004, 0.002, -0.015)):
        model.move(*displacement)
        model.problem.solve()
    problem, rng = model.problem, np.random.default_rng(3)
    (state,) = problem.accepted
    model.contact.slipping.x.array[:] = rng.integers(0, 2, len(state.gap))
    model.contact.c_stick.x.array[:] = rng.normal(size=3 * len(state.gap))
    model.contact.slip_scale.x.array[:] = 1e-3
    problem._xi.value, problem._eps.value = 0.3, 0.5
    # Leave the kinks: open some nodes, let others slip, others stick.
    held = problem.constrained_dofs
    shake = 5e-3 * rng.normal(size=len(problem.u.x.array))
    shake[held] = 0.0
    problem.u.x.array[:] += shake
    model.contact.c.x.array[:] += rng.normal(size=3 * len(state.gap))
    model.contact.c.x.array[::9] = -50.0
    kinds = set(problem.nodal_states()[0].states().tolist())
    assert kinds == {0, 1, 2}
    substep = getattr(problem, name)
    matrix, snes = substep.jacobian(), substep.solver
    x = problem.solvers.full.problem.x.copy()
    direction = x.duplicate()
    direction.array[:] = rng.normal(size=direction.getLocalSize())
    direction.array[held] = 0.0
    exact = matrix * direction
    h = 1e-7 * np.linalg.norm(problem.u.x.array)
    ends = []
    for sign in (1, -1):
        moved, residual = x.copy(), x.duplicate()
        moved.setAttr("_blocks", problem.solvers.full.problem.x.getAttr("_blocks"))
        moved.axpy(sign * h, direction)
        residual.setAttr("_blocks", problem.solvers.full.problem.b.getAttr("_blocks"))
        snes.computeFunction(moved, residual)
        ends.append(residual.array.copy())
    difference = (ends[0] - ends[1]) / (2 * h)
    assert difference == pytest.approx(exact.array, abs=1e-6 * np.max(np.abs(exact.array)))
    assert gathered(problem)[0].shape == (len(state.gap), 3)


@pytest.mark.mpi
def test_a_state_that_misses_its_boundary_values_is_refused():
    """The old state is in equilibrium and fulfils the law, but the top has not moved."""
    model = block("hexahedron", 0.3, "missed_")
    model.move(0, 0, -0.01)
    model.problem.solve()
    assert model.problem.certify().certified
    model.move(0, 0, -0.02)
    assert not model.problem.certify().certified
