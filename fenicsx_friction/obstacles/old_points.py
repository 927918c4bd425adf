# SPDX-License-Identifier: MIT
"""What points of a surface saw of the other one at the last accepted displacement."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .facing import Facing, Positions
from .planes import Planes
from .rays import cast
from .segments import Segments, ranges

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


def points_before(
    facing: Facing, points: Segments, x: Positions, seen: Segments
) -> tuple[Indices, Array]:
    """Return faces, and places on them, that points saw before.

    Points that saw nothing are traced back to the face that they see now, extended.

    Args:
        facing: The two surfaces.
        points: The points.
        x: Positions of the dofs of both surfaces then (m).
        seen: What the patches saw then.
    """
    secondary, primary = facing.secondary, facing.primary
    normal = Planes.of(secondary, x[0]).normal[points.patch]
    own_face = secondary.face_of(points.patch)
    start = secondary.interpolation(own_face, secondary.shapes(points.xi)) @ x[0]
    face = points.face.copy()
    eta, _ = cast(primary, x[1], face, start, normal, points.eta)
    lost = ~np.all(np.isfinite(eta), axis=1)
    eta[lost] = points.eta[lost]
    away = np.flatnonzero(~primary.inside(eta))
    if not len(away) or not len(seen.patch):
        return face, eta
    faces = len(primary.dofs)
    pairs = np.unique(seen.patch * faces + seen.face)
    rows, number = ranges(pairs // faces, points.patch[away])
    rival, point = (pairs % faces)[rows], np.repeat(away, number)
    place, height = cast(primary, x[1], rival, start[point], normal[point])
    outside = np.maximum(-np.min(primary.hats(np.nan_to_num(place, nan=1e3)), axis=1), 0.0)
    order = np.lexsort((abs(np.nan_to_num(height, nan=np.inf)), np.round(outside, 9), point))
    chosen, at = np.unique(point[order], return_index=True)
    best = order[at]
    good = np.all(np.isfinite(place[best]), axis=1)
    face[chosen[good]], eta[chosen[good]] = rival[best[good]], place[best[good]]
    return face, eta
