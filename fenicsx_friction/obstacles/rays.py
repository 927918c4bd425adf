# SPDX-License-Identifier: MIT
"""Rays: where a line from a point of one surface meets a face of another."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..surfaces.lagrange_faces import LagrangeFaces

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]

#: Newton iterations, and the step in the face's coordinates after which the error, its square, is
#: rounding.
MAX_IT, TOLERANCE = 25, 1e-8


def cast(
    faces: LagrangeFaces,
    x: Array,
    face: Indices,
    start: Array,
    along: Array,
    eta: Array | None = None,
) -> tuple[Array, Array]:
    """Find where lines meet faces, which extend beyond their edges.

    Looking along the line, a face is a map of its coordinates to a plane, in which the line is the
    origin.

    Args:
        faces: The faces.
        x: Positions of their dofs (m).
        face: The face of each line.
        start: Points of the lines (m).
        along: Their unit directions.
        eta: Where to begin.

    Returns:
        Places on the faces; and how far before them the points are, against the direction (m). Not
        a number where the search fails.
    """
    polynomials, d = faces.polynomials, faces.d
    # The last axis is that of the lines: all products are those of long rows.
    corners = np.take(x.T, np.take(faces.dofs.T, face, axis=1), axis=1) - start.T[:, None]
    seen = np.einsum("dmn,adn->amn", corners, _axes(along.T))
    place = np.tile(faces.centers.mean(axis=0), (len(face), 1)) if eta is None else eta.copy()
    with np.errstate(all="ignore"):
        _go_to_origin(place, faces, polynomials.coefficients[:, None] @ seen[: d - 1])
        gap = -np.einsum("kn,kn->n", polynomials(place.T), polynomials.coefficients[0] @ seen[-1])
    return place, gap


def _go_to_origin(place: Array, faces: LagrangeFaces, table: Array) -> None:
    """Find the places whose images are the origin, not a number where this fails.

    Args:
        place: Where to begin; becomes the result.
        faces: The faces.
        table: Coefficients of the images, then of their derivatives along each coordinate of the
            faces: (d, d - 1, monomials, lines).
    """
    number = len(place)
    left, at, before = np.arange(number), place.T, np.zeros(number)
    for _ in range(MAX_IT):
        step = _step(np.einsum("kn,takn->tan", faces.polynomials(at), table))
        moved = np.max(abs(step), axis=0)
        if faces.affine:
            moved *= 0.0  # one step is exact
        else:
            np.clip(step, -1.0, 1.0, out=step)
        at = at + step
        place[left if len(left) < number else slice(None)] = at.T
        # Steps fall with their squares: the next one is known from two.
        done = (moved < TOLERANCE) | (moved**3 < (before * TOLERANCE) ** 2)
        again = ~(np.isnan(moved) | done)
        place[left[~(done | again)]] = np.nan
        left = left[again]
        if not len(left):
            return
        if not np.all(again):
            at, table = at[:, again], table.compress(again, axis=-1)
        before = np.minimum(moved[again], 1.0)  # as far as it went
    place[left] = np.nan


def _axes(along: Array) -> Array:
    """Return unit vectors across directions (d, lines), and these: (d, d, lines).

    In 3D after Duff et al., Journal of Computer Graphics Techniques 6 (2017).
    """
    if len(along) == 2:
        return np.array([[-along[1], along[0]], along])
    x, y, z = along
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = [1.0 + sign * x * x * a, sign * b, -sign * x]
    return np.array([first, [b, sign + y * y * a, -y], along])


def _step(values: Array) -> Array:
    """Return Newton steps to the origin: (d - 1, lines).

    Args:
        values: Places in the plane, then their derivatives along each coordinate of the face:
            (d, d - 1, lines).
    """
    if len(values) == 2:
        return -values[0] / values[1]
    (a, b), (a_1, b_1), (a_2, b_2) = values
    area = a_1 * b_2 - b_1 * a_2
    return np.array([b * a_2 - a * b_2, a * b_1 - b * a_1]) / area


def duals(tangents: Array, along: Array) -> Array:
    """Return the dual vectors of tangents and a direction: (points, d, d)."""
    rows = [*tangents.transpose(1, 2, 0), along.T]  # long rows again
    if len(rows) == 2:
        found = np.array([[rows[1][1], -rows[1][0]], [-rows[0][1], rows[0][0]]])
    else:
        found = np.array([_cross(rows[k - 2], rows[k - 1]) for k in range(3)])
    found /= np.einsum("dn,dn->n", found[0], rows[0])
    return np.ascontiguousarray(found.transpose(2, 0, 1))


def _cross(a: Array, b: Array) -> Array:
    """Return products of vectors in 3D: (3, n)."""
    return np.array([a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)])
