# SPDX-License-Identifier: MIT
"""Segments: which parts of two surfaces face each other, and quadrature points on them.

Each patch of the secondary surface looks along its normal at the patches of the primary one. What
it sees of each is a segment: both are projected on its plane and clipped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from ..surfaces.face_tables import normals_of
from .candidates import balls, flat
from .clipping import common_points, sizes
from .facing import Facing, Positions
from .planes import Planes, outward_normals
from .rays import cast

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

#: Cosine of the normals of two patches above which one may press on the other. The sides of a
#: block that is a bit tilted do not see what it stands on.
FACING = 0.5
#: A patch that sees primary patches whose distances differ by this fraction of its size may have
#: one before another.
DEEPER = 0.1
#: Degree of the quadrature beyond that of the shape functions on quadrilaterals: on those that are
#: no parallelograms these are no polynomials in the plane. Pressures of a patch test on coarse
#: skewed faces are 2e-4 off with 0, 5e-7 with 2, which takes twice the points.
MORE = 2
#: A patch that sees more than this times itself has one primary patch before another.
TWICE = 1.0 + 1e-6


@dataclass(frozen=True)
class Segments:
    """Points on the segments, sorted by patch and primary face.

    Attributes:
        patch: The patch of the secondary surface.
        xi: Place on its face.
        weight: Part of the reference area (m²; m in 2D).
        face: The face of the primary surface.
        eta: Place on it.
    """

    patch: Indices
    xi: Array
    weight: Array
    face: Indices
    eta: Array

    def take(self, rows: npt.NDArray) -> Segments:
        """Return some points."""
        parts = (self.patch, self.xi, self.weight, self.face, self.eta)
        return Segments(*(part[rows] for part in parts))


def find_segments(facing: Facing, x: Positions, reach: float, wanted: Mask) -> Segments:
    """Return the segments of some patches.

    Args:
        facing: The two surfaces.
        x: Positions of the dofs of both (m).
        reach: Parts farther from each other than this (m), or deeper, do not meet.
        wanted: The patches of the secondary surface.
    """
    sight = _Sight(facing, x)
    sight.pair(wanted, reach)
    degree = facing.secondary.degree + facing.primary.degree
    bilinear = facing.secondary.nodes.shape[1] == 4
    pair, flat, weight = sight.clip(degree + MORE if bilinear else degree)
    eta, near = sight.look(pair, flat, weight, reach)
    pair = pair[near]
    patch, face = sight.patch[pair], sight.face[pair]
    xi, share = sight.places(patch, flat[near])
    return Segments(patch, xi, weight[near] * share, face, eta[near])


class _Sight:
    """What the patches of the secondary surface see of the primary one.

    Attributes:
        patch: Patch of the secondary surface of each pair, ascending.
        meets: Patch of the primary surface.
    """

    def __init__(self, facing: Facing, x: Positions) -> None:
        self._secondary, self._primary, self._x = facing.secondary, facing.primary, x
        self._planes = Planes.of(facing.secondary, x[0])
        self._own = facing.secondary.corner_positions(x[0])
        self._other = facing.primary.corner_positions(x[1])

    @property
    def face(self) -> Indices:
        """Face of the primary surface of each pair."""
        return self._primary.face_of(self.meets)

    def pair(self, wanted: Mask, reach: float) -> None:
        """Pair patches that face each other nearby."""
        planes, (own, other) = self._planes, (balls(c) for c in (self._own, self._other))
        mine = np.flatnonzero(wanted)
        # Within reach across the plane, and within both balls along it.
        both = own[1][mine] + np.max(other[1])
        radius = np.hypot(reach + both, both)
        tree = scipy.spatial.cKDTree(other[0])
        i, meets = flat(tree.query_ball_point(own[0][mine], radius, return_sorted=True))
        patch = mine[i]
        outward = outward_normals(self._primary, self._x[1])
        facing = np.sum(planes.normal[patch] * outward[meets], axis=1) > FACING
        patch, meets = patch[facing], meets[facing]
        both, center = own[1][patch] + other[1][meets], other[0][meets]
        good = np.linalg.norm(planes.flat(patch, center), axis=1) <= both
        good &= abs(planes.heights(patch, center)) <= reach + both
        self.patch, self.meets = patch[good], meets[good]
        first, second = self._flat_corners()
        low, high = np.min(first, axis=1), np.max(first, axis=1)
        other_low, other_high = np.min(second, axis=1), np.max(second, axis=1)
        good = np.all((low <= other_high) & (other_low <= high), axis=1)
        self.patch, self.meets = self.patch[good], self.meets[good]

    def _flat_corners(self) -> tuple[Array, Array]:
        """Return the corners of both patches of each pair in the plane of the first."""
        first, second = self._own[self.patch], self._other[self.meets]
        return self._planes.flat(self.patch, first), self._planes.flat(self.patch, second)

    def clip(self, degree: int) -> tuple[Indices, Array, Array]:
        """Return the pair, the place in the plane, and the weight (m²) of quadrature points."""
        first, second = self._flat_corners()
        return common_points(first, second, degree)

    def look(self, pair: Indices, flat: Array, weight: Array, reach: float) -> tuple[Array, Mask]:
        """Return the places on faces that points see, and which are seen nearby."""
        patch, number = self.patch[pair], len(self.patch)
        start = self._planes.points(patch, flat)
        eta, height = cast(
            self._primary, self._x[1], self.face[pair], start, self._planes.normal[patch]
        )
        found = np.bincount(pair, weight, minlength=number)
        mean = np.bincount(pair, weight * height, minlength=number)
        good = (found > 0.0) & (abs(mean) <= reach * found)
        own = self._planes.flat(np.arange(len(self._own)), self._own)
        seen = np.bincount(self.patch, found * good, minlength=len(own))
        crowded, near = seen > TWICE * abs(sizes(own)), good[pair]
        crowded |= self._spread(mean / np.where(found > 0.0, found, 1.0), good, abs(sizes(own)))
        if np.any(crowded):
            doubtful = np.flatnonzero(near & crowded[patch])
            behind = self._behind(doubtful, pair, start, abs(height), good)
            near[doubtful[behind]] = False
        return eta, near

    def _spread(self, height: Array, good: Mask, size: Array) -> Mask:
        """Tell which patches see others at distances that differ much."""
        ends = []
        for sign in (1.0, -1.0):
            end = np.full(len(size), -np.inf)
            np.maximum.at(end, self.patch[good], sign * height[good])
            ends.append(end)
        length = size ** (1.0 / (self._secondary.d - 1))
        return np.asarray(ends[0] + ends[1] > DEEPER * length)

    def _behind(
        self, points: Indices, pair: Indices, start: Array, height: Array, good: Mask
    ) -> Mask:
        """Tell which points see a nearer face of another pair of their patch."""
        rivals, number = ranges(self.patch, self.patch[pair[points]])
        point = np.repeat(np.arange(len(points)), number)
        others = (rivals != pair[points][point]) & good[rivals]
        rivals, point = rivals[others], point[others]
        along = self._planes.normal[self.patch[rivals]]
        eta, found = cast(self._primary, self._x[1], self.face[rivals], start[points[point]], along)
        nearer = (abs(found) < height[points[point]]) & self._primary.inside(eta)
        behind = np.zeros(len(points), dtype=bool)
        behind[point[nearer]] = True
        return behind

    def places(self, patch: Indices, flat: Array) -> tuple[Array, Array]:
        """Return places on the own faces, and their reference area over the area in the plane."""
        faces, x, normal = self._secondary, self._x[0], self._planes.normal[patch]
        face, begin = faces.face_of(patch), faces.centers[patch % len(faces.corners)]
        xi, _ = cast(faces, x, face, self._planes.points(patch, flat), normal, begin)
        slopes = faces.table(xi)[:, 1:]
        area, now = (normals_of(slopes @ faces.at_dofs(y, face)) for y in (faces.X, x))
        return xi, np.linalg.norm(area, axis=1) / abs(np.sum(now * normal, axis=1))


def ranges(keys: Indices, wanted: Indices) -> tuple[Indices, Indices]:
    """Return the rows of ascending keys that equal each wanted one, and how many these are."""
    first, last = (np.searchsorted(keys, wanted, side=side) for side in ("left", "right"))
    number = last - first
    rows = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    return rows + np.repeat(first, number), number
