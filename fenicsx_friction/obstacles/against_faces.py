# SPDX-License-Identifier: MIT
"""Nodes against faces, of another body or of a rigid tool: both in view."""

from __future__ import annotations

from abc import abstractmethod

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy
from dolfinx import fem

from ..base.errors import ContactInputError
from ..surfaces.faces import Faces, FaceSet
from .averaged import DEEP
from .crossing import DEPTH, HELD_DEPTH, Motion, Trail, find_crossed
from .kinematics import Array
from .pairing import Mask, Pairing
from .search import Pairs, SearchPolicy, find_pairs

Indices = npt.NDArray[np.int64]
#: An offset is known along the node's own normal: part of it by which it is in doubt.
TILTED = 0.1
#: Edges may be so many times deeper in faces than the tractions there press these in, or as this
#: part of a face times the angle by which faces are folded there.
SHARPER, BENT = 20.0, 2.0


class AgainstFaces(Pairing):
    """A secondary surface that meets faces.

    Attributes:
        faces: The faces, on all ranks.
        policy: How they are searched.
        clearance: What is added to all gaps (m): a number, or a Constant.
        other: What the faces are, for messages.
    """

    tilted = True
    #: A node has crossed a face from this fraction of the smaller face on.
    behind = DEPTH
    clearance: float | fem.Constant = 0.0

    faces: Faces
    policy: SearchPolicy
    _secondary: FaceSet

    def _face(self, faces: Faces, secondary: FaceSet, policy: SearchPolicy, other: str) -> None:
        """Take the faces, and the secondary surface as these see it."""
        self.faces, self._secondary, self.policy, self.other = faces, secondary, policy, other
        self._closed, self._doubt_of_closed = np.zeros(self.side.surface.num_owned), 0.0

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

    def started(self) -> Indices:
        """Return the face of each node at the start of the step, or -1; collective."""
        return self._faces_at_start(self.faces, self._secondary)

    def _faces_at_start(self, faces: Faces, nodes: FaceSet) -> Indices:
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
                f"close_gaps = {limit:g} m is more than the surfaces "
                f"'{self.side.surface.name}' and {self.other} see, {reach:g} m: give "
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
        comm = self.side.surface.mesh.comm
        self._doubt_of_closed = TILTED * comm.allreduce(largest, MPI.MAX)
        self.anchor()

    @abstractmethod
    def couples(self) -> tuple[Indices, Indices]:
        """Return owned nodes and nodes of the faces that they meet now, in pairs."""

    def couples_of(self, pairs: Pairs) -> tuple[Indices, Indices]:
        """Return these of nodes that meet a face each."""
        node = np.flatnonzero(pairs.paired)
        corners = self.faces.faces[pairs.face[node]]
        return np.repeat(node, corners.shape[1]), corners.ravel()

    def crossed(self, closed: Mask) -> Mask:
        """Tell which nodes have gone through faces since the last step; collective."""
        node, other = self.couples()
        held = closed[node]
        met = beside(self.faces, node[held], other[held], len(closed))
        nodes, faces = self._trails()
        of_node = self._deepest_nodes(self._pressed(closed))
        deep = HELD_DEPTH * self.faces.sizes + self._doubt, of_node
        motion = faces.seen_by(nodes, self._secondary.own, self.behind, self._doubt, deep)
        return self._find_crossed(motion, self.started(), met) >= 0

    def _find_crossed(
        self, motion: Motion, started: Indices, met: scipy.sparse.csr_array | None = None
    ) -> Indices:
        """Return the face that each node has crossed in a step, or -1."""
        return find_crossed(self.faces, motion, started, met)

    def _pressed(self, closed: Mask) -> Array:
        """Return how deep edges may be beside the nodes of all ranks, if closed (m); collective.

        Tractions tell how far they press a massive body in; thin ones are bent by far less.
        """
        body, own = self._secondary, self._secondary.own
        bent = abs(body.folds(body.positions(self.side.u)) - body.folds_at_rest)[own]
        bent *= BENT * body.node_sizes()[own]
        deep = np.maximum(SHARPER * self.side.pressed_in(), bent)
        return np.asarray(body.gather(np.where(closed, deep, 0.0)))

    def _deepest(self, pressed: Array, around: Indices, sizes: Array) -> Array:
        """Return how deep what is met may be in faces (m).

        Beside nodes that contact presses in, edges press between the nodes.

        Args:
            pressed: How deep edges may be beside the nodes (m).
            around: Nodes of each face, of all ranks.
            sizes: Of the faces (m).
        """
        faces, beside = self._secondary.faces, pressed.copy()
        np.maximum.at(beside, faces, np.max(pressed[faces], axis=1)[:, None])
        sharp = np.max(beside[around], axis=1)
        return np.asarray(np.clip(sharp, DEEP * sizes, HELD_DEPTH * sizes) + self._doubt)

    def _deepest_nodes(self, pressed: Array) -> Array:
        """Return how deep the owned nodes may be in faces beside what they meet (m)."""
        body, own = self._secondary, self._secondary.own
        number = np.arange(own.start, own.stop)[:, None]
        return self._deepest(pressed, number, body.node_sizes()[own])

    def _trails(self) -> tuple[Trail, Trail]:
        """Return the ways of the secondary and of the primary nodes in this step; collective."""
        ends = (self.side.u_old, self.side.u)
        offset = self._secondary.gather(self.offset)
        return Trail.of(self._secondary, ends, offset), Trail.of(self.faces, ends)


def beside(faces: Faces, i: Indices, j: Indices, number: int) -> scipy.sparse.csr_array:
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
