# SPDX-License-Identifier: MIT
"""Nodes against faces, of another body or of a rigid tool: both in view."""

from __future__ import annotations

from abc import abstractmethod

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from ..base.errors import ContactInputError
from ..surfaces.faces import Faces, FaceSet
from .crossing import DEPTH, Motion, find_crossed
from .obstacle import Mask, Pairing
from .search import SearchPolicy, find_pairs

#: An offset is known along the node's own normal: part of it by which it is in doubt.
TILTED = 0.1


class AgainstFaces(Pairing):
    """A secondary surface that meets faces.

    Attributes:
        faces: The faces, on all ranks.
        policy: How they are searched.
        offset: What is subtracted from the gap of each owned node (m), see :meth:`close_gaps`.
        other: What the faces are, for messages.
    """

    tilted = True
    #: A node has crossed a face from this fraction of the mean face on.
    behind = DEPTH

    faces: Faces
    policy: SearchPolicy
    _secondary: FaceSet

    def _face(self, faces: Faces, secondary: FaceSet, policy: SearchPolicy, other: str) -> None:
        """Take the faces, and the secondary surface as these see it."""
        self.faces, self._secondary, self.policy, self.other = faces, secondary, policy, other
        self.offset, self._doubt = np.zeros(self.side.surface.num_owned), 0.0

    def started(self) -> npt.NDArray[np.int64]:
        """Return the face of each node at the start of the step, or -1; collective."""
        u_old = self.side.u_old
        x, own = self._secondary.positions(u_old), self._secondary.own
        held, directions = np.ones(own.stop - own.start, bool), self._secondary.node_normals(x)
        parts = (self.faces, self.faces.positions(u_old), x[own], directions[own], self.policy)
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
            self.offset = np.zeros_like(self.offset)
            self.anchor()
            gaps = self.gaps().copy()
            near = self.meeting() & (abs(gaps) <= limit)
        finally:
            for f, values in zip(state, kept, strict=True):
                f.x.array[:] = values
        self.offset = np.where(near, gaps, 0.0)
        largest = float(np.max(abs(self.offset), initial=0.0))
        comm = self.side.surface.mesh.comm
        self._doubt = TILTED * comm.allreduce(largest, MPI.MAX) / self.faces.size
        self.anchor()

    def crossed(self, closed: Mask) -> Mask:
        """Tell which nodes have gone through faces since the last step; collective."""
        ends = (self.side.u_old, self.side.u)
        motion = Motion.between(self.faces, self._secondary, ends, self.offset)
        depth = self.behind + self._doubt
        return find_crossed(self.faces, motion, ~closed, self.started(), depth)
