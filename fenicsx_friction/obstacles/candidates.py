# SPDX-License-Identifier: MIT
"""Candidates: which faces may a node meet? Those of a tree of balls about the faces."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import scipy

from ..surfaces.face_cells import Array, normals
from ..surfaces.faces import Faces

Indices = npt.NDArray[np.int64]
#: Tells of nodes and faces, in pairs, which may meet.
MayMeet = Callable[[Indices, Indices], npt.NDArray[np.bool_]]
#: Cosine of the normals of node and face up to which they face each other. A corner of a cube looks
#: at faces with -0.58; what lies on a face beside the foot of a wall does not meet the wall.
FACING = -0.3
#: Distances that differ by this fraction of a face are the same.
TIE = 1e-9
#: Nodes whose faces are looked up together: a tool may have many faces within reach.
BLOCK = 512
#: Most nodes look at one of so many nearest faces.
FEW = 8


class Views:
    """Pairs of nodes and faces that look at each other, and how far away the nearest are.

    Args:
        faces: The faces.
        face_x: Positions of their nodes (m).
        x: Positions of the nodes that look for a face (m).
        directions: Their averaged normals.
        facing: Cosine of the normals of node and face up to which they face each other.
        may_meet: Tells which nodes may meet which faces at all; by default all.

    Attributes:
        x: See above.
        center, radius: Balls about the faces (m).
        nearest: The distance (m) of the nearest of all centers so far, of each node.
    """

    def __init__(
        self,
        faces: Faces,
        face_x: Array,
        x: Array,
        directions: Array,
        facing: float = FACING,
        may_meet: MayMeet | None = None,
    ) -> None:
        corners, self.x = face_x[faces.faces], x
        self.center, self.radius = balls(corners)
        middles = np.tile(faces.cell.center, (len(corners), 1))
        self._normal, self._directions = normals(faces.cell, corners, middles), directions
        self._facing, self._may_meet = facing, may_meet
        self.nearest = np.full(len(x), np.inf)

    def look(self, i: Indices, f: Indices) -> tuple[Indices, Indices, Array]:
        """Return those of the pairs that may meet, and how far apart they are (m)."""
        looks = np.sum(self._normal[f] * self._directions[i], axis=1) < self._facing
        i, f = i[looks], f[looks]
        if self._may_meet is not None:
            allowed = self._may_meet(i, f)
            i, f = i[allowed], f[allowed]
        away = np.linalg.norm(self.x[i] - self.center[f], axis=1)
        np.minimum.at(self.nearest, i, away)
        return i, f, away


def candidates(views: Views, reach: float, last: Indices | None = None) -> tuple[Indices, Indices]:
    """Return nodes and faces, in pairs: those that may be nearest among those that nodes look at.

    The distance ``d`` of a face with center ``c`` and radius ``r`` obeys ``|c| - r <= d <= |c|``.

    Args:
        views: What nodes look at.
        reach: Up to which distance (m).
        last: The last face of each node, or -1: it is among its candidates while it is in reach.
    """
    x, center, radius, nearest = views.x, views.center, views.radius, views.nearest
    tree, largest = scipy.spatial.cKDTree(center), np.max(radius)
    few = tree.query(x, k=np.arange(1, min(FEW, len(center)) + 1))[1]
    views.look(np.repeat(np.arange(len(x)), few.shape[1]), few.ravel())
    # Where a node looks at one of these, only what is hardly farther away can be nearer.
    reaches = np.minimum(reach, nearest * (1.0 + 2.0 * TIE)) + largest
    found = [(np.zeros(0, dtype=np.int64),) * 2]
    for start in range(0, len(x), BLOCK):
        block = slice(start, start + BLOCK)
        i, f = flat(tree.query_ball_point(x[block], reaches[block]))
        i, f, away = views.look(i + start, f)
        possible = away - radius[f] <= nearest[i] * (1.0 + TIE)
        found.append((i[possible], f[possible]))
    if last is not None:
        i, f, away = views.look(np.flatnonzero(last >= 0), last[last >= 0])
        further = (away - radius[f] > nearest[i] * (1.0 + TIE)) & (away <= reach + largest)
        found.append((i[further], f[further]))
    return np.concatenate([i for i, _ in found]), np.concatenate([f for _, f in found])


def balls(corners: Array) -> tuple[Array, Array]:
    """Return centers and radii of balls about faces."""
    center = corners.mean(axis=1)
    return center, np.max(np.linalg.norm(corners - center[:, None], axis=2), axis=1)


def flat(near: Sequence[Sequence[int]]) -> tuple[Indices, Indices]:
    """Return the pairs of a list of faces for each node."""
    i = np.repeat(np.arange(len(near)), [len(n) for n in near])
    f = np.concatenate([np.asarray(n, dtype=np.int64) for n in near] or [np.zeros(0, np.int64)])
    return i, f
