# SPDX-License-Identifier: MIT
"""What all contact between two deformable bodies has in common: two surfaces in view."""

from __future__ import annotations

from abc import abstractmethod

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy.sparse
from dolfinx import fem

from ..base.collective import any_rank
from ..base.errors import ContactInputError
from ..surfaces.face_cells import normals
from ..surfaces.faces import FaceSet
from ..surfaces.surface import ContactSurface
from .averaged import DEEP
from .crossing import DEPTH, Trail, find_crossed
from .face_frames import along_planes
from .kinematics import Array
from .pairing import Mask, Pairing
from .search import TIE, SearchPolicy, find_pairs, nearest_faces
from .side import Side
from .view import View

Indices = npt.NDArray[np.int64]
#: An offset is known along the node's own normal: part of it by which it is in doubt.
TILTED = 0.1


class TwoBodies(Pairing):
    """A secondary surface that meets the primary surface of another body.

    Args:
        primary: The primary surface.
        policy: How they are searched.
        side: The secondary side.

    Attributes:
        faces: The faces of the primary surface on all ranks.
        clearance: What is added to all gaps (m): a number, or a Constant.
    """

    deformable = tilted = True
    #: A node has crossed a face from this fraction of the smaller face on.
    behind = DEPTH
    clearance: float | fem.Constant = 0.0

    def __init__(self, primary: ContactSurface, policy: SearchPolicy, side: Side) -> None:
        super().__init__(side)
        self.primary, self.policy = primary, policy
        self.faces, self._secondary = FaceSet(primary, side.u), FaceSet(side.surface, side.u)
        self._inputs_before: tuple[Array, ...] | None = None
        self._closed, self._doubt_of_closed = np.zeros(side.surface.num_owned), 0.0

    @property
    def offset(self) -> Array:
        """What is subtracted from the gap of each owned node (m)."""
        return self._closed - self._added()

    def _added(self) -> float:
        """Return the clearance (m)."""
        given = self.clearance
        return float(given.value if isinstance(given, fem.Constant) else given)

    @property
    def _doubt(self) -> float:
        """By how much offsets are in doubt where faces tilt (m)."""
        return self._doubt_of_closed + TILTED * abs(self._added())

    def update(self) -> None:
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

    def started(self) -> Indices:
        """Return the face of each node at the start of the step, or -1; collective."""
        return self._faces_at_start(self.faces, self._secondary)

    def _faces_at_start(self, faces: FaceSet, nodes: FaceSet) -> Indices:
        """Return the face that each owned node had at the start of the step, or -1; collective."""
        u_old, own = self.side.u_old, nodes.own
        x, held = nodes.positions(u_old), np.ones(own.stop - own.start, bool)
        directions = nodes.node_normals(x)
        parts = (faces, faces.positions(u_old), x[own], directions[own], self.policy)
        return find_pairs(*parts, held).face

    @abstractmethod
    def meeting(self) -> Mask:
        """Tell which owned nodes meet something."""

    def close_gaps(self, limit: float) -> None:
        """Count gaps and overlaps of the undeformed bodies as zero from now on; collective.

        The offset depends on the mesh alone: a run that goes on from a checkpoint has the same.

        Args:
            limit: Nodes with a larger gap or overlap (m) keep it.

        Raises:
            ContactInputError: If this is more than the reach of the search.
        """
        reach = self.policy.distance(self.faces)
        if limit > reach:
            raise ContactInputError(
                f"DeformableObstacle: close_gaps = {limit:g} m is more than the surfaces "
                f"'{self.side.surface.name}' and '{self.primary.name}' see, {reach:g} m: give "
                f"search=SearchPolicy(reach={2.0 * limit:g}), or a smaller limit."
            )
        state = (self.side.u, self.side.u_old, self.side.c)
        kept = [f.x.array.copy() for f in state]
        try:
            for f in state:
                f.x.array[:] = 0.0
            self._closed = np.zeros_like(self._closed)
            self.anchor()
            gaps = self.gaps() - self._added()
            near = self.meeting() & (abs(gaps) <= limit)
        finally:
            for f, values in zip(state, kept, strict=True):
                f.x.array[:] = values
        self._closed = np.where(near, gaps, 0.0)
        largest = float(np.max(abs(self._closed), initial=0.0))
        comm = self.primary.mesh.comm
        self._doubt_of_closed = TILTED * comm.allreduce(largest, MPI.MAX)
        self.anchor()

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
        cosine = np.array([np.min(outward @ direction) for direction in directions])
        near = nearest_faces(self.faces, face_x, x[own])
        reach, over = self.policy.distance(self.faces), near.overhang <= TIE
        looks = np.sum(outward[near.face] * directions, axis=1) < 0.0
        lost = np.where(over & looks & (near.gap < -reach), -near.gap, 0.0)
        gap = np.where(over & (near.gap >= -reach), near.gap - self.offset, np.inf)
        return View(cosine, gap, lost)

    @abstractmethod
    def couples(self) -> tuple[Indices, Indices]:
        """Return owned nodes and nodes of the primary surface that they meet now, in pairs."""

    def crossed(self, closed: Mask) -> Mask:
        """Tell which nodes have gone through faces since the last step; collective."""
        node, other = self.couples()
        held = closed[node]
        met = _beside(self.faces, node[held], other[held], len(closed))
        nodes, faces = self._trails()
        motion = faces.seen_by(nodes, self._secondary.own, self.behind, self._doubt)
        return find_crossed(self.faces, motion, self.started(), met) >= 0

    def pierced(self, closed: Mask) -> Mask:
        """Tell which nodes have faces that nodes of the obstacle have gone through; collective.

        What contact holds is on average in front of the faces round its node.
        """
        node, other = self.couples()
        held, own, mine = closed[node], self._secondary.own, self.faces.own
        pairs = np.column_stack([other[held], node[held] + own.start])
        of_all = np.concatenate(self.primary.mesh.comm.allgather(pairs))
        i, j = of_all[(of_all[:, 0] >= mine.start) & (of_all[:, 0] < mine.stop)].T
        met = _beside(self._secondary, i - mine.start, j, mine.stop - mine.start)
        faces, nodes = self._trails()
        motion = faces.seen_by(nodes, mine, DEEP, self._doubt)
        started = self._faces_at_start(self._secondary, self.faces)
        entered = find_crossed(self._secondary, motion, started, met)
        entered = np.concatenate(self.primary.mesh.comm.allgather(entered[entered >= 0]))
        return np.isin(np.arange(own.start, own.stop), self._secondary.faces[entered])

    def _trails(self) -> tuple[Trail, Trail]:
        """Return the ways of the secondary and of the primary nodes in this step; collective."""
        ends = (self.side.u_old, self.side.u)
        offset = self._secondary.gather(self.offset)
        return Trail.of(self._secondary, ends, offset), Trail.of(self.faces, ends)

    def stiffness(self, diagonal: Array, V: fem.FunctionSpace) -> float:
        """Return the smallest stiffness over area (Pa/m) of the primary nodes; collective."""
        n = self.primary.num_owned
        values = diagonal[self.primary.parent_dofs(V)[:n]] / self.primary.area.x.array[:n]
        comm = self.primary.mesh.comm
        return float(comm.allreduce(float(np.min(values, initial=np.inf)), MPI.MIN))


def _beside(faces: FaceSet, i: Indices, j: Indices, number: int) -> scipy.sparse.csr_array:
    """Return which of so many nodes (rows) meet a node of which faces (columns).

    Args:
        faces: The faces.
        i: Nodes that meet others.
        j: The nodes of the faces that they meet.
        number: As said.
    """
    corners = faces.faces
    shape = (len(faces.X), len(corners))
    face = np.repeat(np.arange(len(corners)), corners.shape[1])
    around = scipy.sparse.csr_array((np.ones(face.size), (corners.ravel(), face)), shape=shape)
    meets = scipy.sparse.csr_array((np.ones(len(i)), (i, j)), shape=(number, len(faces.X)))
    return scipy.sparse.csr_array(meets @ around)
