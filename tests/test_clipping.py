"""Faces that fall on each other, and errors of one rank in the search."""

import numpy as np
import pytest

from bodies import stack
from fenicsx_friction.obstacles import mortar
from fenicsx_friction.obstacles.clipping import clipped, common_points


@pytest.mark.serial
@pytest.mark.parametrize("noise", [0.0, 1e-17, 1e-16, 1e-15, 1e-12])
@pytest.mark.parametrize("corners", [3, 4])
def test_faces_that_coincide_up_to_rounding_have_all_in_common(corners, noise):
    """Some of their edges cross a line more than twice: more corners than a convex part has."""
    rng = np.random.default_rng(0)
    reference = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])[:corners]
    angle, number = rng.uniform(0.0, 6.28, 50_000), 50_000
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    first = reference @ turn.transpose(2, 0, 1) + rng.uniform(-1.0, 1.0, (number, 1, 2))
    second = first + noise * rng.standard_normal(first.shape)
    pair, _, weight = common_points(first, second, 2)
    area = np.bincount(pair, weight, minlength=number)
    assert np.allclose(area, 0.5 * (corners - 2), rtol=0.0, atol=1e-11)
    if (corners, noise) == (3, 1e-16):  # else the test would show nothing
        assert np.max(clipped(first, second)[1]) > 2 * corners


@pytest.mark.mpi
def test_an_error_of_one_rank_in_the_search_is_one_of_all(monkeypatch):
    model = stack(
        0.3,
        "one_rank_",
        cell="quadrilateral",
        method="mortar",
        upper=(4, 2),
        lower=(6, 2),
        top=((0.0, 1.0), (1.0, 2.0)),
        base=((0.0, 0.0), (1.0, 1.0)),
    )
    model.move(0.0, -0.01)
    model.problem.solve()
    before = model.problem.u.x.array.copy()

    def broken(*arguments):
        if model.problem.comm.rank == model.problem.comm.size - 1:
            raise MemoryError("no room for segments")
        return exact(*arguments)

    exact = mortar.find_segments
    monkeypatch.setattr(mortar, "find_segments", broken)
    model.move(0.01, -0.02)
    with pytest.raises(MemoryError, match="no room"):
        model.problem.solve()
    monkeypatch.undo()
    assert np.array_equal(model.problem.u.x.array, before)
    assert model.problem.solve().certified
