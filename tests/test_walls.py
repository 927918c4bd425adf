# SPDX-License-Identifier: MIT
"""Walls of rigid tools beside the surface that slides to them: met, or refused."""

import numpy as np
import pytest

import fenicsx_friction as ff
from fenicsx_friction.obstacles.surface_pairing import SurfacePairing
from fenicsx_friction.obstacles.weighted_surface import WeightedSurface
from rectangles import body
from tools import box, polygon

BLOCK = {"low": (-0.5, 0.0), "high": (0.5, 0.5), "simplices": True}
PATH = [(0.0, -0.02), (-0.01, -0.02), (-0.02, -0.02)]
KINDS = {1: SurfacePairing, 2: WeightedSurface}


def stairs(height, place=-0.52, side=1.0, lean=0.0):
    """A floor with a wall of some height at the left of the block, or its mirror image."""
    top = (place + lean, height)
    corners = [(2.0, 0.0), (place, 0.0), top, (-3.0, height), (-3.0, -1.0), (2.0, -1.0)]
    points, segments = polygon(np.array(corners) * [side, 1.0])
    return ff.RigidSurface(points, segments if side > 0.0 else segments[:, ::-1])


def sliding(tags, obstacles, name, n, degree=1, mu=0.0):
    law = ff.Coulomb(mu) if mu else ff.Frictionless()

    def make(msh, surfaces):
        return [ff.Contact(surfaces[t], o, law) for t, o in zip(tags, obstacles, strict=True)]

    return body(make, name, n=[n, n // 2], degree=degree, **BLOCK)


def slide(model, path=PATH, side=1.0):
    """Move the block; return the last report."""
    for x, z in path:
        model.place(np.eye(2), np.array([side * x, z]))
        report = model.problem.solve()
        assert report.certified
    return report


@pytest.mark.mpi
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("degree", "n", "height"),  # a mesh does not resolve less than a tenth of a face
    [(k, n, h) for h in (0.02, 0.1) for k, n in ((1, 40), (1, 10), (2, 10))] + [(2, 4, 0.1)],
)
def test_a_wall_that_the_surface_does_not_turn_to_is_refused(degree, n, height, side):
    """The bottom alone is a contact: it must not slide into the wall, in steps however small."""
    tool = stairs(height, side=side)
    model = sliding([1], [tool], f"blind{degree}{n}_", n, degree)
    with pytest.raises(ff.StepFailed):
        slide(model, [(-x, -0.02) for x in np.linspace(0.0, 0.1, 11)], side)
    bottom = np.isclose(model.x[:, 1], 0.0)
    reached = np.max(-side * (model.x + model.u.x.array.reshape(-1, 2))[bottom, 0], initial=0.0)
    assert reached - 0.52 < 0.1 / n  # of its width of 1


@pytest.mark.parametrize("step", [0.01, 0.3])
@pytest.mark.parametrize("degree", [1, 2])
def test_a_wall_that_leans_over_the_block_is_seen_from_within(degree, step):
    """Its back is beyond: the tool is closed, and inside is inside, wherever faces look."""
    model = sliding([1], [stairs(0.3, lean=0.1)], f"lean{degree}_", 10, degree)
    with pytest.raises(ff.StepFailed, match=r"tenth of a face|went through"):
        slide(model, [(-x, -0.02) for x in (0.0, *(step * np.arange(1, 6)))])


@pytest.mark.parametrize("degree", [1, 2])
def test_without_these_tests_it_slides_into_the_wall(degree, monkeypatch):
    kind = KINDS[degree]
    monkeypatch.setattr(kind, "sunk", lambda self: np.zeros(self.side.surface.num_owned, bool))
    monkeypatch.setattr(kind, "_find_crossed", lambda self, motion, started, *_: 0 * started - 1)
    model = sliding([1], [stairs(0.1)], f"sunk{degree}_", 4, degree)
    slide(model, [(-x, -0.02) for x in np.arange(7) * 0.02])
    assert np.max(abs(model.contact.nodal_traction()[:, 0])) < 1e-6


@pytest.mark.mpi
@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_two_contacts_meet_floor_and_wall_as_two_planes(mu):
    tool = stairs(0.6)
    planes = [ff.RigidPlane((0.0, 0.0), (0.0, 1.0)), ff.RigidPlane((-0.52, 0.0), (1.0, 0.0))]
    found = []
    for name, obstacles in (("tool", [tool, tool]), ("planes", planes)):
        model = sliding([1, 3], obstacles, f"{name}{int(10 * mu)}_", 10, mu=mu)
        found.append(np.array([k.force for k in slide(model).contacts]))
    # With friction the two may share the force at the corner, which belongs to both, otherwise.
    tool, flat = (f if mu == 0.0 else f.sum(axis=0) for f in found)
    assert tool == pytest.approx(flat, rel=1e-4 if mu else 1e-9, abs=1e-9)
    assert found[0][1][0] > 0.4  # the wall presses


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
def test_the_same_obstacle_in_two_contacts_is_refused(degree):
    floor = {"open_edges": "allow"}
    both = [
        [ff.RigidPlane((0.0, 0.0), (0.0, 1.0)) for _ in range(2)],
        [ff.RigidSurface(*box((-2.0, -1.0), (2.0, 0.0)), **floor) for _ in range(2)],
    ]
    for obstacles in both:
        with pytest.raises(ff.ContactInputError, match="meet the same rigid obstacle"):
            sliding([1, 1], obstacles, "twice_", 4, degree)
    # Two obstacles that the same faces meet one after the other are none.
    low = ff.RigidPlane((0.0, -0.01), (0.0, 1.0))
    slide(sliding([1, 1], [both[0][0], low], f"one{degree}_", 4, degree), PATH[:1])
    # Nor are two that are far away.
    far = [ff.RigidSurface(*box((-3.0, z), (3.0, z + 1.0))) for z in (-7.0, -9.0)]
    sliding([1, 1], far, f"far{degree}_", 4, degree)


def test_two_obstacles_that_start_at_one_place_are_told():
    def make(msh, surfaces):
        up = ff.RigidMotion(msh)
        floors = [ff.RigidPlane((0.0, 0.0), (0.0, 1.0), motion=m) for m in (None, up)]
        return [ff.Contact(surfaces[1], floor, ff.Frictionless()) for floor in floors]

    with pytest.warns(UserWarning, match="meet the same rigid obstacle"):
        body(make, "start_", n=[4, 2], **BLOCK)


@pytest.mark.parametrize("clearance", [0.0, 1e-9, 1e-6, 1e-4])
def test_a_plug_slides_down_a_slot_that_it_touches(clearance):
    """Its nodes pass the corners of the slot, beside walls at right angles to the way: no force."""
    low, wide = -0.5 - clearance, 0.5 + clearance
    corners = [(wide, 0.8), (wide, 0.0), (low, 0.0), (low, 0.8), (-0.9, 0.8), (-0.9, -1.0)]
    corners += [(0.9, -1.0), (0.9, 0.8)]
    slot = ff.RigidSurface(*polygon(corners))
    model = sliding([5], [slot], "plug_", 10, mu=0.3)
    report = slide(model, [(0.0, z) for z in (0.43, 0.38, 0.33)])
    assert np.max(abs(np.array(report.contacts[0].force))) < 1e-9


def test_a_node_slides_over_a_corner_down_the_flank():
    """It starts on the corner itself, and presses on the flank with friction then."""
    corners = [(0.2, 0.0), (-0.2, 0.0), (-0.8, -0.6), (0.8, -0.6)]
    tool = ff.RigidSurface(*polygon(corners))
    model = sliding([1], [tool], "flank_", 10, mu=0.3)
    slide(model, [(0.0, -0.01), (0.0, -0.03), (0.03, -0.03), (0.035, -0.03)])
    x = model.contact.surface.x[:, 0]
    k = int(np.argmin(abs(x - 0.2)))
    force = model.contact.nodal_traction()[k]
    normal, along = force @ np.array([1.0, 1.0]) / 2**0.5, force @ np.array([1.0, -1.0]) / 2**0.5
    assert normal > 1.0
    assert along == pytest.approx(-0.3 * normal, rel=1e-9)
