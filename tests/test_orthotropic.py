"""Orthotropic friction: on the ellipse, the slip normal to it."""

import numpy as np
import pytest

import fenicsx_friction as ff
from dragged import DEPTH, PRESSURE, dragged


def orthotropic_force(mu, angle, drag):
    """Return the force of unit pressure on a body that slides along ``drag``."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    M = turn @ np.diag(mu) @ turn.T
    return -M @ M @ drag / np.linalg.norm(M @ drag)


@pytest.mark.mpi
@pytest.mark.parametrize("angle", [0.4, 2.5])
def test_orthotropic_friction_is_on_the_ellipse_and_slip_normal_to_it(angle):
    mu, drag = (0.1, 0.25), np.array([0.8, 0.6])
    axis = (3.0 * np.cos(angle), 3.0 * np.sin(angle), 0.7)  # only its tangential part counts
    model = dragged(lambda m, s: ff.OrthotropicCoulomb(mu, axis), "ortho_", dim=3)
    for length in (0.05, 0.3, 1.5, 6.0, 20.0):  # the slip tends to the direction of the drag
        report = model.move(*(length * drag), -DEPTH)
        assert report.certified
    expected = PRESSURE * orthotropic_force(mu, angle, drag)
    force = np.array(report.contacts[0].force)
    assert report.contacts[0].slip == 9
    assert force == pytest.approx([*expected, PRESSURE], abs=1e-7 * PRESSURE)
    # Node by node, against the slip of the node itself; the frame of a horizontal plane is known.
    _, pressure, traction, _, slip = model.nodes()
    frames = model.contact.pairing.frames()
    e1 = np.concatenate(model.problem.comm.allgather(frames[:, 1]))
    e2 = np.cross([0.0, 0.0, 1.0], e1)
    vectors = traction[:, :1] * e1 + traction[:, 1:] * e2
    for p, vector, s in zip(pressure, vectors, slip, strict=True):
        assert vector[:2] == pytest.approx(
            p * orthotropic_force(mu, angle, s[:2]), abs=1e-9 * PRESSURE
        )


def test_orthotropic_with_equal_coefficients_is_coulomb():
    forces = []
    for law in (ff.Coulomb(0.3), ff.OrthotropicCoulomb((0.3, 0.3), (0.3, 1.0, 0.0))):
        model = dragged(lambda m, s, law=law: law, "equal_", dim=3)
        forces.append(
            [model.move(*d, -DEPTH).contacts[0].force for d in ((0.004, 0.0), (0.01, 0.02))]
        )
    assert np.array(forces[1]) == pytest.approx(np.array(forces[0]), rel=1e-9, abs=1e-9)


def test_orthotropic_friction_is_refused_where_it_has_no_meaning():
    for mu, axis in (((0.0, 0.1), (1, 0, 0)), ((0.1, 0.2), (0, 0, 0)), ((0.1, 0.2), (1, 0))):
        with pytest.raises(ff.ContactInputError):
            ff.OrthotropicCoulomb(mu, axis)
