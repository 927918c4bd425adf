"""Surfaces of rigid tools, as points and faces."""

import numpy as np
from scipy.spatial import ConvexHull, Delaunay


def uneven_plane(d, *, half=1.5, number=9, seed=0):
    """Return the plane x_d = 0 in uneven faces that look up, a square (or an interval)."""
    rng = np.random.default_rng(seed)
    if d == 2:
        x = np.sort(np.concatenate([[-half, half], rng.uniform(-half, half, number)]))
        order = np.arange(len(x))[::-1]
        return np.column_stack([x, 0.0 * x]), np.column_stack([order[:-1], order[1:]])
    side = np.linspace(-half, half, number)
    x, y = (a.ravel() for a in np.meshgrid(side, side))
    inner = (abs(x) < half) & (abs(y) < half)
    shift = rng.uniform(-0.4, 0.4, (2, len(x))) * (side[1] - side[0]) * inner
    flat = np.column_stack([x, y]) + shift.T
    faces = Delaunay(flat).simplices
    a, b, c = (flat[faces[:, i]] for i in range(3))
    up = np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2] > 0
    faces = np.where(up[:, None], faces, faces[:, ::-1])
    return np.column_stack([flat, 0.0 * x]), faces


def polygon(corners):
    """Return a closed polygon, outwards if its corners go against the clock."""
    order = np.arange(len(corners))
    return np.asarray(corners), np.column_stack([order, (order + 1) % len(corners)])


def ball(d, number, radius=1.0, center=0.0):
    """Return a sphere of some ``number`` of points (a circle of so many segments), outwards."""
    if d == 2:
        angle = 2.0 * np.pi * (np.arange(number) + 0.37) / number
        points = np.column_stack([np.cos(angle), np.sin(angle)])
        return polygon(center + radius * points)
    k = np.arange(number) + 0.5
    polar, around = np.arccos(1.0 - 2.0 * k / number), np.pi * (1.0 + 5.0**0.5) * k
    points = np.column_stack(
        [np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)]
    )
    faces = ConvexHull(points).simplices
    a, b, c = (points[faces[:, i]] for i in range(3))
    out = np.sum(np.cross(b - a, c - a) * a, axis=1) > 0.0
    return center + radius * points, np.where(out[:, None], faces, faces[:, ::-1])


def box(low, high, *, quadrilaterals=True):
    """Return a box of six quadrilaterals in cyclic order, outwards (a rectangle in 2D)."""
    if len(low) == 2:
        (a, b), (c, e) = low, high
        return np.array([[a, b], [c, b], [c, e], [a, e]]), np.array(
            [[0, 1], [1, 2], [2, 3], [3, 0]]
        )
    corners = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)])
    points = np.where(corners, high, low).astype(float)
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return points, np.array(faces)
