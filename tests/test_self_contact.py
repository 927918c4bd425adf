"""Surfaces that meet themselves: as two contacts, as half of a symmetric body, and never wrong."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import box, joined
from fenicsx_friction.obstacles import self_pairs
from fenicsx_friction.obstacles.roles import Roles
from fenicsx_friction.obstacles.self_pairs import SelfPairs, Shape
from folds import column, stored, tube

#: Plates come closer by these parts of a radius; the inside of the tube meets itself near 0.82.
COARSE = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.78, 0.82, 0.84, 0.86)


def path(d):
    """Press a column, and drag it over more than two faces."""
    for k in range(7):
        yield (0.09 * k, *[0.0] * (d - 2), -0.05)


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
    n = 4 if d == 2 else 3
    together = column(d, "together_", widths=widths, n=n)
    apart = column(d, "apart_", pairs=pairs, widths=widths, n=n)
    slipped = 0
    for way in list(path(d))[:: 1 if d == 2 else 3]:
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
    assert inside > 0.2 * abs(force)


def test_the_crushed_tube_is_in_balance_and_its_derivatives_are_right():
    model = tube("balance_")
    report = crushed(model)
    top, bottom, _ = (np.array(k.force) for k in report.contacts)
    assert np.max(abs(top + bottom)) < 1e-4 * abs(top[1])  # the springs hold what is sideways
    assert abs(top + bottom)[1] < 1e-9 * abs(top[1])
    assert report.contacts[2].stick + report.contacts[2].slip >= 9
    assert ff.check_jacobian(model.problem).error < 1e-6


@pytest.fixture(scope="module")
def forces():
    return [np.array(k.force) for k in crushed(tube("usual_")).contacts]


@pytest.mark.parametrize(
    "changes",
    [
        {"unit": 1e-6},
        {"unit": 1e3, "E": 2.1e11},
        {"turn": 0.61},
        {"linear_solver": "multigrid"},
    ],
    ids=["micrometres", "kilometres", "turned", "multigrid"],
)
def test_forces_depend_neither_on_units_nor_on_axes(changes, forces):
    unit = changes.get("unit", 1.0) * changes.get("E", 100.0) / 100.0
    for one, two in zip(crushed(tube("other_", **changes)).contacts, forces, strict=True):
        assert np.linalg.norm(one.force) == pytest.approx(unit * np.linalg.norm(two), rel=1e-5)


def test_thin_walls_do_not_meet_themselves():
    """A wall of a 25th of a face: its far side is behind, not in front."""
    thin = {"thickness": 0.01, "n": 24}
    with_surface = tube("thin_", all_round=True, **thin)
    alone = tube("alone_", self_contact=False, **thin)
    for c in (0.1, 0.3, 0.5):
        one, two = with_surface.solve(c), alone.solve(c)
        assert one.contacts[-1].open == 48
        assert one.contacts[0].force[1] == pytest.approx(two.contacts[0].force[1], rel=1e-9)


@pytest.mark.mpi
def test_thin_sheets_on_each_other_meet_only_their_neighbours():
    """Three sheets of a 25th of a face: the far sides of the outer ones are no penetration."""
    together = column(2, "sheets_", height=0.01, all_round=True)
    apart = column(2, "sheets_apart_", height=0.01, pairs=[(2, 3), (4, 5)])
    for way in ((0.0, -5e-4), (2e-4, -5e-4)):
        one, two = together.solve(*way), apart.solve(*way)
        assert one.contacts[0].stick + one.contacts[0].slip == 10
        assert np.max(abs(together.by_place() - apart.by_place())) < 1e-11
        assert abs(two.contacts[0].force[1]) > 0.1


@pytest.mark.mpi
def test_walls_that_went_through_each_other_are_refused():
    """Both halves of the tube are carried through each other, far beyond the reach."""
    model = tube("through_", search=ff.SearchPolicy(reach=0.1), mu=0.0)
    model.solve(0.1)
    before = model.by_place()
    with pytest.raises(ff.StepFailed):
        model.solve(1.2)
    assert np.array_equal(model.by_place(), before)
    assert model.solve(0.2).certified


def test_a_run_from_a_checkpoint_goes_on_as_if_there_had_been_none(tmp_path):
    one, two = tube("whole_run_"), tube("second_half_")
    crushed(one, COARSE[:-2])
    ff.write_checkpoint(tmp_path / "state.h5", one.problem)
    crushed(one, COARSE[-2:])
    two.move(COARSE[-3])
    ff.read_checkpoint(tmp_path / "state.h5", two.problem)
    crushed(two, COARSE[-2:])
    assert np.array_equal(one.problem.u.x.array, two.problem.u.x.array)


# -- what the parts are for: without each, tests above would fail ---------------------------------


def test_nodes_of_both_sides_would_press_twice(monkeypatch):
    """Each place would be met from both sides: matching nodes make the same condition twice."""
    monkeypatch.setattr(Roles, "secondary", lambda self, face, *_: face >= 0)
    model = column(2, "twice_")
    with pytest.raises(ff.StepFailed):
        model.solve(0.0, -0.05)


def test_thin_walls_would_be_pressed_apart(monkeypatch):
    monkeypatch.setattr(Shape, "behind", lambda self, i, *_, **__: np.zeros(len(i), dtype=bool))
    model = tube("pressed_apart_", all_round=True, thickness=0.01, n=24)
    with pytest.raises(ff.StepFailed):
        model.solve(0.1)


def test_thin_sheets_would_be_pressed_apart(monkeypatch):
    monkeypatch.setattr(self_pairs, "HALF", 1e9)
    with pytest.raises(ff.StepFailed):
        column(2, "sheets_apart_again_", height=0.01, all_round=True).solve(0.0, -5e-4)


def test_the_foot_of_a_wall_is_not_met_sideways(monkeypatch):
    """A node beside a block: its normal is tilted a little, away from the block's side."""
    model = column(2, "sideways_", widths=(1.5, 1.0, 1.5))
    pairing, state = model.problem.contacts[0].pairing, model.problem
    for u in (state.u, state.u_old):
        u.interpolate(lambda x: 0.05 * np.where(x[1] < 1.0 + 1e-5, [-x[1], x[0] - 1.0], 0.0))
    x = pairing.side.surface.x[: pairing.side.surface.num_owned]
    (beside,) = np.flatnonzero(np.linalg.norm(x[:, :2] - [1.125, 1.0], axis=1) < 1e-6)
    pairing.anchor()
    assert pairing.started()[beside] == -1
    monkeypatch.setattr(SelfPairs, "facing", 0.0)
    pairing.anchor()
    assert pairing.started()[beside] >= 0


# -- wrong input ----------------------------------------------------------------------------------


def test_quadratic_displacements_are_refused():
    with pytest.raises(ff.ContactInputError, match="SelfContact is node to face and needs"):
        tube("quadratic_", degree=2)


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_bodies_that_overlap_are_refused(d):
    with pytest.raises(ff.ContactInputError, match="nodes are inside another body"):
        column(d, "overlapping_", gap=-0.1)


def test_nodes_that_change_roles_are_not_tied():
    model = column(2, "tied_")
    with pytest.raises(ff.ContactInputError, match="meets itself, and its nodes change their ro"):
        ff.tie(model.problem.contacts[0], within=2e-4)


@pytest.mark.parametrize("search", [0.1, "near"])
def test_a_search_that_is_none_is_refused(search):
    with pytest.raises(ff.ContactInputError, match="must be a SearchPolicy, or None"):
        ff.SelfContact(search=search)


# -- one block put on another ---------------------------------------------------------------------


def put_on(prefix, n, beside, depth):
    """Lift a block, carry it over the one beside it, press; return the force on it, and lips.

    Args:
        prefix: Of the PETSc options.
        n: Elements along each block.
        beside: Distance of the blocks in the undeformed mesh (m).
        depth: How far the block is pressed (m).
    """
    shift = 1.0 + beside
    low = box([0.0, 0.0], [1.0, 0.5], [n, 2], "quadrilateral")
    high = box([shift, 0.0], [shift + 1.0, 0.5], [n, 2], "quadrilateral")
    msh = joined(MPI.COMM_WORLD, low, high)
    msh.topology.create_connectivity(1, 2)
    facets = np.sort(mesh.exterior_facet_indices(msh.topology))
    tags = mesh.meshtags(msh, 1, facets, np.ones_like(facets))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v, moved = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    bottom = fem.locate_dofs_geometrical(V, lambda x: (x[0] < 1.0 + 1e-9) & (x[1] < 1e-9))
    top = fem.locate_dofs_geometrical(V, lambda x: (x[0] > 1.0 + 1e-9) & (x[1] > 0.5 - 1e-9))
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1), ff.SelfContact(), ff.Coulomb(0.3))
    residual = ufl.derivative(stored(u), u, v)
    bcs = [fem.dirichletbc(fem.Function(V), bottom), fem.dirichletbc(moved, top)]
    problem = ff.FrictionalContactProblem(
        residual, u, bcs=bcs, contact=contact, petsc_options_prefix=prefix
    )
    across = 0.13 - shift
    lift = [(0.0, 0.15 * k) for k in range(1, 5)]
    carry = [(across * k / 8, 0.6) for k in range(1, 9)]
    press = [(across, 0.51), *[(across, 0.5 - depth * k / 10) for k in range(11)]]
    for way in lift + carry + press:
        moved.x.array[:] = np.tile(way, len(moved.x.array) // 2)
        assert problem.solve().certified
    forces = fem.assemble_vector(fem.form(residual)).array.reshape(-1, 2)[top].sum(axis=0)
    X = V.tabulate_dof_coordinates()[:, :2]
    x, is_low = X + u.x.array.reshape(-1, 2), X[:, 0] < 1.0 + 1e-9
    lips = [x[is_low & (X[:, 1] > 0.5 - 1e-9)], x[~is_low & (X[:, 1] < 1e-9)]]
    return forces, [lip[np.argsort(lip[:, 0])] for lip in lips]


@pytest.mark.parametrize("n", [4, 8], ids=["coarse", "fine"])
def test_a_block_put_on_its_neighbour_is_met_as_one_from_far_away(n):
    """At first its nodes are behind the planes of the faces that they will meet."""
    near, _ = put_on("near_", n, 0.1, depth=0.02)
    far, _ = put_on("far_", n, 5.0, depth=0.02)
    assert near == pytest.approx(far, rel=1e-6)


def test_where_roles_change_nothing_goes_through():
    """Roles start from both ends of the block; a tenth of a face is what two surfaces allow."""
    n = 16
    _, (low, high) = put_on("roles_", n, 5.0, depth=0.2)
    under = (high[:, 0] > 0.2) & (high[:, 0] < 0.9)
    above = high[under, 1] - np.interp(high[under, 0], *low.T)
    assert np.min(above) > -0.1 / n
