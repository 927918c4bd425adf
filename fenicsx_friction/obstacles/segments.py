# SPDX-License-Identifier: MIT
"""Segments: which parts of two surfaces face each other, and quadrature points on them.

Each patch of the secondary surface looks along its normal at the patches of the primary one. What
it sees of each is a segment: both are projected on its plane and clipped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from ..surfaces.face_tables import normals_of
from ..surfaces.lagrange_faces import LagrangeFaces
from .clipping import common_points, sizes

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

#: Cosine of the normals of two patches above which one may press on the other.
FACING = 0.1
#: Newton iterations of a projection; its tolerance in the face's coordinates; and from which last
#: step on it has failed.
MAX_IT, TOLERANCE, FAILED = 25, 1e-14, 1e-9
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


@dataclass(frozen=True)
class Planes:
    """The planes of the patches of the secondary surface.

    Attributes:
        origin: Centers of the patches (m).
        normal: Unit normals, towards the body.
        axes: Unit vectors in the planes: (patches, d - 1, d).
    """

    origin: Array
    normal: Array
    axes: Array

    @classmethod
    def of(cls, faces: LagrangeFaces, x: Array) -> Planes:
        """Return the planes at positions ``x`` of the dofs (m)."""
        tangents, outward = faces.tangents(x), np.repeat(faces.outward, len(faces.corners))
        normal = -outward[:, None] * normals_of(tangents)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        first = tangents[:, 0] / np.linalg.norm(tangents[:, 0], axis=1, keepdims=True)
        axes = first[:, None]
        if faces.d == 3:
            axes = np.stack([first, np.cross(normal, first)], axis=1)
        return cls(faces.corner_positions(x).mean(axis=1), normal, axes)

    def flat(self, patch: Indices, points: Array) -> Array:
        """Return the coordinates in the planes of points (n, ..., d)."""
        return np.einsum(
            "n...d,nkd->n...k", points - self._origins(patch, points), self.axes[patch]
        )

    def heights(self, patch: Indices, points: Array) -> Array:
        """Return how far points (n, ..., d) are behind the planes (m), seen from the body."""
        return np.einsum(
            "n...d,nd->n...", self._origins(patch, points) - points, self.normal[patch]
        )

    def _origins(self, patch: Indices, points: Array) -> Array:
        """Return the origins, to be subtracted from points."""
        return self.origin[patch].reshape(len(patch), *[1] * (points.ndim - 2), points.shape[-1])


def find_segments(
    secondary: LagrangeFaces,
    primary: LagrangeFaces,
    positions: tuple[Array, Array],
    reach: float,
    wanted: Mask,
) -> Segments:
    """Return the segments of some patches.

    Args:
        secondary: The secondary surface.
        primary: The primary surface.
        positions: Positions of the dofs of both (m).
        reach: Parts farther from each other than this (m), or deeper, do not meet.
        wanted: The patches of the secondary surface.
    """
    planes = Planes.of(secondary, positions[0])
    own, other = (
        f.corner_positions(x) for f, x in zip((secondary, primary), positions, strict=True)
    )
    patch, meets = _candidates(planes, own, other, primary, positions[1], reach, wanted)
    degree = secondary.degree + primary.degree
    first, second = planes.flat(patch, own[patch]), planes.flat(patch, other[meets])
    pair, flat, weight = common_points(first, second, degree)
    on_plane = np.einsum("nk,nkd->nd", flat, planes.axes[patch[pair]]) + planes.origin[patch[pair]]
    eta, height = cast(
        primary, positions[1], primary.face_of(meets[pair]), on_plane, planes.normal[patch[pair]]
    )
    found = np.bincount(pair, weight, minlength=len(patch))
    mean = np.bincount(pair, weight * height, minlength=len(patch))
    good = (found > 0.0) & (abs(mean) <= reach * found)
    kept = good[pair]
    seen = np.bincount(patch, found * good, minlength=len(own))
    crowded = seen > TWICE * abs(sizes(planes.flat(np.arange(len(own)), own)))
    if np.any(crowded):
        parts = (patch[good], meets[good])
        number = np.cumsum(good) - 1
        kept[kept] = _in_front(
            primary,
            positions[1],
            planes,
            parts,
            number[pair[kept]],
            on_plane[kept],
            height[kept],
            crowded,
        )
    pair = pair[kept]
    patch_of = patch[pair]
    xi, share = _places(secondary, positions[0], planes, patch_of, flat[kept])
    return Segments(patch_of, xi, weight[kept] * share, primary.face_of(meets[pair]), eta[kept])


def _candidates(
    planes: Planes,
    own: Array,
    other: Array,
    primary: LagrangeFaces,
    x: Array,
    reach: float,
    wanted: Mask,
) -> tuple[Indices, Indices]:
    """Return pairs of patches that face each other nearby, sorted."""
    centers, balls = zip(*(_balls(corners) for corners in (own, other)), strict=True)
    mine = np.flatnonzero(wanted)
    tree = cKDTree(centers[1])
    # Within reach across the plane, and within both balls along it.
    radius = np.hypot(reach + balls[0][mine] + np.max(balls[1]), balls[0][mine] + np.max(balls[1]))
    near = tree.query_ball_point(centers[0][mine], radius)
    patch = np.repeat(mine, [len(n) for n in near])
    meets = np.concatenate([np.sort(np.asarray(n, dtype=np.int64)) for n in near] or [mine])
    outward = np.repeat(primary.outward, len(primary.corners))[:, None] * normals_of(
        primary.tangents(x)
    )
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    facing = np.sum(planes.normal[patch] * outward[meets], axis=1) > FACING
    patch, meets = patch[facing], meets[facing]
    both = balls[0][patch] + balls[1][meets]
    along = np.linalg.norm(planes.flat(patch, centers[1][meets]), axis=1) <= both
    across = abs(planes.heights(patch, centers[1][meets])) <= reach + both
    return patch[along & across], meets[along & across]


def _balls(corners: Array) -> tuple[Array, Array]:
    """Return centers and radii of balls about patches."""
    center = corners.mean(axis=1)
    return center, np.max(np.linalg.norm(corners - center[:, None], axis=2), axis=1)


def cast(
    faces: LagrangeFaces,
    x: Array,
    face: Indices,
    start: Array,
    along: Array,
    eta: Array | None = None,
) -> tuple[Array, Array]:
    """Find where lines meet faces, which extend beyond their edges.

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
    corners, gap = x[faces.dofs[face]], np.zeros(len(face))
    place = np.tile(faces.centers.mean(axis=0), (len(face), 1)) if eta is None else eta.copy()
    moved = np.zeros(len(face))
    with np.errstate(all="ignore"):
        for _ in range(MAX_IT):
            tangents = np.einsum("pta,pad->ptd", faces.slopes(place), corners)
            way = start - np.einsum("pa,pad->pd", faces.shapes(place), corners)
            step, gap = split(tangents, along, way)
            place = place + np.clip(step, -1.0, 1.0)
            moved = np.max(abs(step), axis=1, initial=0.0)
            if np.max(moved, initial=0.0, where=np.isfinite(moved)) < TOLERANCE:
                break
    place[~(moved <= FAILED)] = np.nan
    return place, np.where(moved <= FAILED, gap, np.nan)


def split(tangents: Array, along: Array, way: Array) -> tuple[Array, Array]:
    """Split vectors into parts along tangents and along a direction."""
    parts = duals(tangents, along)
    found = np.einsum("pkd,pd->pk", parts, way)
    return found[:, :-1], found[:, -1]


def duals(tangents: Array, along: Array) -> Array:
    """Return the dual vectors of tangents and a direction: (points, d, d)."""
    normal = normals_of(tangents)
    of_along = normal / np.sum(normal * along, axis=1, keepdims=True)
    if tangents.shape[2] == 2:
        across = np.column_stack([along[:, 1], -along[:, 0]])
        first = across / np.sum(across * tangents[:, 0], axis=1, keepdims=True)
        return np.stack([first, of_along], axis=1)
    volume = np.sum(normal * along, axis=1, keepdims=True)
    first, second = np.cross(tangents[:, 1], along), np.cross(along, tangents[:, 0])
    return np.stack([first / volume, second / volume, of_along], axis=1)


def _in_front(
    primary: LagrangeFaces,
    x: Array,
    planes: Planes,
    parts: tuple[Indices, Indices],
    pair: Indices,
    points: Array,
    height: Array,
    crowded: Mask,
) -> Mask:
    """Tell which points are the nearest, of patches that see two primary patches in one place.

    Args:
        primary: The primary surface.
        x: Positions of its dofs (m).
        planes: The planes of the secondary patches.
        parts: The two patches of each pair.
        pair: The pair of each point.
        points: The points, in the planes (m).
        height: How far they are from the primary surface (m).
        crowded: Secondary patches that see more than themselves.
    """
    patch, meets = parts
    first, last = (
        np.searchsorted(patch, np.arange(len(crowded)), side=s) for s in ("left", "right")
    )
    point = np.flatnonzero(crowded[patch[pair]])
    of_point = patch[pair[point]]
    number = last[of_point] - first[of_point]
    rival = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    rival += np.repeat(first[of_point], number)
    point = np.repeat(point, number)
    others = rival != pair[point]
    rival, point = rival[others], point[others]
    along, face = planes.normal[patch[rival]], primary.face_of(meets[rival])
    eta, other = cast(primary, x, face, points[point], along)
    nearer = abs(other) < abs(height[point])
    result = np.ones(len(pair), dtype=bool)
    result[point[nearer & primary.inside(eta)]] = False
    return result


def _places(
    faces: LagrangeFaces, x: Array, planes: Planes, patch: Indices, flat: Array
) -> tuple[Array, Array]:
    """Return places on the faces of points in the planes, and reference area over flat area."""
    start = planes.origin[patch] + np.einsum("nk,nkd->nd", flat, planes.axes[patch])
    face = faces.face_of(patch)
    begin = faces.centers[patch % len(faces.corners)]
    xi, _ = cast(faces, x, face, start, planes.normal[patch], begin)
    slopes, dofs = faces.slopes(xi), faces.dofs[face]
    tangents = np.einsum("pta,pad->ptd", slopes, faces.X[dofs])
    area = np.linalg.norm(normals_of(tangents), axis=1)
    now = normals_of(np.einsum("pta,pad->ptd", slopes, x[dofs]))
    return xi, area / abs(np.sum(now * planes.normal[patch], axis=1))
