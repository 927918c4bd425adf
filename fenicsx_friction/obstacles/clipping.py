# SPDX-License-Identifier: MIT
"""The common part of flat faces: of intervals on a line, of convex polygons in a plane."""

from __future__ import annotations

import basix
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]
#: Parts smaller than this fraction of a face are rounding.
EMPTY = 1e-14


def common_points(first: Array, second: Array, degree: int) -> tuple[Indices, Array, Array]:
    """Return points of a quadrature rule on the common parts of pairs of faces.

    Args:
        first: Corners of the faces, in turn: (pairs, corners, d - 1).
        second: Corners of those that they are paired with.
        degree: Of the polynomials that are integrated exactly.

    Returns:
        The pair of each point, in ascending order; its place; its weight.
    """
    cell = basix.CellType.interval if first.shape[2] == 1 else basix.CellType.triangle
    rule = [np.asarray(a) for a in basix.make_quadrature(cell, degree)]
    simplices = _intervals if first.shape[2] == 1 else _triangles
    pair, corners = simplices(first, second)
    edges = corners[:, 1:] - corners[:, :1]
    size = abs(np.linalg.det(edges))
    points = corners[:, :1] + rule[0] @ edges
    number = len(rule[1])
    return (
        np.repeat(pair, number),
        points.reshape(-1, first.shape[2]),
        np.outer(size, rule[1]).ravel(),
    )


def sizes(faces: Array) -> Array:
    """Return lengths or areas of faces, positive if their corners turn counter-clockwise."""
    if faces.shape[2] == 1:
        return np.asarray(faces[:, 1, 0] - faces[:, 0, 0])
    x, y = faces[:, :, 0], faces[:, :, 1]
    return np.asarray(np.sum(x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1), axis=1) / 2.0)


def _intervals(first: Array, second: Array) -> tuple[Indices, Array]:
    """Return the common parts of intervals."""
    a, b = np.sort(first[:, :, 0], axis=1), np.sort(second[:, :, 0], axis=1)
    low, high = np.maximum(a[:, 0], b[:, 0]), np.minimum(a[:, 1], b[:, 1])
    pair = np.flatnonzero(high - low > EMPTY * (a[:, 1] - a[:, 0]))
    return pair, np.stack([low, high], axis=1)[pair][:, :, None]


def _triangles(first: Array, second: Array) -> tuple[Indices, Array]:
    """Return the common parts of polygons, cut into triangles from their centers of area.

    So the points of a quadrature rule move continuously as the polygons do: where a corner appears
    or goes, its triangle is empty.
    """
    polygon, number = clipped(_turned(first), _turned(second))
    pair, i = np.nonzero(np.arange(polygon.shape[1]) < number[:, None])
    j = np.where(i + 1 < number[pair], i + 1, 0)
    a, b, start = polygon[pair, i], polygon[pair, j], polygon[:, 0]
    twice = cross(a - start[pair], b - start[pair])
    area = np.bincount(pair, twice, minlength=len(first))
    middle = (a + b - 2.0 * start[pair]) / 3.0 * twice[:, None]
    shift = np.stack([np.bincount(pair, m, minlength=len(first)) for m in middle.T], axis=1)
    center = start + shift / np.where(area > 0.0, area, 1.0)[:, None]
    corners = np.stack([center[pair], a, b], axis=1)
    large = sizes(corners) > EMPTY * abs(sizes(first))[pair]
    return pair[large], corners[large]


def clipped(subject: Array, clip: Array) -> tuple[Array, Indices]:
    """Clip convex polygons by convex polygons, after Sutherland and Hodgman.

    Args:
        subject: Corners of the polygons, counter-clockwise: (pairs, corners, 2).
        clip: Corners of those that they are clipped by, counter-clockwise.

    Returns:
        Corners, padded; and their numbers, zero where there is nothing in common.
    """
    polygon, number = subject, np.full(len(subject), subject.shape[1])
    for a, b in zip(
        clip.transpose(1, 0, 2), np.roll(clip, -1, axis=1).transpose(1, 0, 2), strict=True
    ):
        polygon, number = _cut(polygon, number, a, b - a)
    return polygon, np.where(number < 3, 0, number)


def _cut(polygon: Array, number: Indices, a: Array, edge: Array) -> tuple[Array, Indices]:
    """Keep what is left of a line through ``a``; with as much room as the largest rest needs.

    Edges that coincide up to rounding may cross the line more than twice, and leave more corners
    than a convex polygon has.
    """
    pairs, corners, _ = polygon.shape
    place = np.arange(corners)
    there = place < number[:, None]
    following = np.where(place + 1 < number[:, None], place + 1, 0)
    ahead = np.take_along_axis(polygon, following[:, :, None], axis=1)
    left = cross(edge[:, None], polygon - a[:, None])
    left_ahead = np.take_along_axis(left, following, axis=1)
    inside, inside_ahead = left >= 0.0, left_ahead >= 0.0
    crosses = there & (inside != inside_ahead)
    share = left / np.where(crosses, left - left_ahead, 1.0)
    between = polygon + share[:, :, None] * (ahead - polygon)
    # Each corner that stays is followed by the point where the boundary crosses the line.
    points = np.stack([polygon, between], axis=2).reshape(pairs, 2 * corners, 2)
    kept = np.stack([there & inside, crosses], axis=2).reshape(pairs, 2 * corners)
    number = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : max(int(number.max(initial=0)), 1)]
    return np.take_along_axis(points, order[:, :, None], axis=1), number


def _turned(polygons: Array) -> Array:
    """Return polygons with their corners counter-clockwise."""
    clockwise = sizes(polygons) < 0.0
    return np.where(clockwise[:, None, None], polygons[:, ::-1], polygons)


def cross(a: Array, b: Array) -> Array:
    """Return the third component of the product of vectors in the plane."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
