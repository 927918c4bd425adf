"""The Raous rectangle (SSNV128, Kanno et al. 2006): digits, exact solutions, robustness."""

from pathlib import Path

import numpy as np
import pytest

import fenicsx_friction as ff
from fenicsx_friction.loading.energy import EnergyAudit
from fenicsx_friction.verification.exact import ExactReference
from models import SIDE, gathered, raous

DATA = Path(__file__).parent / "data"
POINTS_MM = np.array([0.0, 1.25, 5.0, 7.5, 11.25])  # A to E

# u_x of A to E in 1e-5 m. Q4: code_aster SSNV128q, printed digits; B-bar: exact discrete solution,
# certified to 1e-12 by an independent solver (nonsmooth condensation on the same mesh).
Q4_32X10 = np.array([2.84594384, 2.70792364, 2.27402555, 1.97270669, 1.53641594])
BBAR_32X16 = np.array([2.8577766681, 2.7199019760, 2.2835357837, 1.9788084575, 1.5400400510])

#: Loading, unloading, reloading as fractions of the lateral and the top pressure.
HISTORY = [
    (0.3, 0.6), (0.7, 0.8), (1.0, 1.0), (0.6, 1.0), (0.1, 1.0),
    (-0.4, 1.0), (0.0, 0.7), (0.5, 0.4), (0.9, 0.8), (1.0, 1.0),
]  # fmt: skip


def at_points(x, u):
    return np.interp(POINTS_MM * 1e-3, x[:, 0], u[:, 0])


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("corrector", ["projection", "ramp"])
def test_q4_equals_code_aster_to_nine_digits(corrector):
    model = raous(32, 10, 1.0, f"q4_{corrector}_", corrector=corrector)
    model.load(1.0, 1.0)
    report = model.problem.solve()
    x, _, u = gathered(model.problem)
    assert at_points(x, u) == pytest.approx(Q4_32X10 * 1e-5, rel=1e-8)
    totals = report.contacts[0]
    assert (totals.open, totals.slip, totals.stick) == (3, 22, 8)  # stick with the corner
    # Vertical equilibrium: the base carries the pressure on the top.
    assert totals.force[1] == pytest.approx(50e6 * SIDE, rel=1e-12)
    assert any(s.name == "slip" for s in report.substeps) == (corrector == "ramp")


@pytest.mark.parametrize(
    ("name", "ny", "bbar"), [("raous_32x10_q4", 10, False), ("raous_32x16_bbar", 16, True)]
)
def test_all_nodal_values_of_the_exact_tables(name, ny, bbar):
    model = raous(32, ny, 1.0, f"{name}_", bbar=bbar)
    model.problem.solve()
    x, c, u = gathered(model.problem)
    table = np.loadtxt(DATA / f"{name}.csv", delimiter=",", skiprows=2)
    n = len(table)
    assert x[:n, 0] * 1e3 == pytest.approx(table[:, 0], abs=1e-9)
    assert c[:n, 0] * 1e-6 == pytest.approx(table[:, 1], abs=1e-4)
    assert -c[:n, 1] * 1e-6 == pytest.approx(table[:, 2], abs=1e-4)
    assert u[:n] * 1e3 == pytest.approx(table[:, 3:], abs=1e-9)


def test_bbar_has_the_ten_digits():
    model = raous(32, 16, 1.0, "bbar_", bbar=True)
    model.problem.solve()
    x, _, u = gathered(model.problem)
    assert at_points(x, u) == pytest.approx(BBAR_32X16 * 1e-5, rel=1e-8)


@pytest.mark.quick
@pytest.mark.parametrize("corrector", ["projection", "ramp"])
@pytest.mark.parametrize("mu", [0.0, 0.2, 1.0, 5.0])
def test_history_equals_the_exact_reference(mu, corrector):
    model = raous(16, 16, mu, f"history_{corrector}_", corrector=corrector)
    exact = ExactReference(model.problem)
    for fractions in HISTORY:
        model.load(*fractions)
        expected, report = exact.advance(), model.problem.solve()
        _, c, u = gathered(model.problem)
        order = np.argsort(model.contact.surface.x[:, 0])
        scale = np.max(np.abs(expected.c))
        assert report.certificate.relative <= 1e-9
        assert c == pytest.approx(expected.c[order], abs=1e-8 * scale)
        assert u == pytest.approx(expected.u[order], abs=1e-8 * np.max(np.abs(expected.u)))


@pytest.mark.mpi
@pytest.mark.parametrize("mu", [0.0, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0])
@pytest.mark.parametrize("n", [16, 64])
def test_one_step_is_certified_up_to_high_friction(n, mu):
    model = raous(n, n, mu, "steep_")
    report = model.problem.solve()
    assert report.certificate.relative <= 1e-9
    (state,) = model.problem.accepted
    assert np.all(np.linalg.norm(state.c[:, 1:], axis=1) <= mu * state.c[:, 0] + 1.0)  # Pa of 1e8
    assert np.all(state.gap >= -1e-15)


@pytest.mark.mpi
def test_holding_the_load_changes_nothing():
    """50 steps without load change, from a partly slipping and from a fully sticking state."""
    model = raous(16, 16, 1.0, "hold_")
    for fractions in ((1.0, 1.0), (0.95, 1.0)):
        model.load(*fractions)
        model.problem.solve()
        before = model.problem.u.x.array.copy()
        slip_scale = 1e-5  # m, the slip of the loading
        for _ in range(50):
            model.problem.solve()
        assert np.max(np.abs(model.problem.u.x.array - before), initial=0.0) < 1e-12 * slip_scale


@pytest.mark.mpi
def test_energy_is_conserved_up_to_the_known_defect():
    model = raous(16, 16, 0.5, "energy_")
    model.load(0.0, 0.0)  # the audit starts from the unloaded state
    audit = EnergyAudit(model.problem, model.stored, model.loads)
    work = 0.0
    for fractions in HISTORY:
        model.load(*fractions)
        report = model.problem.solve()
        balance = audit.update()
        work = max(work, abs(balance.external_work))
        # For a quadratic energy the trapezoidal work of all forces is the stored energy, exactly.
        assert balance.external_work + balance.contact_work == pytest.approx(
            balance.stored, abs=1e-11 * work
        )
        assert balance.defect == pytest.approx(
            -balance.contact_work - balance.dissipation, abs=1e-11 * work
        )
        assert balance.smallest_dissipation >= -1e-14 * work
        assert balance.dissipation == pytest.approx(
            report.contacts[0].dissipation, abs=1e-14 * work
        )
    assert work > 1.0  # J/m: there was something to conserve


def test_defect_vanishes_with_the_step():
    """The defect of the proportional loading halves with the number of steps, first order."""
    defects = []
    for steps in (4, 8, 16):
        model = raous(8, 8, 0.5, "defect_")
        model.load(0.0, 0.0)
        audit = EnergyAudit(model.problem, model.stored, model.loads)
        total = 0.0
        for i in range(steps):
            model.load((i + 1) / steps, (i + 1) / steps)
            model.problem.solve()
            total += audit.update().defect
        defects.append(abs(total))
    assert defects[0] / defects[1] == pytest.approx(2.0, rel=0.05)
    assert defects[1] / defects[2] == pytest.approx(2.0, rel=0.05)


def test_units_do_not_matter():
    """The same problem in mm and N/mm² gives the same numbers and takes the same iterations."""
    results = []
    for unit in (1.0, 1e3):
        model = raous(16, 10, 1.0, f"unit{unit:.0f}_", unit=unit, corrector="ramp")
        # Lengths times unit, tractions over unit squared: forces per depth scale with 1/unit.
        report = model.problem.solve()
        _, c, u = gathered(model.problem)
        results.append((c * unit**2, u / unit, report.iterations))
    assert results[1][0] == pytest.approx(results[0][0], rel=1e-9, abs=1e-2)
    assert results[1][1] == pytest.approx(results[0][1], rel=1e-9, abs=1e-15)
    assert results[1][2] == results[0][2]


@pytest.mark.parametrize("ramp_nodes", ["violated", "all"])
@pytest.mark.parametrize("ramp_sign", [-1, 1])
def test_every_variant_of_the_ramp_ends_in_the_same_solution(ramp_sign, ramp_nodes):
    model = raous(
        32, 10, 1.0, f"ramp{ramp_sign}_", corrector="ramp",
        ramp_sign=ramp_sign, ramp_nodes=ramp_nodes,
    )  # fmt: skip
    report = model.problem.solve()
    x, _, u = gathered(model.problem)
    assert at_points(x, u) == pytest.approx(Q4_32X10 * 1e-5, rel=1e-8)
    assert report.certified


@pytest.mark.mpi
def test_pressures_may_be_a_field_of_friction():
    """A friction coefficient given in UFL: frictionless left half, stuck right half."""
    import ufl

    split = raous(
        16, 8, lambda p, s: ufl.conditional(ufl.lt(s.x[0], SIDE / 2 - 1e-3), 0.0, 2.0), "field_"
    )
    split.problem.solve()
    X, c, _ = gathered(split.problem)
    left = X[:, 0] < SIDE / 2 - 1e-6
    assert np.max(np.abs(c[left, 1])) < 1e-15 * np.max(c[left, 0])
    assert np.all(np.abs(c[~left, 1]) <= 2.0 * c[~left, 0] * (1 + 1e-12))
    assert np.max(np.abs(c[~left, 1])) > 1e6
    assert isinstance(split.contact.friction, ff.Coulomb)
