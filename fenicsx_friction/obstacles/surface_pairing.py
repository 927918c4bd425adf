# SPDX-License-Identifier: MIT
"""Nodes that meet the faces of a rigid tool."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from .against_tool import AgainstTool
from .face_pairs import FacesMet
from .kinematics import Array
from .pairing import Mask
from .rigid_pairing import RigidPairing
from .side import Side


class _FacesOfTool(FacesMet):
    """The faces of a tool that nodes meet within a step; steep ones, too, as walls in their way."""

    facing = 0.0


class SurfacePairing(AgainstTool, RigidPairing):
    """Nodes that meet the faces of a rigid tool: each stencil is the node alone.

    The plane that a node meets is a field at the nodes. So the tool may be moved, or a body that
    carries loads, as any other rigid obstacle.

    Args:
        obstacle: The tool.
        side: The side.
    """

    near: Any

    def __init__(self, obstacle: Any, side: Side) -> None:
        super().__init__(obstacle, side)
        tool, n = self._take(obstacle), side.surface.num_owned
        self._planes = self.near.planes.x.array.reshape(-1, 2 * side.d + 2)[:n]
        self._met = _FacesOfTool(tool.faces, tool.secondary, tool.policy, side)
        self._start()

    def _axis(self) -> fem.Function | None:
        """Return the normals at the start of a step, from where 3D frames are carried to faces.

        So a node may meet a face at right angles to its last one: hints that were chosen for that
        one might have no tangential part.
        """
        self._normals = fem.Function(self.side.surface.space((self.side.d,)), name="axis")
        return self._normals if self.side.d == 3 else None

    def _start(self) -> None:
        """Write the planes that the nodes meet at the start, and their normals as they are now."""
        self._write()
        d, motion = self.side.d, self.obstacle.motion
        n = self._planes[:, :d]
        if motion is not None:
            n = n + self._planes[:, -1:] * (n @ motion.turned_by().T)
        self._normals.x.array[: n.size] = n.ravel()

    def _write(self) -> None:
        """Write the planes that the owned nodes meet."""
        self._planes[:] = self._tool.planes(
            self._met.pairs, self._rest(), self._outward, self.offset
        )

    def _rest(self) -> Array:
        """Return the owned nodes of the undeformed body (m)."""
        return self.side.surface.x[:, : self.side.d]

    # -- from step to step -----------------------------------------------------------------------

    def anchor(self) -> None:
        """Find the faces that the nodes meet at ``u_old``; collective."""
        self._met.anchor()
        self._start()

    def begin_search(self) -> None:
        """Begin a series of searches."""
        self._met.begin_search()

    def search(self) -> bool:
        """Look again for the faces at the current displacement and motion; collective."""
        changed = self._met.search()
        if changed:
            self._write()
        return changed

    def save(self) -> object:
        """Return the faces met now, at the step's start and between."""
        return self._met.save()

    def restore(self, saved: Any) -> None:
        """Put them back."""
        self._met.restore(saved)
        self._write()

    # -- what else is asked of an obstacle -------------------------------------------------------

    def started(self) -> npt.NDArray[np.int64]:
        """Return the face of each node at the start of the step, or -1."""
        return self._met.start.face

    def meeting(self) -> Mask:
        """Tell which owned nodes have a face."""
        return self._met.pairs.paired

    def couples(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return owned nodes and the nodes of the faces that they meet now, in pairs."""
        return self.couples_of(self._met.pairs)

    def _places(self) -> Iterator[tuple[Array, Array, npt.NDArray[np.int64], Array]]:
        """Yield the nodes."""
        nodes, own = self._secondary, self._secondary.own
        x = nodes.positions(self.side.u)
        met = np.where(self._met.pairs.paired, -self.gaps(), 0.0)
        yield x[own], nodes.node_normals(x)[own], np.arange(len(met)), met

    def rounding(self) -> Array:
        """Return the lengths whose rounding gaps contain: those of planes that are moved."""
        return self._tool.rounding(self._planes, self._rest())
