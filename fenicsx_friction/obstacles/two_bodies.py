# SPDX-License-Identifier: MIT
"""What all contact between two deformable bodies has in common: two surfaces in view."""

from __future__ import annotations

from abc import abstractmethod

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy
from dolfinx import fem

from ..base.collective import any_rank
from ..surfaces.face_cells import normals
from ..surfaces.faces import FaceSet
from ..surfaces.surface import ContactSurface
from .against_faces import AgainstFaces, beside
from .averaged import DEEP
from .candidates import TIE
from .crossing import HELD_DEPTH, find_crossed
from .face_frames import along_planes
from .kinematics import Array
from .pairing import Mask
from .search import SearchPolicy, nearest_faces
from .side import Side
from .view import View

Indices = npt.NDArray[np.int64]


class TwoBodies(AgainstFaces):
    """A secondary surface that meets the primary surface of another body.

    Args:
        primary: The primary surface.
        policy: How they are searched.
        side: The secondary side.

    Attributes:
        faces: The faces of the primary surface.
    """

    deformable = True
    faces: FaceSet

    def __init__(self, primary: ContactSurface, policy: SearchPolicy, side: Side) -> None:
        super().__init__(side)
        self.primary, u = primary, side.u
        self._face(FaceSet(primary, u), FaceSet(side.surface, u), policy, f"'{primary.name}'")
        self._inputs_before: tuple[Array, ...] | None = None

    def _follow(self) -> None:
        """Follow the displacement, as far as it has changed; collective."""
        now, before = (*self._inputs(), np.array(self._added())), self._inputs_before
        changed = before is None or not all(map(np.array_equal, now, before))
        if not any_rank(self.primary.mesh.comm, changed):
            return
        self._inputs_before = None  # until all is written: an interrupt may come
        n, width = self.side.surface.num_owned, self.field.function_space.dofmap.bs
        self._fill(self.field.x.array[: n * width].reshape(n, width))
        self.field.x.scatter_forward()
        self._inputs_before = now

    @abstractmethod
    def _inputs(self) -> tuple[Array, ...]:
        """Return all of this rank that the kinematics depend on."""

    @abstractmethod
    def _fill(self, rows: Array) -> None:
        """Write the field of the owned nodes, one row each; collective."""

    def _places(self) -> Array:
        """Return the current positions of the owned nodes (m)."""
        return self._secondary.X[self._secondary.own] + self.side.owned(self.side.u.x.array)

    def alone(self, nodes: Mask) -> Array:
        """Return the field of nodes that meet nothing, but for the position: open, with a frame."""
        d, own = self.side.d, self._secondary.own
        normal = -self._secondary.node_normals(self._secondary.X)[own][nodes]
        reach = self.policy.distance(self.faces)
        parts = [np.full((len(normal), 1), reach), np.zeros((len(normal), d - 1)), normal]
        if d == 3:
            parts.append(along_planes(self.side.nodal(self.side.hint)[nodes], normal))
        return np.hstack(parts)

    def view(self, u: fem.Function) -> View:
        """Return how the faces look at the nodes; collective.

        The cosine is the smallest of all faces. The gap is that of the nearest face, which may
        look away from the node.
        """
        x, own = self._secondary.positions(u), self._secondary.own
        directions, face_x = self._secondary.node_normals(x)[own], self.faces.positions(u)
        centers = np.tile(self.faces.cell.center, (len(self.faces.faces), 1))
        outward = normals(self.faces.cell, face_x[self.faces.faces], centers)
        opposite = scipy.spatial.cKDTree(outward).query(-directions)[0]
        cosine = opposite**2 / 2.0 - 1.0
        near = nearest_faces(self.faces, face_x, x[own])
        reach, over = self.policy.distance(self.faces), near.overhang <= TIE
        looks = np.sum(outward[near.face] * directions, axis=1) < 0.0
        lost = np.where(over & looks & (near.gap < -reach), -near.gap, 0.0)
        gap = np.where(over & (near.gap >= -reach), near.gap - self.offset, np.inf)
        return View(cosine, gap, lost)

    def pierced(self, closed: Mask) -> Mask:
        """Tell which nodes have faces that nodes of the obstacle have gone through; collective.

        What contact holds is on average in front of the faces round its node.
        """
        own, mine = self._secondary.own, self.faces.own
        j, i = self._held_couples(closed).T
        here = (i >= mine.start) & (i < mine.stop)
        met = beside(self._secondary, i[here] - mine.start, j[here], mine.stop - mine.start)
        faces, nodes = self._trails()
        body = self._secondary
        of_face = self._deepest(self._pressed(closed), body.faces, body.sizes)
        deep = of_face, HELD_DEPTH * self.faces.node_sizes()[mine] + self._doubt
        motion = faces.seen_by(nodes, mine, DEEP, self._doubt, deep)
        started = self._faces_at_start(self._secondary, self.faces)
        entered = find_crossed(self._secondary, motion, started, met)
        entered = np.concatenate(self.primary.mesh.comm.allgather(entered[entered >= 0]))
        return np.isin(np.arange(own.start, own.stop), self._secondary.faces[entered])

    def _held_couples(self, closed: Mask) -> Indices:
        """Return closed nodes and the nodes that hold them, of all ranks, in pairs; collective."""
        node, other = self.couples()
        held = closed[node]
        pairs = np.column_stack([node[held] + self._secondary.own.start, other[held]])
        return np.concatenate(self.primary.mesh.comm.allgather(pairs))

    def stiffness(self, diagonal: Array, V: fem.FunctionSpace) -> float:
        """Return the smallest stiffness over area (Pa/m) of the primary nodes; collective."""
        n = self.primary.num_owned
        values = diagonal[self.primary.parent_dofs(V)[:n]] / self.primary.area.x.array[:n]
        comm = self.primary.mesh.comm
        return float(comm.allreduce(float(np.min(values, initial=np.inf)), MPI.MIN))
