"""Bulks that are not linear, solved on the boundary: Newton around exact contact."""

import numpy as np
import pytest

import fenicsx_friction as ff
from bodies import stack
from both_ways import compare, follow
from fenicsx_friction.increment import rebalance
from fenicsx_friction.solvers.condensed_bulk import CondensedBulk
from fenicsx_friction.solvers.schur import FactorFailed
from models import block

#: Up to a tenth of the height down, and a fifth across.
PATH = [(0.0, 0.0, -0.01), (0.02, 0.01, -0.03), (0.1, -0.02, -0.05), (-0.05, 0.0, -0.02)]
LIFTED = [(0.0, 0.0, -0.02), (0.0, 0.0, 0.01)]


def finite(mu, prefix, **settings):
    return block("hexahedron", mu, f"{prefix}{mu}_", energy="finite", **settings)


@pytest.mark.quick
@pytest.mark.parametrize("mu", [0.0, pytest.param(0.3, marks=pytest.mark.mpi), 1.0, 5.0])
def test_block_at_finite_strain(mu):
    """As many factorisations for any friction: contact needs none."""
    reports = compare(lambda p: finite(mu, f"finite_{p}"), PATH)
    assert all(2 <= r.factorisations <= 6 for r in reports)


def test_block_that_is_lifted():
    compare(lambda p: finite(0.3, f"lifted_{p}"), LIFTED)


@pytest.mark.mpi
def test_two_bodies_at_finite_strain():
    """Nodes meet other faces: the search is inside, too."""
    path = [(0.0, 0.0, -0.02), (0.12, 0.0, -0.03), (0.3, 0.02, -0.03)]
    compare(lambda p: stack(0.4, f"rebalance_{p}", energy="finite"), path)


def test_the_default_is_the_whole_system():
    """It is cheaper, see docs/solvers.md."""
    model = finite(0.3, "auto_")
    model.move(*PATH[0])
    report = model.problem.solve()
    assert (report.solver, report.factorisations) == ("full", 0)


def test_the_way_is_shortened_where_cells_would_turn_over():
    """Half the way of a displacement by twice the height, and half of that, and so on."""
    model = finite(0.3, "shortened_", solver="condensed")
    model.move(*PATH[0])
    model.problem.solve()
    start = model.problem.u.x.array.copy()
    assert model.problem.solvers.condense() is not None
    model.problem.u.interpolate(lambda x: np.stack([0.0 * x[0], 0.0 * x[0], -2.0 * x[2]]))
    end = model.problem.u.x.array.copy()
    size = rebalance._shortened(model.problem, np.inf)
    assert np.isfinite(size)
    assert model.problem.u.x.array == pytest.approx(start + 0.25 * (end - start), abs=1e-15)


def test_a_bulk_without_balance_is_left_to_the_whole(monkeypatch):
    """And said to be so; the step is solved as a whole in the end."""
    monkeypatch.setattr(rebalance, "MOST_LINEARISATIONS", 1)
    model = finite(0.3, "unbalanced_", solver="condensed", fallbacks=1)
    model.move(*PATH[1])
    report = model.problem.solve()
    assert report.certified and report.solver == "full"
    assert [s.reason for s in report.substeps].count("NOT_BALANCED") == 1
    monkeypatch.undo()
    assert follow(model, PATH[2:], "condensed")[0][0].solver == "condensed"


def test_old_tangent_is_not_taken(monkeypatch):
    """A tangent that is never renewed makes Newton's method slow, and still no wrong result."""
    right = compare(lambda p: finite(0.3, f"renewed_{p}"), PATH[:2])
    tangent = ff.solvers.bulk_tangent.BulkTangent
    monkeypatch.setattr(tangent, "_dependencies", lambda self: [])
    wrong = compare_certified(lambda p: finite(0.3, f"frozen_{p}"), PATH[:2])
    assert wrong > sum(len(r.substeps) for r in right)


def compare_certified(make, path):
    """Solve on request on the boundary; return the number of substeps."""
    reports = follow(make("only_"), path, "condensed")[0]
    assert all(r.certified for r in reports)
    return sum(len(r.substeps) for r in reports)


def test_a_tangent_that_cannot_be_factored_on_the_way(monkeypatch):
    """The next ways are tried, the last of them on the whole."""
    refresh, calls = CondensedBulk.refresh, []

    def fails(self):
        calls.append(self)
        if len(calls) % 2 == 0:
            raise FactorFailed("singular", -10)
        refresh(self)

    monkeypatch.setattr(CondensedBulk, "refresh", fails)
    model = finite(0.3, "singular_", solver="condensed", fallbacks=1)
    model.move(*PATH[1])
    report = model.problem.solve()
    assert report.certified and report.solver == "full" and len(calls) >= 2


def test_all_factorisations_are_told(monkeypatch):
    """Those of a search for other solutions, too."""
    made = []
    factored = CondensedBulk._factored

    def counted(self, options):
        made.append(self)
        return factored(self, options)

    monkeypatch.setattr(CondensedBulk, "_factored", counted)
    model = finite(0.3, "told_", solver="condensed", look_for_others=True)
    model.move(*PATH[0])
    assert model.problem.solve().factorisations == len(made) > 4
