"""The Jacobian of each friction law against differences."""

import numpy as np
import pytest

import fenicsx_friction as ff
from dragged import DEPTH, LAWS, dragged
from fenicsx_friction.equations import contact_terms
from fenicsx_friction.verification.jacobian import check_jacobian


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("name", LAWS)
def test_jacobian_of_each_law(name):
    model = dragged(LAWS[name][0], "jac_", corrector="ramp")
    model.move(0.004, -DEPTH)
    before = [f.x.array.copy() for f in model.problem.state]
    report = check_jacobian(model.problem)
    assert report.error < 1e-6, str(report)
    (counts,) = report.states
    assert counts[0] > 0
    assert counts[2] > 0
    assert (counts[1] > 0) == (name != "frictionless")
    # All rows of the mixed state were compared; there are no kinks near it but the law's own.
    mixed = [check for check in report.checks if check.state == "mixed"]
    assert sum(check.kinks for check in mixed) == 0, str(report)
    assert {check.substep for check in mixed} == {"stick", "slip", "projection"}
    after = [f.x.array for f in model.problem.state]
    assert all(np.array_equal(*pair) for pair in zip(before, after, strict=True))


@pytest.mark.parametrize(
    "law", [ff.PermanentStick(), ff.Coulomb(0.3), ff.OrthotropicCoulomb((0.2, 0.5), (1, 0.7, 0))]
)
@pytest.mark.parametrize(
    "normal",
    [
        pytest.param("chen-mangasarian", marks=pytest.mark.mpi),
        "fischer-burmeister",
        "min",
    ],
)
def test_jacobian_in_3d_with_each_normal_function(law, normal):
    model = dragged(lambda m, s: law, "jac3_", dim=3, normal=normal)
    assert check_jacobian(model.problem).error < 1e-6  # untouched
    model.move(0.003, 0.002, -DEPTH)
    for seed in range(2):
        report = check_jacobian(model.problem, seed=seed)
        assert report.error < 1e-6, str(report)
        assert report.states[0][0] > 0


@pytest.mark.parametrize(("row", "where"), [(0, "momentum"), (1, "contact 'contact'")])
def test_a_wrong_jacobian_is_found_and_named(row, where, monkeypatch):
    original = contact_terms.derivatives_of

    def crippled(k, kernel):
        blocks = original(k, kernel)
        block = (blocks.levers, blocks.laws[:, :, :2])[row]
        block *= 1.001
        return blocks

    monkeypatch.setattr(contact_terms, "derivatives_of", crippled)
    report = check_jacobian(dragged(LAWS["constant"][0], "wrong_").problem)
    assert report.error > 1e-5
    assert report.worst.block == where
    assert where in str(report)
    right = {key: error for key, error in report.largest().items() if key[1] != where}
    assert max(right.values()) < 1e-6
