"""Wrong answers between bodies, as a user would get them: each ends in an error or a warning."""

from dataclasses import replace

import numpy as np
import pytest

import fenicsx_friction as ff
from bodies import stack
from fenicsx_friction.obstacles.face_pairs import FacesMet
from models import with_contact
from shapes import BALL, ball

PLANE = {"cell": "quadrilateral", "upper": (4, 2), "lower": (4, 2)}
GAP = 0.5
APART = PLANE | {"top": ((0.1, 1.0 + GAP), (0.9, 1.5 + GAP)), "base": ((0.0, 0.0), (1.0, 1.0))}


# -- through the obstacle within a step -----------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("depth", [0.5, 5.0], ids=["into", "beyond"])
def test_a_block_that_is_carried_through_the_base_is_refused(depth):
    """Deeper than the reach no node would meet a face; the pairs are back where they were."""
    model = stack(0.3, "tunnel_", **APART, search=ff.SearchPolicy(reach=0.2))
    model.move(0.0, -GAP - depth)
    before = model.contact.pairing.pairs
    with pytest.raises(ff.StepFailed, match=r"5 nodes of 'secondary' went through the obstacle"):
        model.problem.solve()
    assert model.contact.pairing.pairs is before
    model.move(0.0, -0.5 * GAP)
    report = model.problem.solve()
    assert report.contacts[0].open == 5


@pytest.mark.mpi
def test_a_load_stepper_cuts_the_step_that_would_carry_the_block_through():
    model = stack(0.3, "tunnel_cut_", **APART, search=ff.SearchPolicy(reach=0.2))
    end = -GAP - 0.3

    def push(t):
        model.move(0.0, t * end)

    records = ff.LoadStepper(model.problem, push, end=1.0, step=1.0, progress=False).run()
    assert sum(len(r.failed) for r in records) > 0
    totals = records[-1].report.contacts[0]
    assert totals.open == 0
    assert totals.force[1] > 10.0


def on_obstacle(prefix, obstacle):
    """A block of 1 x 0.5 with a middle node, 0.5 above the origin."""
    shape = {"cell": "quadrilateral", "upper": (8, 2), "lower": (1, 1)}
    shape |= {"top": ((-0.5, 0.5), (0.5, 1.0)), "base": ((-0.5, -9.0), (0.5, -8.0))}
    return stack(0.3, prefix, **shape, obstacle=obstacle)


@pytest.mark.mpi
@pytest.mark.parametrize("obstacle", [BALL, ff.ImplicitObstacle(ball)], ids=["sphere", "gap"])
def test_a_block_that_is_carried_through_a_rigid_ball_is_refused(obstacle):
    model = on_obstacle("ball_", replace(obstacle))
    model.move(0.0, -2.0)
    with pytest.raises(ff.StepFailed, match=r"3 nodes of 'secondary' went through the obstacle"):
        model.problem.solve()
    model.move(3.0, 0.0)
    model.problem.solve()
    model.move(3.0, -2.0)  # past it
    assert model.problem.solve().contacts[0].open == 9


# -- the wrong side -------------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("wrong", ["reversed plane", "outside its socket"])
def test_a_rigid_obstacle_on_the_wrong_side_is_refused(wrong):
    obstacle = {
        "reversed plane": ff.RigidPlane((0.0, 0.3), (0.0, -1.0)),
        "outside its socket": ff.RigidSphere((0.0, -2.0), 2.4, inside=True),
    }[wrong]
    with pytest.raises(
        ff.ContactInputError, match=r"opposes the surface's outward normal at none of the 9 nodes"
    ):
        on_obstacle("wrong_", obstacle)


@pytest.mark.mpi
def test_an_obstacle_that_looks_away_from_afar_is_warned_about():
    """It may turn to the surface later."""
    with pytest.warns(UserWarning, match=r"at none of the 9 nodes; 0 of them are at"):
        on_obstacle("away_", ff.RigidPlane((0.0, 3.0), (0.0, -1.0)))


@pytest.mark.mpi
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "obstacle",
    [
        ff.RigidPlane((0.0, 0.5), (0.0, 1.0)),
        ff.RigidPlane((0.0, 0.55), (0.0, 1.0)),
        ff.RigidPlane((0.0, -70.0), (0.0, 1.0)),
        ff.RigidSphere((0.0, 2.0), 2.0, inside=True),
        ff.RigidSphere((0.0, 0.0), 0.5),
        ff.RigidSphere((40.0, 0.0), 1.0),
    ],
)
def test_right_obstacles_near_and_far_are_not(obstacle):
    on_obstacle("right_", obstacle)


def contact_of(model, secondary, primary, **search):
    """Make a second problem of the same bodies with other surfaces."""
    msh = model.problem.u.function_space.mesh
    surfaces = (
        ff.ContactSurface(msh, model.tags, tag, f"tag {tag}") for tag in (secondary, primary)
    )
    one, other = surfaces
    obstacle = ff.DeformableObstacle(other, search=ff.SearchPolicy(**search))
    contact = ff.Contact(one, obstacle, ff.Coulomb(0.3))
    return with_contact(model, contact, "other_", bcs=None)


FLAT = PLANE | {"top": ((0.0, 1.0), (1.0, 2.0)), "base": ((0.0, 0.0), (1.0, 1.0))}


@pytest.mark.mpi
def test_a_primary_surface_on_the_wrong_side_of_its_body_is_refused():
    model = stack(0.3, "side_", **FLAT)
    with pytest.raises(ff.ContactInputError, match=r"at none of the 5 nodes; 5 of them"):
        contact_of(model, 1, 3, reach=2.0)
    with pytest.warns(UserWarning, match=r"at none of the 5 nodes"):
        contact_of(model, 1, 3, reach=0.1)  # deep behind it: may be another part of the body
    with pytest.warns(UserWarning, match=r"at none of the 5 nodes"):
        contact_of(model, 4, 2)


@pytest.mark.mpi
def test_nodes_that_start_too_deep_are_named():
    deep = FLAT | {"top": ((0.0, 0.7), (1.0, 1.7)), "base": ((0.0, 0.0), (1.0, 0.95))}
    with pytest.warns(UserWarning, match=r"5 nodes start deeper .*(?s:.)*gap -0.25 m"):
        stack(0.3, "deep_", **deep, search=ff.SearchPolicy(reach=0.2))


# -- faces that stand across ---------------------------------------------------------------------


def dragged_over_the_edge(prefix, **options):
    """A block hangs over the edge of a base, is pressed, and slides off; forces of each step."""
    over = {"top": ((-0.52, 1.0), (0.48, 2.0)), "base": ((0.0, 0.0), (1.0, 1.0))}
    model = stack(
        0.3, prefix, cell="quadrilateral", upper=(10, 10), lower=(4, 4), **over, **options
    )
    forces = []
    for way in ((0.0, -0.02), (0.0, -0.05), (-0.1, -0.05), (-0.2, -0.05)):
        model.move(*way)
        forces.append(model.problem.solve().contacts[0].force)
    return np.array(forces)


@pytest.mark.mpi
def test_nodes_do_not_hook_on_to_sides_that_stand_across():
    """Whoever marks bodies all round gets what the faces that meet give, to the bit of search."""
    alone = dragged_over_the_edge("edge_")
    np.testing.assert_allclose(
        dragged_over_the_edge("edge_all_round_", all_round=True), alone, rtol=1e-8
    )
    assert np.all(abs(alone[2:, 0]) < 0.31 * alone[2:, 1])


def test_they_would_hook_on_to_sides_that_stand_a_little_away(monkeypatch):
    monkeypatch.setattr(FacesMet, "facing", 0.0)
    with pytest.raises(AssertionError):
        test_nodes_do_not_hook_on_to_sides_that_stand_across()


# -- wrong input ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "match"),
    [({"reach": x}, "reach = ") for x in (np.nan, -1.0, 0.0, "far", np.inf, True, (1.0,), 1j)]
    + [({"enter": x}, r"enter=") for x in (np.nan, -0.1, "x", None, np.inf)]
    + [({"leave": np.nan}, "leave="), ({"keep": -1}, "keep=")]
    + [({"enter": 0.6}, "must not be larger than leave")],
)
def test_a_wrong_search_policy_is_refused(wrong, match):
    with pytest.raises(ff.ContactInputError, match=match):
        ff.SearchPolicy(**wrong)


@pytest.mark.mpi
def test_wrong_arguments_of_deformable_obstacles_are_refused():
    model = stack(0.3, "arguments_", **FLAT)
    msh, tags = model.problem.u.function_space.mesh, model.tags
    for wrong in (None, 3, tags, model.contact):
        with pytest.raises(ff.ContactInputError, match=r"primary = .*ContactSurface"):
            ff.DeformableObstacle(wrong)
    with pytest.raises(ff.ContactInputError, match=r"search = .*SearchPolicy"):
        ff.DeformableObstacle(ff.ContactSurface(msh, tags, 2), search=0.5)
    for wrong in (np.nan, -1.0, 0.0, "far", True):
        with pytest.raises(ff.ContactInputError, match="close_gaps = "):
            ff.DeformableObstacle(ff.ContactSurface(msh, tags, 2), close_gaps=wrong)
    with pytest.raises(ff.ContactInputError, match="4 facets in common"):
        contact_of(model, 1, 1)
    other = stack(0.3, "arguments_other_", **FLAT)
    elsewhere = other.problem.u.function_space.mesh
    obstacle = ff.DeformableObstacle(ff.ContactSurface(elsewhere, other.tags, 2))
    foreign = ff.Contact(model.contact.surface, obstacle, ff.Frictionless())
    with pytest.raises(ff.ContactInputError, match="another mesh"):
        with_contact(model, foreign, "foreign_", bcs=None)
    for wrong in (np.nan, -1.0, 0.0, "far", None):
        with pytest.raises(ff.ContactInputError, match="reach = "):
            ff.close_initial_gaps(msh, tags, 1, 2, wrong)
    with pytest.raises(ff.ContactInputError, match="4 facets in common"):
        ff.close_initial_gaps(msh, tags, 1, 1, 0.1)
    with pytest.raises(ff.ContactInputError, match="marks no facet"):
        ff.close_initial_gaps(msh, tags, 1, 77, 0.1)
    for wrong in (None, "mesh", tags):
        with pytest.raises(ff.ContactInputError, match=r"msh = .*Mesh"):
            ff.close_initial_gaps(wrong, tags, 1, 2, 0.1)
