"""The contact frame: well defined for every normal and every set of prescribed directions."""

from itertools import product

import numpy as np
import pytest

from fenicsx_friction.frame import choose_hints, pinned_directions

AXES = np.eye(3)
OBLIQUE = np.array([[1.0, 2.0, 3.0], [1.0, -1.0, 0.0], [0.1, 0.0, -1.0]])
NORMALS = np.vstack([AXES, -AXES, OBLIQUE / np.linalg.norm(OBLIQUE, axis=1)[:, None]])


@pytest.mark.parametrize("fixed", list(product([False, True], repeat=3)))
def test_first_tangent_exists_and_prescribed_directions_are_pinned(fixed):
    fixed = np.tile(fixed, (len(NORMALS), 1))
    hints = choose_hints(NORMALS, fixed)
    tangents = hints - np.sum(hints * NORMALS, axis=1)[:, None] * NORMALS
    assert np.all(np.linalg.norm(tangents, axis=1) > 0.05)
    pinned = pinned_directions(NORMALS, fixed)
    held = np.all(fixed | (abs(NORMALS) < 1e-12), axis=1)  # the normal lies in what is prescribed
    assert np.array_equal(pinned[:, 0], held)
    assert np.all(pinned[held])
    free = ~held
    number = fixed.sum(axis=1)
    assert np.array_equal(pinned[free, 1:].sum(axis=1), np.minimum(number[free], 2))
    one = free & (number == 1)
    assert np.array_equal(hints[one], fixed[one].astype(float))
