# SPDX-License-Identifier: MIT
"""Which face of its own surface each node meets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy
from dolfinx import fem

from ..surfaces.bodies import cells_at, number_bodies
from ..surfaces.face_cells import Array, blend, normals, shape_matrix
from ..surfaces.faces import Faces, FaceSet
from .candidates import FACING, balls, flat
from .face_pairs import FacePairs
from .roles import Roles
from .search import Pairs, SearchPolicy, find_pairs
from .side import Side

Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

#: A node is behind a face of its body from this fraction of a face on, at the last accepted
#: displacement.
BEHIND = 0.2
#: No node is deeper in another body than by this fraction of its own wall: that is a far side.
HALF = 0.5
#: Bodies may overlap in the undeformed mesh by this fraction of a face: curved ones that touch do.
#: Where the wall is thin, by half of it.
OVERLAP = 0.05

#: Cosine of the normals of node and face from which on both are on one smooth, convex side, where
#: a node is behind the planes of the faces beside it.
ROUND = 0.5
#: Nodes nearer than this part of a face touch it ...
TOUCHING = 1e-3
#: ... and press if their pressure is more than this part of the largest.
FAINT = 1e-6


@dataclass(frozen=True)
class Shape:
    """A surface in one configuration: where its nodes are, and what their faces look like."""

    x: Array
    directions: Array
    center: Array
    radius: Array
    normal: Array

    @classmethod
    def of(cls, faces: Faces, x: Array) -> Shape:
        """Return the shape of a surface whose nodes are at ``x`` (m)."""
        corners = x[faces.faces]
        middle = np.tile(faces.cell.center, (len(corners), 1))
        return cls(x, faces.node_normals(x), *balls(corners), normals(faces.cell, corners, middle))

    def behind(
        self,
        i: Indices,
        f: Indices,
        tolerance: float | Array,
        near: float,
        *,
        below: bool = False,
    ) -> Mask:
        """Tell which nodes are behind faces with other normals: what is between is the body.

        Args:
            i: The nodes.
            f: The faces.
            tolerance: From which depth on (m).
            near: Up to which distance (m).
            below: Only those below the face, not beside it: on a convex surface, nodes are behind
                the planes of the faces that they may slide to.
        """
        way, depth = self.x[i] - self.center[f], self.depth(i, f)
        close = np.linalg.norm(way, axis=1) <= self.radius[f] + near
        if below:
            aside = np.linalg.norm(way + depth[:, None] * self.normal[f], axis=1)
            close &= aside <= self.radius[f] + depth
        return np.asarray((self.cosine(i, f) < ROUND) & close & (depth > tolerance))

    def cosine(self, i: Indices, f: Indices) -> Array:
        """Return the cosines of the normals of nodes and faces, in pairs."""
        return np.asarray(np.sum(self.normal[f] * self.directions[i], axis=1))

    def depth(self, i: Indices, f: Indices) -> Array:
        """Return how deep nodes are behind the planes of faces (m), in pairs."""
        return -np.asarray(np.sum(self.normal[f] * (self.x[i] - self.center[f]), axis=1))

    def far_sides(
        self, body: Indices, of_face: Indices, tolerance: float, near: float
    ) -> tuple[Indices, Indices]:
        """Return nodes and faces on the far side of a wall of their body, in pairs.

        Args:
            body: Body of each node.
            of_face: Body of each face.
            tolerance: From which thickness on (m): the lips of a crack touch.
            near: Up to which distance (m).
        """
        tree = scipy.spatial.cKDTree(self.center)
        i, f = flat(tree.query_ball_point(self.x, near + np.max(self.radius)))
        through = (self.cosine(i, f) < FACING) & (body[i] == of_face[f])
        through &= self.behind(i, f, tolerance, near)
        return i[through], f[through]


class SelfPairs(FacePairs):
    """The pairs of nodes and faces of one surface that meets itself, within a step.

    A node meets no face that it belongs to, and none on the far side of a body: none of its own
    that it was well behind at the last accepted displacement, or behind in the undeformed mesh
    where the wall is thin, and none at all that it is behind by half of its own wall.

    Args:
        faces: The faces of the surface.
        secondary: The same.
        policy: How pairs are found.
        side: The side.

    Attributes:
        before: The face that each owned node had before it at the last accepted displacement, or
            -1, whichever of the two is secondary.
        faces_something: Whether it has a face before it now.
    """

    _STATE = (*FacePairs._STATE, "before", "_accepted", "faces_something")

    def __init__(self, faces: Faces, secondary: FaceSet, policy: SearchPolicy, side: Side) -> None:
        self._made = Shape.of(faces, secondary.X)
        dofs = side.parent_dofs[: side.surface.num_owned]
        self._bodies = number_bodies(side.u.function_space)[1]
        self._body = secondary.gather(self._bodies[dofs])
        self._roles, self._near = Roles(faces, self._body), 2.0 * policy.distance(faces)
        self._measure_walls(faces)
        super().__init__(faces, secondary, policy, side)

    def _measure_walls(self, faces: Faces) -> None:
        """Find the thickness of the wall at each node (m), infinite if it is thick; and far sides.

        Thin walls may be compressed until nothing else tells their far side.
        """
        made = self._made
        of_face, touching = self._body[faces.faces[:, 0]], TOUCHING * faces.size
        i, f = made.far_sides(self._body, of_face, touching, self._near)
        depth = made.depth(i, f)
        self._wall = np.full(len(made.x), np.inf)
        np.minimum.at(self._wall, i, depth)
        thin = depth < BEHIND / HALF * faces.size
        self._through = i[thin] * len(faces.faces) + f[thin]

    def inside_others(self) -> Mask:
        """Tell which owned nodes are inside another body in the undeformed mesh; collective.

        Nodes are moved into their own body first, by what counts as touching.
        """
        made, V, own = self._made, self._side.u.function_space, self._secondary.own
        touching = np.minimum(OVERLAP * self._faces.size, HALF * self._wall)
        points = made.x - touching[:, None] * made.directions
        node, cell = cells_at(V.mesh, points)
        other = self._bodies[V.dofmap.list[cell, 0]] != self._body[node]
        found = np.concatenate(V.mesh.comm.allgather(node[other]))
        return np.isin(np.arange(own.start, own.stop), found)

    def _may_meet(self, now: Shape, i: Indices, f: Indices) -> Mask:
        """Tell which owned nodes may meet which faces in the shape of now."""
        node, corners = i + self._secondary.own.start, self._faces.faces[f]
        size, near = self._faces.size, self._near
        own = np.any(corners == node[:, None], axis=1)
        one_body = self._body[node] == self._body[corners[:, 0]]
        behind = self._accepted.behind(node, f, BEHIND * size, near, below=True)
        behind |= np.isin(node * len(self._faces.faces) + f, self._through)
        through = now.behind(node, f, HALF * self._wall[node], near)
        return ~(own | (one_body & behind) | through)

    def _find(
        self,
        u: fem.Function,
        held: Mask,
        last: Pairs | None = None,
        keep: npt.ArrayLike = 0.0,
    ) -> Pairs:
        """Pair this rank's nodes at a displacement, those that are secondary; collective."""
        faces, own = self._faces, self._secondary.own
        now = Shape.of(faces, self._secondary.positions(u))
        if last is None:  # at the last accepted displacement
            self._accepted = now
        nodes = (now.x[own], now.directions[own], self._policy, held, last)
        may_meet = partial(self._may_meet, now)
        found = find_pairs(faces, now.x, *nodes, keep=keep, facing=self.facing, may_meet=may_meet)
        if last is None:
            self.before = found.face
        self.faces_something = found.paired
        before = self._pressed(found) if last is None else last.paired
        shapes = shape_matrix(faces.cell, faces.cell.inside(found.xi))
        foot = blend(shapes, now.x[faces.faces[found.face]])
        distance = np.linalg.norm(now.x[own] - foot, axis=1)
        parts = (found.face, shapes, distance, before)
        secondary = self._roles.secondary(*map(self._secondary.gather, parts))[own]
        return Pairs(np.where(secondary, found.face, -1), found.xi)

    def _pressed(self, found: Pairs) -> Mask:
        """Tell which owned nodes press on what they found at ``u_old``; collective.

        Multipliers of open nodes may be rounding.
        """
        faces, own = self._faces, self._secondary.own
        foot = blend(shape_matrix(faces.cell, found.xi), self._accepted.x[faces.faces[found.face]])
        distance = np.linalg.norm(self._accepted.x[own] - foot, axis=1)
        pressure = abs(self._side.nodal(self._side.c)[:, 0])
        largest = self._side.surface.mesh.comm.allreduce(np.max(pressure, initial=0.0), MPI.MAX)
        return (distance < TOUCHING * faces.size) & (pressure > FAINT * largest)
