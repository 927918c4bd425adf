# SPDX-License-Identifier: MIT
"""Rotations, in UFL and in numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy
import ufl
from ufl.core.expr import Expr

Array = npt.NDArray[np.floating]


def turned_in_plane(angle: Expr) -> Expr:
    """Return the matrix of a counter-clockwise rotation, less the identity."""
    versine, s = 2.0 * ufl.sin(angle / 2.0) ** 2, ufl.sin(angle)
    return ufl.as_matrix([[-versine, -s], [s, -versine]])


def cross_matrix(a: Expr) -> Expr:
    """Return the matrix of the cross product with a vector."""
    return ufl.as_matrix([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def nearest(vector: Array, given: Array, held: npt.NDArray[np.bool_]) -> Array:
    """Return the rotation vector of the same rotation whose held components are nearest to given.

    More turns about its axis are the same rotation.
    """
    angle = np.linalg.norm(vector)
    if angle == 0.0:
        return vector.copy()
    turns = round(float(np.linalg.norm(given)) / (2.0 * np.pi)) + 1
    ways = [vector * (1.0 + 2.0 * np.pi * k / angle) for k in range(-turns, turns + 1)]
    return min(ways, key=lambda way: float(np.linalg.norm((way - given)[held])))


def cayley_vector(old: Array, given: Array, held: npt.NDArray[np.bool_]) -> Array:
    """Return the vector of Cayley's rotation that leads from an old one to given components.

    Args:
        old: Matrix of the old rotation; its other components stay.
        given: Rotation vector of the whole.
        held: Which components are given.
    """
    start = as_rotation(old)
    wanted = nearest(start.as_rotvec(), given, held)
    wanted[held] = given[held]
    way = (scipy.spatial.transform.Rotation.from_rotvec(wanted) * start.inv()).as_rotvec()
    angle = float(np.linalg.norm(way))
    return np.asarray(way * (2.0 * np.tan(angle / 2.0) / angle if angle > 0.0 else 1.0))


def nearest_rotation(products: Array) -> Array:
    """Return the rotation that brings some arms nearest to others, in least squares.

    Args:
        products: Sum of the products of arms after with arms before, (d, d).

    Source: W. Kabsch, A solution for the best rotation to relate two sets of vectors (1976).
    """
    left, _, right = np.linalg.svd(products)
    left[:, -1] *= np.sign(np.linalg.det(left @ right))  # no reflection
    return np.asarray(left @ right)


def angles(rotation: Array) -> Array:
    """Return the angle of a rotation in 2D, its rotation vector in 3D (rad)."""
    if len(rotation) == 2:
        return np.arctan2(rotation[1, :1], rotation[0, :1])
    return np.asarray(as_rotation(rotation).as_rotvec())


def as_rotation(matrix: Array) -> Any:
    """Return SciPy's rotation of a matrix, made orthonormal."""
    return scipy.spatial.transform.Rotation.from_matrix(matrix)


def turned_by(angle: float) -> Array:
    """Return the matrix of a rotation in the plane, less the identity."""
    versine, s = 2.0 * np.sin(angle / 2.0) ** 2, np.sin(angle)
    return np.array([[-versine, -s], [s, -versine]])
