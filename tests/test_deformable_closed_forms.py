"""A block on a deformable base against closed forms and rigid planes."""

import numpy as np
import pytest

import fenicsx_friction as ff
from bodies import stack
from models import gathered


def faces_of_base(x):
    """Mark what the block of :func:`on_base` does not share: all nodes of a base of (2, 1, 1)."""
    return np.isclose(x[2], 0.5) & ~((x[0] > 0.3) & (x[0] < 1.1) & (x[1] > 0.1) & (x[1] < 0.9))


def on_base(prefix, E, lower=(3, 2, 1), hold=None, obstacle=None):
    """Return a block on a base, ``mu = 0.3``."""
    top, base = ((0.4, 0.2, 0.5), (1.0, 0.8, 1.1)), ((0.0, 0.0, 0.0), (2.0, 1.0, 0.5))
    bodies = {"upper": (2, 2, 2), "lower": lower, "top": top, "base": base}
    return stack(0.3, prefix, E=E, hold=hold, obstacle=obstacle, **bodies)


@pytest.mark.parametrize(("base", "rel"), [(1e7, 2e-4), (1e8, 2e-4), ("rigid", 2e-7)])
def test_incline(base, rel):
    """NAFEMS CGS-4, tan a = 0.1, mu = 0.3: F/G = (tan a + mu)/(1 - mu tan a) = 0.412371.

    As the block widens, its nodes do not slip quite along the slope: less than 1e-7.
    """
    slope, mu = 0.1, 0.3
    if base == "rigid":
        held = [(faces_of_base, k) for k in range(3)]
        model = on_base("incline_rigid_", 1e7, (2, 1, 1), held)
    else:
        model = on_base(f"incline_{base:g}_", base)
    # The block is dragged down the plane's x axis by its top: forces turned to the slope.
    model.move(0.0, 0.0, -1e-3)
    model.problem.solve()
    model.move(0.2, 0.0, -1e-3)
    report = model.problem.solve()
    assert report.contacts[0].stick + report.contacts[0].open == 0
    tangential, _, normal = report.contacts[0].force
    a = np.arctan(slope)
    push = np.array([np.cos(a), -np.sin(a)])  # horizontal, in axes along and normal to the plane
    weight = np.array([-np.sin(a), -np.cos(a)])
    F, G = np.linalg.solve(np.column_stack([push, weight]), [-tangential, -normal])
    assert F / G == pytest.approx((slope + mu) / (1.0 - mu * slope), rel=rel)


def test_a_held_base_is_a_rigid_plane():
    """The contact element on flat faces against the kinematics of a rigid plane in UFL."""
    held = [(faces_of_base, k) for k in range(3)]
    element = on_base("held_base_", 1e3, (2, 1, 1), held)
    plane = on_base("rigid_plane_", 1e3, (2, 1, 1), held, ff.RigidPlane((0, 0, 0.5), (0, 0, 1)))
    for way in ((0.0, 0.0, -0.01), (0.005, 0.0, -0.02), (0.1, 0.05, -0.02), (0.05, 0.0, -0.01)):
        results = []
        for model in (element, plane):
            model.move(*way)
            results.append((model.problem.solve().contacts[0], gathered(model.problem)))
        (one, (_, c, u)), (other, (_, e, w)) = results
        assert (one.open, one.stick, one.slip) == (other.open, other.stick, other.slip)
        assert u == pytest.approx(w, abs=1e-11)
        assert c == pytest.approx(e, abs=1e-9 * np.max(abs(e)))


@pytest.mark.parametrize(("way", "slides"), [(0.5, False), (3.0, True)])
def test_threshold_of_sliding(way, slides):
    """A block dragged by its top on a deformable base: below mu N it holds, then slides at mu N."""
    mu, G, depth = 0.3, 1e3 / 2.0, 0.01
    model = stack(mu, f"threshold_{way}_", nu=0.0, E=(1e3, 1e6))
    model.move(0.0, 0.0, -depth)
    normal = model.problem.solve().contacts[0].force[2]
    model.move(way * mu * normal / G, 0.0, -depth)
    states = model.problem.solve().contacts[0]
    friction = abs(states.force[0]) / states.force[2]
    if slides:
        assert (states.open, states.stick) == (0, 0)
        assert friction == pytest.approx(mu, rel=1e-3)  # of a base that is not quite flat
    else:
        assert states.stick > 0
        assert friction < 0.9 * mu


@pytest.mark.parametrize("law", [ff.Frictionless(), ff.Coulomb(0.0), ff.Coulomb(0.3)])
def test_the_stick_predictor_holds_only_what_has_friction(law):
    """What slides freely on one thing and sticks to another would be held twice."""
    model = stack(law, f"predictor_{law}_".replace(" ", ""))
    model.move(0.01, 0.0, -0.02)
    assert model.problem.run(model.problem.stick, 1e-8, max_it=30).converged
    tangential = abs(model.contact.nodal().c[:, 1:])
    held = law == ff.Coulomb(0.3)
    assert np.max(tangential) > 1.0 if held else np.max(tangential) < 1e-12
