# SPDX-License-Identifier: MIT
"""Node to face: each node of the secondary surface meets one face of the primary one at a time."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..surfaces.face_cells import Array, project
from ..surfaces.surface import ContactSurface
from .face_pairs import FacePairs
from .pair_kernel import PairGeometry, PairKernel
from .pairing import Mask
from .search import Pairs, SearchPolicy
from .side import Side
from .two_bodies import Indices, TwoBodies

#: Ratio of face sizes from which the secondary surface should be the primary one.
COARSE = 1.5
#: Smaller weights of a face's nodes count as zero: a contact on an edge does not involve them.
WEIGHTLESS = 1e-8
#: The same above an edge, at most.
BESIDE = 0.1


class NodeToFace(TwoBodies):
    """Nodes that meet faces of a deformable body.

    A stencil is the node, its face's nodes, and those of the face from where its slip starts.
    """

    _met: type[FacePairs] = FacePairs

    def __init__(self, primary: ContactSurface, policy: SearchPolicy, side: Side) -> None:
        super().__init__(primary, policy, side)
        self._warn_of_coarse_nodes()
        self.loaded = 1 + self.faces.cell.nodes
        n = side.surface.num_owned
        self._kernel = PairKernel(side.surface.mesh.comm, self.faces.cell, side.d, n)
        self._primary_dofs = self.partners(side.u.function_space)
        self._history = self._met(self.faces, self._secondary, policy, side)

    def _warn_of_coarse_nodes(self) -> None:
        """Warn where the secondary surface should be the primary one."""
        if self._secondary.size > COARSE * self.faces.size:
            warnings.warn(
                f"The secondary surface '{self.side.surface.name}' is coarser (faces of "
                f"{self._secondary.size:.3g} m) than the primary one '{self.primary.name}' "
                f"({self.faces.size:.3g} m): its pressures may chatter; swap them.",
                stacklevel=2,
            )

    # -- kinematics ------------------------------------------------------------------------------

    def _fill(self, rows: Array) -> None:
        """Evaluate the elements of all pairs."""
        self._now = self._geometry()
        values, size = self._kernel.values(self._now), self._kernel.size
        rows[:, :size] = values[:, :size]
        alone = ~self.pairs.paired
        if np.any(alone):
            rows[alone, :size] = self.alone(alone)
        rows[:, size:] = self._places()
        self._shapes = values[:, size:]

    def derivatives(self) -> tuple[Array, Array | None]:
        """Return the derivatives of field and weights by the stencil's positions."""
        values = self._kernel.derivatives(self._now)
        n, size, d = len(values), self._kernel.size, self.side.d
        nodes = self.faces.cell.nodes
        values = values.reshape(n, size + nodes, d * (1 + 2 * nodes))
        values[~self.pairs.paired] = 0.0
        position = np.zeros((n, d, values.shape[2]))
        position[:, :, :d] = np.eye(d)
        of_weights = np.concatenate([0.0 * values[:, :1], -values[:, size:]], axis=1)
        return np.concatenate([values[:, :size], position], axis=1), of_weights

    def weights(self) -> Array:
        """Return the shares: action on the node, reaction on the face, none on the old one."""
        shapes = np.where(self.pairs.paired[:, None], self._shapes, 0.0)
        return np.concatenate([np.ones((len(shapes), 1)), -shapes], axis=1)

    def gather(self, values: npt.NDArray, missing: float = 0.0) -> npt.NDArray:
        """Return the entries at the nodes, at those of their faces and of their old faces."""
        around = self.faces.gather_dofs(values)[self.nodes()]
        around[~self.pairs.paired] = missing
        return np.concatenate([self.side.owned(values)[:, None], around], axis=1)

    def nodes(self) -> npt.NDArray[np.int64]:
        """Return the primary nodes of each pair: of its face, then of its old face."""
        return self._history.nodes()

    def _inputs(self) -> tuple[Array, ...]:
        """Return all of this rank that the kinematics depend on."""
        u, hint = self.side.u.x.array, self.side.nodal(self.side.hint).copy()
        return self.side.owned(u), u.reshape(-1, self.side.d)[self._primary_dofs], hint

    def _geometry(self) -> PairGeometry:
        """Collect the current configuration of this rank's pairs, with each node at the origin.

        So neither large coordinates nor a common motion add rounding.
        """
        own, u = self._secondary.own, self.side.u.x.array
        around = self.faces.gather_dofs(u)[self.nodes()] - self.side.owned(u)[:, None]
        around += self.faces.X[self.nodes()] - self._secondary.X[own][:, None]
        x = np.zeros((len(around), self.side.d))
        # Newton's start does not depend on earlier evaluations: the fields depend on pairs and
        # displacements only, to the last bit.
        start = self.pairs.xi
        xi = project(self.faces.cell, around[:, : self.faces.cell.nodes], x, start)
        found = np.all(np.isfinite(xi), axis=1)
        self.lost = self.pairs.paired & ~found
        xi = np.where(found[:, None], xi, start)
        z = np.concatenate([x[:, None], around], axis=1)
        hint = self.side.nodal(self.side.hint)
        return PairGeometry(z, xi, self._history.old_xi, self.offset, hint)

    # -- from step to step -----------------------------------------------------------------------

    @property
    def pairs(self) -> Pairs:
        """The face of each owned node of the secondary surface."""
        return self._history.pairs

    @property
    def version(self) -> int:  # type: ignore[override]
        """Changes with the pairs."""
        return self._history.version

    def anchor(self) -> None:
        """Pair the nodes at ``u_old`` and keep the points of the faces that they meet there."""
        self._history.anchor()
        self._inputs_before = None

    def begin_search(self) -> None:
        """Begin a series of searches."""
        self._history.begin_search()

    def search(self) -> bool:
        """Look again for the faces at the current displacement; collective."""
        changed = self._history.search()
        if changed:
            self._inputs_before = None
        return changed

    def save(self) -> object:
        """Return the pairs, those of the step's start and all that follows from them."""
        return self._history.save()

    def restore(self, saved: Any) -> None:
        """Put the pairs back with their version, which no other pairs ever have."""
        self._history.restore(saved)
        self._inputs_before = None

    # -- what else is asked of an obstacle -------------------------------------------------------

    def started(self) -> npt.NDArray[np.int64]:
        """Return the face of each node at the start of the step, or -1."""
        return self._history.start.face

    def meeting(self) -> Mask:
        """Tell which owned nodes have a face."""
        return self.pairs.paired

    def couples(self) -> tuple[Indices, Indices]:
        """Return nodes and the nodes of their faces."""
        return self.couples_of(self.pairs)

    def partners(self, V: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """Return the (blocked) dofs of this rank's primary nodes."""
        return self.primary.parent_dofs(V)[: self.primary.num_owned]

    def rounding(self) -> Array:
        """Return the largest distance of each node from the face nodes that it meets (m)."""
        self.update()
        return np.asarray(np.max(abs(self._now.z), axis=(1, 2)) * self.pairs.paired)

    def prescribed(self, fixed: fem.Function, nodes: Mask, still: Mask) -> Mask:
        """Keep the directions in which the node and all that it meets are prescribed.

        A node without a face keeps its prescribed directions, as on symmetry planes, unless all
        its directions are prescribed.
        """
        primary = self.faces.gather_dofs(fixed.x.array) > 0.5
        self.update()
        face = self.faces.faces[self.pairs.face]
        # The foot of a node above an edge is beside the edge where the face is inclined.
        away = abs(self.gaps() + self.offset) / self.faces.size
        ignored = abs(self._shapes) < np.minimum(WEIGHTLESS + away, BESIDE)[:, None]
        both = nodes & np.all(primary[face] | ignored[:, :, None], axis=1)
        alone = nodes & ~np.all(nodes, axis=1, keepdims=True)
        return np.where(self.pairs.paired[:, None], both, alone)
