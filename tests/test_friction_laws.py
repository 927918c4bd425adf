"""Each friction law against its closed form, on blocks pressed on a plane and dragged."""

import numpy as np
import pytest

import fenicsx_friction as ff
from dragged import DEPTH, DT, LAWS, PRESSURE, constant, dragged, on_mesh
from fenicsx_friction import laws
from models import by_place


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("name", LAWS)
def test_a_dragged_block_meets_the_limit_exactly(name):
    make, limit = LAWS[name]
    model = dragged(make, "law_")
    model.problem.dt.value = DT
    # Right, on, and back; the limit follows the path and the rate.
    for x, sign in ((0.05, -1.0), (0.08, -1.0), (-0.08, 1.0)):
        report = model.move(x, -DEPTH)
        assert report.certified
        assert report.certificate.certifiable
        X, pressure, traction, path, slip = model.nodes()
        totals = report.contacts[0]
        assert totals.stick == 0
        assert totals.slip >= 4
        rate = np.linalg.norm(slip, axis=1) / DT
        expected = sign * limit(X, pressure, path, rate) * (pressure > 0.0)
        assert traction[:, 0] == pytest.approx(expected, abs=1e-9 * PRESSURE)
        if totals.open == 0:
            assert totals.force[1] == pytest.approx(PRESSURE, rel=1e-9)
        assert totals.dissipation >= -1e-12
    force = {"constant": 2.0, "Tresca": 2.5, "frictionless": 0.0}  # of the whole block
    if name in force:
        assert totals.open == 0
        assert totals.force[0] == pytest.approx(force[name], rel=1e-9, abs=1e-9)


@pytest.mark.mpi
def test_friction_follows_the_temperature():
    """``mu`` of a field that the user changes between steps, on the reference configuration."""
    fields = []

    def make(msh, surface):
        fields.append(on_mesh(msh, lambda x: 0 * x[0]))
        return ff.Coulomb(0.4 * (1.0 - fields[0] / 1000.0))

    model = dragged(make, "warm_")
    for i, warmth in enumerate((0.0, 500.0, 250.0)):
        fields[0].interpolate(lambda x, warmth=warmth: warmth * x[0])
        assert model.move(0.05 + 0.03 * i, -DEPTH).certified
        X, pressure, traction, *_ = model.nodes()
        expected = -0.4 * (1.0 - warmth * X[:, 0] / 1000.0) * pressure
        assert traction[:, 0] == pytest.approx(expected, abs=1e-9 * PRESSURE)


@pytest.mark.mpi
def test_a_constant_may_change_between_steps():
    mu = []

    def make(msh, surface):
        mu.append(constant(msh, 0.3))
        return ff.Coulomb(mu[0])

    model = dragged(make, "change_")
    assert model.move(0.05, -DEPTH).contacts[0].force[0] == pytest.approx(-3.0, rel=1e-9)
    mu[0].value = 0.1
    assert model.move(0.08, -DEPTH).contacts[0].force[0] == pytest.approx(-1.0, rel=1e-9)
    mu[0].value = -0.1
    with pytest.raises(ff.ContactInputError, match="must be >= 0"):
        model.move(0.09, -DEPTH)


@pytest.mark.mpi
@pytest.mark.parametrize("corrector", ["projection", "ramp"])
def test_permanent_stick_holds_any_traction_and_lets_go_when_pulled(corrector):
    model = dragged(lambda m, s: ff.PermanentStick(), "stuck_", corrector=corrector)
    model.move(0.0, -DEPTH)
    report = model.move(0.08, -DEPTH)
    assert report.certified
    *_, slip = model.nodes()
    totals = report.contacts[0]
    assert totals.slip == 0
    assert totals.stick >= 2
    assert abs(totals.force[0]) > 1.1 * totals.force[1]  # more than mu = 1 would hold
    pressure = model.nodes()[1]
    assert np.max(abs(slip[pressure > 1e-9 * np.max(pressure)])) < 1e-12
    report = model.move(0.08, 0.3)  # less far, a wedged corner is a solution, too
    assert report.contacts[0].open == 5
    assert np.max(abs(model.nodes()[2])) < 1e-12 * PRESSURE
    # Pressed again where it is now, it sticks there.
    report = model.move(0.08, -DEPTH)
    assert report.contacts[0].force == pytest.approx((0.0, PRESSURE), abs=1e-9 * PRESSURE)


# -- normal functions ------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("corrector", ["projection", "ramp"])
def test_the_normal_function_does_not_change_the_solution(corrector):
    """Press, drag until the trailing edge lifts, lift: open, stick and slip in one history."""
    solutions = []
    for normal in laws.NORMAL_ROWS:
        model = dragged(lambda m, s: ff.Coulomb(0.9), "normal_", normal=normal, corrector=corrector)
        history = [model.move(*d) for d in ((0.004, -DEPTH), (0.02, -DEPTH), (0.0, -DEPTH / 2))]
        assert all(report.certified for report in history)
        solutions.append(by_place(model.problem.u))
    scale = np.max(abs(solutions[0]))
    for other in solutions[1:]:
        assert other == pytest.approx(solutions[0], abs=1e-9 * scale)


@pytest.mark.parametrize(
    "arguments", [{"mu": -0.1}, {"mu": 0.1, "adhesion": -1.0}, {"mu": 0.1, "cap": float("nan")}]
)
def test_coefficients_are_checked(arguments):
    with pytest.raises(ff.ContactInputError, match="must be >= 0"):
        ff.Coulomb(**arguments)
