"""Candidates of the search: exactly the pairs that their definition names, without a tree."""

import numpy as np
import pytest

from fenicsx_friction.obstacles import candidates as module
from fenicsx_friction.obstacles.candidates import FACING, TIE, Views, candidates
from fenicsx_friction.surfaces.face_cells import FACE_CELLS
from fenicsx_friction.surfaces.faces import Faces


def soup(rng, cell, number, d):
    """Return loose faces of many sizes, anywhere and turned anyhow."""
    corners = rng.uniform(-1.0, 1.0, (number, 1, d)) + 10.0 ** rng.uniform(
        -3.0, -0.5, (number, 1, 1)
    ) * rng.normal(size=(number, d, d))
    return Faces(cell, corners.reshape(-1, d), np.arange(number * d).reshape(number, d))


def unit_normals(corners):
    """Return normals by cross products, on the side where the package has them."""
    a = corners[:, 1] - corners[:, 0]
    if corners.shape[2] == 2:
        normal = np.column_stack([a[:, 1], -a[:, 0]])
    else:
        normal = np.cross(a, corners[:, 2] - corners[:, 0])
    return normal / np.linalg.norm(normal, axis=1)[:, None]


def by_definition(faces, x, directions, reach, last, may_meet):
    """Return a mask (nodes, faces) of the candidates."""
    corners = faces.X[faces.faces]
    center = corners.mean(axis=1)
    radius = np.max(np.linalg.norm(corners - center[:, None], axis=2), axis=1)
    away = np.linalg.norm(x[:, None] - center, axis=2)
    allowed = (directions @ unit_normals(corners).T < FACING) & may_meet
    allowed &= away <= reach + np.max(radius)
    nearest = np.min(np.where(allowed, away, np.inf), axis=1)
    possible = away - radius <= nearest[:, None] * (1.0 + TIE)
    return allowed & (possible | (np.arange(len(corners)) == last[:, None]))


@pytest.mark.parametrize("number", [1, 5, 300])
@pytest.mark.parametrize("reach", [1e-3, 0.2, 5.0])
@pytest.mark.parametrize("d", [2, 3])
def test_candidates_are_those_of_the_definition(d, reach, number, monkeypatch):
    monkeypatch.setattr(module, "BLOCK", 50)
    rng = np.random.default_rng(number)
    faces = soup(rng, FACE_CELLS[{2: "interval", 3: "triangle"}[d]], number, d)
    x, directions = rng.uniform(-1.5, 1.5, (120, d)), rng.normal(size=(120, d))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    last, may_meet = rng.integers(-1, number, 120), rng.uniform(size=(120, number)) < 0.7
    views = Views(faces, faces.X, x, directions, may_meet=lambda i, f: may_meet[i, f])
    i, f = candidates(views, reach, last)
    found = np.zeros((len(x), number), dtype=int)
    np.add.at(found, (i, f), 1)
    wanted = by_definition(faces, x, directions, reach, last, may_meet)
    assert np.array_equal(found, wanted)
    assert number < 300 or reach < 1.0 or np.all(np.any(wanted, axis=1))


def test_without_nodes_there_are_none():
    faces = soup(np.random.default_rng(1), FACE_CELLS["triangle"], 20, 3)
    views = Views(faces, faces.X, *np.zeros((2, 0, 3)))
    i, f = candidates(views, 1.0, np.zeros(0, dtype=np.int64))
    assert len(i) == len(f) == 0
