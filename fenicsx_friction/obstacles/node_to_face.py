# SPDX-License-Identifier: MIT
"""Node to face: each node of the secondary surface meets one face of the primary one at a time."""

from __future__ import annotations

import warnings
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import any_rank
from ..surfaces.face_cells import Array, normals, project
from ..surfaces.faces import FaceSet
from ..surfaces.surface import ContactSurface
from .crossing import Motion, find_crossed
from .face_pairs import FacePairs
from .obstacle import Mask, Pairing, View
from .pair_kernel import PairGeometry, PairKernel
from .search import TIE, Pairs, SearchPolicy, nearest_faces
from .side import Side

#: Ratio of face sizes from which the secondary surface should be the primary one.
COARSE = 1.5
#: Smaller weights of a face's nodes count as zero: a contact on an edge does not involve them.
WEIGHTLESS = 1e-8


class NodeToFace(Pairing):
    """Nodes that meet faces of a deformable body.

    A stencil is the node, its face's nodes, and those of the face from where its slip starts.

    Args:
        primary: The primary surface.
        policy: How pairs are found.
        side: The secondary side.

    Attributes:
        faces: The faces of the primary surface on all ranks.
    """

    deformable = tilted = True

    def __init__(self, primary: ContactSurface, policy: SearchPolicy, side: Side) -> None:
        super().__init__(side)
        self.primary, self.policy = primary, policy
        self.faces, self._secondary = FaceSet(primary, side.u), FaceSet(side.surface, side.u)
        self._warn_of_coarse_nodes()
        n = side.surface.num_owned
        self._kernel = PairKernel(side.surface.mesh.comm, self.faces.cell, side.d, n)
        self._primary_dofs = self.partners(side.u.function_space)
        self._inputs_before: tuple[Array, ...] | None = None
        self._history = FacePairs(self.faces, self._secondary, policy, side)

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

    def update(self) -> None:
        """Follow the displacement, as far as it has changed; collective."""
        now, before = self._inputs(), self._inputs_before
        changed = before is None or not all(map(np.array_equal, now, before))
        if not any_rank(self.primary.mesh.comm, changed):
            return
        self._inputs_before = None  # until all is written: an interrupt may come
        self._now = self._geometry()
        values = self._kernel.values(self._now)
        n, size = len(values), self._kernel.size
        width = self.field.function_space.dofmap.bs
        rows = self.field.x.array[: n * width].reshape(n, width)
        rows[:, :size] = values[:, :size]
        alone = ~self.pairs.paired
        if np.any(alone):
            rows[alone, :size] = self._without_face(alone)
        rows[:, size:] = self._secondary.X[self._secondary.own] + self.side.owned(
            self.side.u.x.array
        )
        self.field.x.scatter_forward()
        self._shapes = values[:, size:]
        self._inputs_before = now

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
        return PairGeometry(z, xi, self._history.old_weights, self.side.nodal(self.side.hint))

    def _without_face(self, alone: Mask) -> Array:
        """Return the field of nodes that meet no face: open, with a frame of their own."""
        d, own = self.side.d, self._secondary.own
        normal = -self._secondary.node_normals(self._secondary.X)[own][alone]
        reach = self.policy.distance(self.faces)
        parts = [np.full((len(normal), 1), reach), np.zeros((len(normal), d - 1)), normal]
        if d == 3:
            hint = self.side.nodal(self.side.hint)[alone]
            first = hint - np.sum(hint * normal, axis=1)[:, None] * normal
            length = np.linalg.norm(first, axis=1)[:, None]
            parts.append(first / np.where(length > 0.0, length, 1.0))
        return np.hstack(parts)

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
        return View(cosine, np.where(over & (near.gap >= -reach), near.gap, np.inf), lost)

    def crossed(self, closed: Mask) -> Mask:
        """Tell which nodes have gone through faces since the last step; collective."""
        motion = Motion.between(self.faces, self._secondary, (self.side.u_old, self.side.u))
        return find_crossed(self.faces, motion, ~closed, self._history.start.face)

    def stiffness(self, diagonal: Array, V: fem.FunctionSpace) -> float:
        """Return the smallest stiffness over area (Pa/m) of the primary nodes; collective."""
        values = diagonal[self.partners(V)] / self.primary.area.x.array[: self.primary.num_owned]
        comm = self.primary.mesh.comm
        return float(comm.allreduce(float(np.min(values, initial=np.inf)), MPI.MIN))

    def partners(self, V: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """Return the (blocked) dofs of this rank's primary nodes."""
        return self.primary.parent_dofs(V)[: self.primary.num_owned]

    def rounding(self) -> Array:
        """Return the largest distance of each node from the face nodes that it meets (m)."""
        self.update()
        return np.asarray(np.max(abs(self._now.z), axis=(1, 2)) * self.pairs.paired)

    def prescribed(self, fixed: fem.Function, nodes: Mask) -> Mask:
        """Keep the directions in which the node and all that it meets are prescribed.

        A node without a face keeps its prescribed directions, as on symmetry planes, unless all
        its directions are prescribed.
        """
        primary = self.faces.gather_dofs(fixed.x.array) > 0.5
        self.update()
        face = self.faces.faces[self.pairs.face]
        ignored = abs(self._shapes) < WEIGHTLESS
        both = nodes & np.all(primary[face] | ignored[:, :, None], axis=1)
        alone = nodes & ~np.all(nodes, axis=1, keepdims=True)
        return np.where(self.pairs.paired[:, None], both, alone)
