# SPDX-License-Identifier: MIT
"""Search: which face does each node meet?"""

from dataclasses import dataclass
from numbers import Real

import numpy as np
import numpy.typing as npt
import scipy

from ..base.errors import ContactInputError
from ..surfaces.face_cells import Array, blend, distances, normals, project, shape_matrix
from ..surfaces.faces import Faces
from .candidates import FACING, TIE, Indices, MayMeet, Views, balls, candidates, flat


def check_positive(value: object, name: str, meaning: str) -> None:
    """Raise unless the value is a finite real number > 0."""
    if not (_is_real(value) and 0.0 < value < np.inf):  # type: ignore[operator]
        raise ContactInputError(f"{name} = {value!r} must be a finite number > 0: {meaning}.")


def _is_real(value: object) -> bool:
    """Tell whether a value is a real number."""
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


@dataclass(frozen=True)
class SearchPolicy:
    """How pairs are found, kept and given up.

    Attributes:
        reach: Nodes farther than this (m) from all faces, or deeper inside, meet none; by default
            twice the mean diameter of the faces.
        enter: How far beyond the surface's edge, in face lengths, a node may be to be paired.
        leave: How far beyond the edge it may slide before it is let go.
        keep: A node goes back to a face that it has met in this step only after it has left the
            present one by this, in face lengths. This prevents endless changes at a fold.
    """

    reach: float | None = None
    enter: float = 0.1
    leave: float = 0.5
    keep: float = 0.05

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.reach is not None:
            check_positive(self.reach, "reach", "the distance (m) at which nodes still meet a face")
        for name in ("enter", "leave", "keep"):
            value = getattr(self, name)
            if not (_is_real(value) and 0.0 <= value < np.inf):
                raise ContactInputError(
                    f"SearchPolicy({name}={value!r}): must be a finite number >= 0 (face lengths)."
                )
        if self.enter > self.leave:
            raise ContactInputError(
                f"SearchPolicy(enter={self.enter!r}, leave={self.leave!r}): enter must not be "
                "larger than leave, or nodes are let go where they are paired."
            )

    def distance(self, faces: Faces) -> float:
        """Return the ``reach``, or its default for the faces (m)."""
        return 2.0 * faces.size if self.reach is None else self.reach


@dataclass(frozen=True)
class Pairs:
    """The face of each node of this rank, and where on it.

    Attributes:
        face: Number of the face, or -1.
        xi: Reference coordinates of the projection on it.
    """

    face: Indices
    xi: Array

    @property
    def paired(self) -> npt.NDArray[np.bool_]:
        """Nodes that have a face."""
        return self.face >= 0


def find_pairs(
    faces: Faces,
    face_x: Array,
    x: Array,
    directions: Array,
    policy: SearchPolicy,
    held: npt.NDArray[np.bool_],
    last: Pairs | None = None,
    *,
    keep: npt.ArrayLike = 0.0,
    facing: float = FACING,
    may_meet: MayMeet | None = None,
) -> Pairs:
    """Pair nodes with the nearest face that faces them.

    Args:
        faces: The faces.
        face_x: Positions of their nodes (m).
        x: Positions of the nodes to be paired (m).
        directions: Their averaged normals. They must face each other.
        policy: What to accept.
        held: Nodes that keep a face up to ``policy.leave``; the others up to ``policy.enter``.
        last: The pairs so far.
        keep: Fraction of a face by which nodes, or each, may have left their last face and keep it.
        facing: Cosine of the normals of node and face up to which they face each other.
        may_meet: Tells which nodes may meet which faces at all; by default all.
    """
    result = Pairs(np.full(len(x), -1, dtype=np.int64), np.tile(faces.cell.center, (len(x), 1)))
    before = None if last is None else last.face
    reach = policy.distance(faces)
    views = Views(faces, face_x, x, directions, facing, may_meet)
    i, f = candidates(views, reach, before)
    near = _nearest(faces, face_x, x, i, f, last, np.broadcast_to(keep, len(x)))
    allowed = np.where(held, policy.leave, policy.enter)
    good = (near.overhang <= allowed) & (abs(near.gap) <= reach)
    result.face[good], result.xi[good] = near.face[good], near.xi[good]
    return result


@dataclass(frozen=True)
class Nearest:
    """The nearest of the faces that nodes may meet.

    Attributes:
        face: Number of the face, or -1.
        xi: Reference coordinates of the projection on it, extended.
        gap: Distance in front of its plane (m), infinite without a face.
        overhang: How far the projection is outside, in reference lengths.
    """

    face: Indices
    xi: Array
    gap: Array
    overhang: Array


def nearest_faces(faces: Faces, face_x: Array, x: Array) -> Nearest:
    """Find the nearest face of each node, near or far, wherever it looks.

    Args:
        faces: The faces.
        face_x: Positions of their nodes (m).
        x: Positions of the nodes (m).
    """
    center, radius = balls(face_x[faces.faces])
    tree = scipy.spatial.cKDTree(center)
    i, f = flat(tree.query_ball_point(x, tree.query(x)[0] + np.max(radius)))
    return _nearest(faces, face_x, x, i, f)


def _nearest(
    faces: Faces,
    face_x: Array,
    x: Array,
    i: Indices,
    f: Indices,
    last: Pairs | None = None,
    keeps: Array | None = None,
) -> Nearest:
    """Choose the nearest face of each node among candidates: nodes ``i`` with faces ``f``."""
    cell, nodes, n = faces.cell, np.arange(len(x)), len(x)
    if len(i) == 0:
        nowhere = np.full(n, np.inf)
        none = np.full(n, -1, dtype=np.int64)
        return Nearest(none, np.tile(cell.center, (n, 1)), nowhere, nowhere)
    corners = face_x[faces.faces[f]]
    xi = project(cell, corners, x[i])
    distance = distances(cell, corners, x[i], xi)
    overhang = cell.overhang(xi)
    bad = ~np.all(np.isfinite(xi), axis=1)
    distance[bad] = overhang[bad] = np.inf
    if last is not None and keeps is not None:
        kept = (f == last.face[i]) & (overhang <= np.maximum(keeps[i], TIE))
        advantage = np.where(keeps[i] > TIE, faces.size, 2.0 * TIE * faces.size)
        distance[kept] -= advantage[kept]
    order = np.lexsort((faces.priority[f], np.round(distance / faces.size / TIE), i))
    best = order[np.searchsorted(i[order], nodes).clip(max=len(i) - 1)]
    normal = normals(cell, corners[best], xi[best])
    gap = np.sum(normal * (x[i[best]] - blend(shape_matrix(cell, xi[best]), corners[best])), axis=1)
    found = i[best] == nodes
    return Nearest(
        np.where(found, f[best], -1),
        xi[best],
        np.where(found, gap, np.inf),
        np.where(found, overhang[best], np.inf),
    )
