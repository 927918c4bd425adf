"""Surfaces that meet themselves: as two contacts, as half of a symmetric body, and never wrong."""

import numpy as np
import pytest

import fenicsx_friction as ff
from folds import column, tube

#: Plates come closer by these parts of a radius; the inside of the tube meets itself near 0.82.
COARSE = np.append(np.arange(0.04, 0.8, 0.04), [0.8, 0.82, 0.84, 0.86, 0.88])


def path(d):
    """Press a column, and drag it over more than two faces."""
    for k in range(10):
        yield (0.06 * k, *[0.0] * (d - 2), -0.05)


def crushed(model, places=COARSE):
    """Crush a tube and return the last report."""
    for c in places:
        report = model.solve(c)
        assert report.certified
    return report


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    ("widths", "pairs"),
    [((1.0, 1.0, 1.0), [(2, 3), (4, 5)]), ((1.5, 1.0, 1.5), [(3, 2), (4, 5)])],
    ids=["even", "overhanging"],
)
def test_many_bodies_of_one_surface_are_as_many_contacts(d, widths, pairs):
    """Where faces differ, those of wider blocks are larger, the finer ones are secondary."""
    n = 4 if d == 2 else 2
    together = column(d, "together_", widths=widths, n=n)
    apart = column(d, "apart_", pairs=pairs, widths=widths, n=n)
    slipped = 0
    for way in list(path(d))[: None if d == 2 else 5]:
        one, two = together.solve(*way), apart.solve(*way)
        for state in ("stick", "slip"):
            assert getattr(one.contacts[0], state) == sum(getattr(k, state) for k in two.contacts)
        slipped += one.contacts[0].slip
        assert np.max(abs(together.by_place() - apart.by_place())) < 1e-11
        assert sum(k.dissipation for k in two.contacts) == pytest.approx(
            one.contacts[0].dissipation, abs=1e-11
        )
    assert slipped > 0


@pytest.mark.mpi
def test_a_crushed_tube_is_twice_its_half_on_the_plane_of_symmetry():
    """Equal until the walls meet. Then a node meets the tilted face beside its image."""
    whole, half = tube("whole_"), tube("half_", half=True)
    for c in COARSE:
        one, two = whole.solve(c), half.solve(c)
        force, inside = one.contacts[0].force[1], abs(one.contacts[2].force[1])
        assert force == pytest.approx(two.contacts[0].force[1], rel=1e-9 if inside == 0.0 else 1e-3)
        assert inside == pytest.approx(abs(two.contacts[1].force[1]), rel=1e-3, abs=1e-9)
    assert inside > 0.5 * abs(force)


@pytest.mark.mpi
def test_the_crushed_tube_is_in_balance_and_its_derivatives_are_right():
    model = tube("balance_")
    report = crushed(model)
    top, bottom, _ = (np.array(k.force) for k in report.contacts)
    assert np.max(abs(top + bottom)) < 1e-7 * abs(top[1])
    assert report.contacts[2].stick + report.contacts[2].slip >= 10
    assert ff.check_jacobian(model.problem).error < 1e-6


@pytest.mark.mpi
@pytest.mark.parametrize(
    "changes",
    [{"unit": 1e-6}, {"unit": 1e3, "E": 2.1e11}, {"turn": 0.61}, {"linear_solver": "multigrid"}],
    ids=["micrometres", "kilometres", "turned", "multigrid"],
)
def test_forces_depend_neither_on_units_nor_on_axes(changes):
    model, same = tube("one_"), tube("other_", **changes)
    unit = changes.get("unit", 1.0) * changes.get("E", 100.0) / 100.0
    for one, two in zip(crushed(model).contacts, crushed(same).contacts, strict=True):
        size = unit * np.linalg.norm(one.force)
        assert np.linalg.norm(two.force) == pytest.approx(size, rel=1e-5)
