# SPDX-License-Identifier: MIT
"""Test functions of slips: dual to the hats of the vertices where faces are covered.

Averages with the hats themselves couple neighbours: where slip begins, the pattern of errors that
average to zero has alternating signs. Dual functions (Wohlmuth, SIAM J. Numer. Anal. 38, 2000)
have none: the average of a linear function is its value at the vertex. Their integrals are those of
the hats, positive, and their sum is one. They are made from what is covered of a face. Where that
is a small part they are steep: there they give way to the hats.

They are negative in places. A slip has no sign that this could spoil. A gap has: its averages must
not be negative where nothing overlaps, so they are those with the hats.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..surfaces.lagrange_faces import LagrangeFaces
from .mortar_groups import adder, summed
from .segments import Segments

Array = npt.NDArray[np.floating]
#: Covered parts of a face between which hats give way to dual functions.
HATS, DUAL = 0.5, 0.9


def dual_hats(faces: LagrangeFaces, points: Segments, hats: Array) -> Array:
    """Return the test functions of the vertices of each point's face: (points, vertices).

    Args:
        faces: The faces.
        points: The points.
        hats: The hats of the vertices there.
    """
    face = faces.face_of(points.patch)
    number, corners = len(faces.dofs), hats.shape[1]
    covered = np.bincount(face, points.weight, minlength=number)
    share = np.clip((covered / faces.areas - HATS) / (DUAL - HATS), 0.0, 1.0)
    share *= share * (3.0 - 2.0 * share)
    products = np.einsum("p,pi,pj->pij", points.weight, hats, hats)
    mass = summed(adder(face, number), products)
    some = share > 0.0
    change = np.tile(np.eye(corners), (number, 1, 1))
    integrals = mass[some].sum(axis=2)
    dual = integrals[:, :, None] * np.linalg.inv(mass[some])
    change[some] += share[some, None, None] * (dual - np.eye(corners))
    return np.einsum("pij,pj->pi", change[face], hats)


def weights_of(faces: LagrangeFaces, points: Segments) -> Array:
    """Return hats and dual functions at points, times their area: (2, points, nodes)."""
    hats = faces.hats(points.xi)
    functions = np.stack([hats, dual_hats(faces, points, hats)])
    return np.asarray(functions * points.weight[:, None])
