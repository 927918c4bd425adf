"""Friction laws of users: their own rows, their own limits, what is certified."""

import numpy as np
import pytest
import ufl

import fenicsx_friction as ff
from dragged import DEPTH, PRESSURE, dragged
from fenicsx_friction import laws
from fenicsx_friction.verification.jacobian import check_jacobian
from models import by_place


class Viscous(ff.FrictionLaw):
    """``c_t = -eta s / dt`` in contact, as a row of its own."""

    def __init__(self, eta):
        self.eta = eta

    def limit(self, pressure, sliding):
        return pressure  # tells the row where there is contact

    def row(self, s, c_t, limit, r, eps):
        return c_t + ufl.conditional(ufl.gt(limit, 0.0), self.eta, 0.0) * s


@pytest.mark.mpi
def test_a_law_with_its_own_row_is_solved_but_not_certified():
    eta = 20.0
    model = dragged(lambda m, s: Viscous(eta), "viscous_")
    report = model.move(0.05, -DEPTH)
    certificate = report.certificate
    assert certificate.solved
    assert not certificate.certified
    assert not certificate.certifiable
    assert not report.certified
    assert certificate.as_dict()["certified"] is False
    _, pressure, traction, _, slip = model.nodes()
    assert np.all(pressure > 0.0)
    assert np.all(slip[:, 0] > 1e-3)
    assert traction[:, 0] == pytest.approx(-eta * slip[:, 0], abs=1e-9 * PRESSURE)
    assert check_jacobian(model.problem).error < 1e-6


@pytest.mark.mpi
def test_the_same_viscous_law_as_a_limit_is_certified():
    """``limit = eta |s| / dt`` is a cone at every slip, so that its projection is known."""

    class Certified(ff.FrictionLaw):
        def limit(self, pressure, sliding):
            return 20.0 * sliding.rate

    model, other = (
        dragged(lambda m, s, law=law: law, "cone_") for law in (Certified(), Viscous(20.0))
    )
    assert model.move(0.05, -DEPTH).certified
    other.move(0.05, -DEPTH)
    assert by_place(model.problem.u) == pytest.approx(by_place(other.problem.u), abs=1e-11)


@pytest.mark.mpi
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_law_whose_limit_is_not_that_of_its_rows_is_refused(factor):
    class Pretending(ff.Coulomb):
        certifiable = True

        def row(self, s, c_t, limit, r, eps):
            return laws.projection_row(s, c_t, factor * limit, r, eps)

    model = dragged(lambda m, s: Pretending(0.3), "pretending_")
    with pytest.raises(ff.StepFailed) as failure:
        model.move(0.05, -DEPTH)
    assert failure.value.report.certificate.relative > 1e-3


def test_a_law_of_the_user_may_derive_from_coulomb_with_a_constructor_of_its_own():
    class Sandpaper(ff.Coulomb):
        def __init__(self, grit):
            super().__init__(mu=10.0 / grit)

    model = dragged(lambda m, s: Sandpaper(25.0), "sandpaper_")
    report = model.move(3.0, -DEPTH)
    assert report.certified
    tangential, normal = report.contacts[0].force
    assert abs(tangential) == pytest.approx(0.4 * normal, rel=1e-9)
