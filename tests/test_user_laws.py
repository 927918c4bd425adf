"""Friction laws of users: their own rows, their own limits, what is certified."""

from mpi4py import MPI

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


#: What UFL works out at pressure 0 or 1 has no real value, but in a branch that is not taken.
GUARDED = {
    "root": lambda p: ufl.sqrt(p - 2.0),
    "power": lambda p: (p - 2.0) ** 0.5,
    "logarithm": lambda p: ufl.ln(p / 2.0),
    "quotient": lambda p: ufl.acos(2.0 / p),
}


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("part", GUARDED)
def test_a_branch_that_is_not_taken_may_have_no_value(part):
    class Guarded(ff.FrictionLaw):
        def limit(self, pressure, sliding):
            more = ufl.conditional(ufl.gt(pressure, 2.0), 1.0 + GUARDED[part](pressure), 1.0)
            return 0.1 * pressure * more

    model = dragged(lambda m, s: Guarded(), f"guarded_{part}_")
    assert model.move(0.05, -DEPTH).certified
    _, pressure, traction, _, slip = model.nodes()
    assert np.sum(pressure > 2.0) >= 3
    assert np.all(slip[pressure > 2.0, 0] > 1e-3)
    above = np.maximum(pressure, 2.0)
    more = {
        "root": np.sqrt(above - 2.0),
        "power": np.sqrt(above - 2.0),
        "logarithm": np.log(above / 2.0),
        "quotient": np.arccos(2.0 / above),
    }[part]
    assert -traction[:, 0] == pytest.approx(0.1 * pressure * (1.0 + more), rel=1e-9, abs=1e-9)
    assert check_jacobian(model.problem).error < 1e-6


@pytest.mark.mpi
def test_a_law_that_fails_on_one_rank_fails_on_all():
    class OfOneRank(ff.FrictionLaw):
        def limit(self, pressure, sliding):
            if MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1:
                raise RuntimeError("it has lost its table")
            return 0.1 * pressure

    with pytest.raises(ff.ContactInputError, match="it has lost its table"):
        dragged(lambda m, s: OfOneRank(), "of_one_rank_")


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
