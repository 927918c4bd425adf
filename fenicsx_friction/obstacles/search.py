# SPDX-License-Identifier: MIT
"""Search: which face does each node meet?"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np
import numpy.typing as npt
import scipy

from ..base.errors import ContactInputError
from ..surfaces.face_cells import Array, blend, distances, normals, project, shape_matrix
from ..surfaces.faces import Faces

#: Tells of nodes and faces, in pairs, which may meet.
MayMeet = Callable[[npt.NDArray[np.int64], npt.NDArray[np.int64]], npt.NDArray[np.bool_]]
#: Cosine of the normals of node and face up to which they face each other. A corner of a cube looks
#: at faces with -0.58; what lies on a face beside the foot of a wall does not meet the wall.
FACING = -0.3
#: Distances that differ by this fraction of a face are the same.
TIE = 1e-9
#: Nodes whose faces are looked up together.
BLOCK = 512


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

    face: npt.NDArray[np.int64]
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
    i, f = _candidates(faces, face_x, x, directions, policy, last, facing, may_meet)
    near = _nearest(faces, face_x, x, i, f, last, np.broadcast_to(keep, len(x)))
    allowed = np.where(held, policy.leave, policy.enter)
    good = (near.overhang <= allowed) & (abs(near.gap) <= policy.distance(faces))
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

    face: npt.NDArray[np.int64]
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
    i: npt.NDArray[np.int64],
    f: npt.NDArray[np.int64],
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


def _candidates(
    faces: Faces,
    face_x: Array,
    x: Array,
    directions: Array,
    policy: SearchPolicy,
    last: Pairs | None,
    facing: float,
    may_meet: MayMeet | None,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return nodes and faces that may be pairs, from a tree of the faces' centers.

    The distance ``d`` of a face with center ``c`` and radius ``r`` obeys ``|c| - r <= d <= |c|``.
    """
    corners = face_x[faces.faces]
    center, radius = balls(corners)
    tree, reach = scipy.spatial.cKDTree(center), policy.distance(faces) + np.max(radius)
    middle = np.tile(faces.cell.center, (len(corners), 1))
    normal = normals(faces.cell, corners, middle)
    found = [(np.zeros(0, dtype=np.int64),) * 2]
    for start in range(0, len(x), BLOCK):  # a tool may have many faces within reach
        i, f = flat(tree.query_ball_point(x[start : start + BLOCK], reach))
        i += start
        looks = np.sum(normal[f] * directions[i], axis=1) < facing
        i, f = i[looks], f[looks]
        if may_meet is not None:
            allowed = may_meet(i, f)
            i, f = i[allowed], f[allowed]
        away = np.linalg.norm(x[i] - center[f], axis=1)
        nearest = np.full(len(x), np.inf)
        np.minimum.at(nearest, i, away)
        possible = away - radius[f] <= nearest[i] * (1.0 + TIE)
        if last is not None:
            possible |= f == last.face[i]
        found.append((i[possible], f[possible]))
    return np.concatenate([i for i, _ in found]), np.concatenate([f for _, f in found])


def balls(corners: Array) -> tuple[Array, Array]:
    """Return centers and radii of balls about faces."""
    center = corners.mean(axis=1)
    return center, np.max(np.linalg.norm(corners - center[:, None], axis=2), axis=1)


def flat(
    near: Sequence[Sequence[int]],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the pairs of a list of faces for each node."""
    i = np.repeat(np.arange(len(near)), [len(n) for n in near])
    f = np.concatenate([np.asarray(n, dtype=np.int64) for n in near] or [np.zeros(0, np.int64)])
    return i, f
