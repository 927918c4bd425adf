# SPDX-License-Identifier: MIT
"""Deformable obstacles: the surface of another body, met node to face."""

from __future__ import annotations

import warnings
from typing import Any

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from ..base.errors import ContactInputError
from ..surfaces.face_cells import Array, normals, project, shape_matrix
from ..surfaces.faces import FaceSet
from ..surfaces.surface import ContactSurface
from .crossing import Motion, find_crossed
from .obstacle import Kinematics, Obstacle, View
from .pair_kernel import PairGeometry, PairKernel
from .search import TIE, Pairs, SearchPolicy, find_pairs, nearest_faces
from .side import Side

#: Ratio of face sizes from which the secondary surface should be the primary one.
COARSE = 1.5
#: Nodes of a face with less weight have no part in a contact on its edge.
WEIGHTLESS = 1e-8


class DeformableObstacle(Obstacle):
    """The surface of a deformable body (the primary surface) as an obstacle.

    The nodes of the contact's own surface (the secondary one, which should be the finer) meet the
    faces of this one. Each node meets one face at a time; pairs are found at the beginning of a
    step and again after it was solved, until they do not change, see ``SearchPolicy``.

    Args:
        primary: The primary surface, on the same mesh.
        search: How pairs are found.

    Attributes:
        deformable: True.
        pairs: The face of each owned node of the secondary surface.
        faces: The faces of the primary surface on all ranks.
        version: Changes with the pairs.
        lost: Owned nodes whose projection on their face was not found, at the last update.
    """

    deformable = True
    #: What :meth:`save` keeps, beside the faces met: arrays that are replaced, never changed.
    _STATE = ("pairs", "_start", "_old_face", "_old_weights", "version")

    def __init__(self, primary: ContactSurface, *, search: SearchPolicy | None = None) -> None:
        if not isinstance(primary, ContactSurface):
            raise ContactInputError(
                f"DeformableObstacle: primary = {primary!r} must be a ContactSurface, the surface "
                "of the other body."
            )
        if not isinstance(search, SearchPolicy | None):
            raise ContactInputError(
                f"DeformableObstacle: search = {search!r} must be a SearchPolicy, or None."
            )
        self.primary, self.policy = primary, search or SearchPolicy()
        self.version = self._last_version = 0

    def kinematics(self, contact: Side, u: fem.Function, u_old: fem.Function) -> Kinematics:
        """Return kinematics whose parts are fields, which :meth:`update` fills."""
        if hasattr(self, "faces"):
            raise ContactInputError(
                f"The deformable obstacle '{self.primary.name}' already belongs to a contact; "
                "make another one (its surface can be shared)."
            )
        surface, d = contact.surface, contact.surface.mesh.geometry.dim
        self._d, self._u, self._u_old, self._hint, self._c = d, u, u_old, contact.hint, contact.c
        self.faces, self._secondary = FaceSet(self.primary, u), FaceSet(surface, u)
        if self._secondary.size > COARSE * self.faces.size:
            warnings.warn(
                f"The secondary surface '{surface.name}' is coarser (faces of "
                f"{self._secondary.size:.3g} m) than the primary one '{self.primary.name}' "
                f"({self.faces.size:.3g} m): its pressures may chatter; swap them.",
                stacklevel=2,
            )
        n = surface.num_owned
        self._nodes = contact.parent_dofs[:n]
        self._kernel = PairKernel(surface.mesh.comm, self.faces.cell, d, n)
        size = 1 + d * d  # gap, way, normal and in 3D a tangent
        element = basix.ufl.element("Lagrange", surface.submesh.basix_cell(), 1, shape=(size,))
        self.field = fem.Function(fem.functionspace(surface.submesh, element), name="pairs")
        self.anchor()
        q = self.q = ufl.variable(self.field)
        part = lambda k: ufl.as_vector([q[1 + d * k + i] for i in range(d)])  # noqa: E731
        way, normal = part(0), part(1)
        return Kinematics.of(q[0], way, normal, part(2) if d == 3 else normal)

    def rounding(self, contact: Side) -> Array:
        """Return how far away from each node the nodes are that it meets (m)."""
        self.update()
        return np.asarray(np.max(abs(self._now.z), axis=(1, 2)) * self.pairs.paired)

    def stiffness(self, diagonal: Array, V: fem.FunctionSpace) -> float:
        """Return the smallest stiffness over area (Pa/m) of the primary nodes; collective."""
        n, comm = self.primary.num_owned, self.primary.mesh.comm
        values = diagonal[self.primary.parent_dofs(V)[:n]] / self.primary.area.x.array[:n]
        return float(comm.allreduce(float(np.min(values, initial=np.inf)), MPI.MIN))

    # -- pairs -----------------------------------------------------------------------------------

    def anchor(self) -> None:
        """Pair the nodes at ``u_old`` and keep the points of the faces that they meet there."""
        n = self._secondary.own.stop - self._secondary.own.start
        held = self._c.x.array[: n * self._d : self._d] > 0.0
        self.pairs = self._start = self._find(self._u_old, held)
        self._met = [self.pairs.face]
        self._place_old()

    def search(self) -> bool:
        """Look again for the faces at the current displacement; collective."""
        found = self._find(self._u, self.pairs.paired, self.pairs)
        if self._any(back := self._returns(found)):
            found = self._find(self._u, self.pairs.paired, self.pairs, back * self.policy.keep)
        changed = self._any(found.face != self.pairs.face)
        if changed:
            self.pairs = found
            self._met.append(found.face)
            self._place_old()
        return changed

    def view(self, contact: Side, u: fem.Function) -> View:
        """Return how the faces look at the nodes; collective.

        The cosine is the least of all faces, the gap that of the nearest, wherever it looks.
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

    def crossed(
        self,
        contact: Side,
        u: fem.Function,
        u_old: fem.Function,
        closed: npt.NDArray[np.bool_],
    ) -> npt.NDArray[np.bool_]:
        """Tell which nodes have gone through faces since the last step; collective."""
        own = self._secondary.own
        both = [self._secondary.positions(f) for f in (u_old, u)]
        motion = Motion(
            face_x=(self.faces.positions(u_old), self.faces.positions(u)),
            x=(both[0][own], both[1][own]),
            directions=(
                self._secondary.node_normals(both[0])[own],
                self._secondary.node_normals(both[1])[own],
            ),
        )
        return find_crossed(self.faces, motion, ~closed, self._start.face)

    def save(self) -> object:
        """Return the pairs, those of the step's start and all that follows from them."""
        state = tuple(getattr(self, name) for name in self._STATE)
        return state, list(self._met), self.field.x.array.copy()

    def restore(self, saved: Any) -> None:
        """Put the pairs back with their version, which no other pairs ever have."""
        values, met, field = saved
        for name, value in zip(self._STATE, values, strict=True):
            setattr(self, name, value)
        self._met = list(met)
        self.field.x.array[:] = field

    def _returns(self, found: Pairs) -> npt.NDArray[np.bool_]:
        """Tell which nodes would go back to a face that they have met in this step."""
        before = np.any([found.face == face for face in self._met], axis=0)
        return np.asarray(before & (found.face != self.pairs.face))

    def _any(self, flags: npt.NDArray[np.bool_]) -> bool:
        """Tell whether a flag is set on any rank; collective."""
        return bool(self.primary.mesh.comm.allreduce(bool(np.any(flags)), MPI.LOR))

    def _find(
        self,
        u: fem.Function,
        held: npt.NDArray[np.bool_],
        last: Pairs | None = None,
        keep: npt.ArrayLike = 0.0,
    ) -> Pairs:
        """Pair this rank's nodes at a displacement; collective."""
        x, own = self._secondary.positions(u), self._secondary.own
        return find_pairs(
            self.faces,
            self.faces.positions(u),
            x[own],
            self._secondary.node_normals(x)[own],
            self.policy,
            held,
            last,
            keep=keep,
        )

    def _place_old(self) -> None:
        """Find the point that each node met at ``u_old``; collective.

        A node that met none there is traced back to its present face, extended. Later increments
        of slip start from there, whatever faces the node has crossed.
        """
        self.version = self._last_version = self._last_version + 1
        met = self._start.paired
        self._old_face = np.where(met, self._start.face, self.pairs.face)
        corners = self.faces.positions(self._u_old)[self.faces.faces[self._old_face]]
        x = self._secondary.positions(self._u_old)[self._secondary.own]
        xi = np.where(met[:, None], self._start.xi, self.pairs.xi)
        projected = project(self.faces.cell, corners, x, xi)
        xi = np.where(np.isfinite(projected), projected, xi)
        self._old_weights = shape_matrix(self.faces.cell, xi)

    # -- kinematics --------------------------------------------------------------------------

    def update(self) -> None:
        """Evaluate the contact element at the current displacement; collective."""
        self._now = self._geometry()
        values = self._kernel.values(self._now)
        n, size = len(values), self.field.function_space.dofmap.bs
        rows = self.field.x.array[: n * size].reshape(n, size)
        rows[:] = values[:, :size]
        alone = ~self.pairs.paired
        if np.any(alone):
            rows[alone] = self._without_face(alone)
        self.field.x.scatter_forward()
        self.weights = values[:, size:]

    def derivatives(self) -> tuple[Array, Array]:
        """Return the derivatives of the fields and of the shape functions by all positions.

        They are those of the last :meth:`update`.

        Returns:
            Arrays (n, size of the field or nodes of a face, dofs of the element), zero for nodes
            without a face.
        """
        values = self._kernel.derivatives(self._now)
        size = self.field.function_space.dofmap.bs
        nodes = self.faces.cell.nodes
        values = values.reshape(len(values), size + nodes, self._d * (1 + 2 * nodes))
        values[~self.pairs.paired] = 0.0
        return values[:, :size], values[:, size:]

    def nodes(self) -> npt.NDArray[np.int64]:
        """Return the primary nodes of each pair: of its face, then of its old face."""
        return np.hstack([self.faces.faces[self.pairs.face], self.faces.faces[self._old_face]])

    def _geometry(self) -> PairGeometry:
        """Collect the current configuration of this rank's pairs; collective."""
        own, nodes = self._secondary.own, self.nodes()
        u = self._u.x.array.reshape(-1, self._d)[self._nodes]
        # As seen from the node: coordinates and motions of all together round nothing away.
        around = self.faces.X[nodes] - self._secondary.X[own][:, None]
        around += self.faces.gather_dofs(self._u.x.array)[nodes] - u[:, None]
        x = np.zeros_like(u)
        # From the same start whatever was evaluated before: the fields depend on pairs and
        # displacements only, to the last bit.
        start = self.pairs.xi
        xi = project(self.faces.cell, around[:, : self.faces.cell.nodes], x, start)
        found = np.all(np.isfinite(xi), axis=1)
        self.lost = self.pairs.paired & ~found
        xi = np.where(found[:, None], xi, start)
        z = np.concatenate([x[:, None], around], axis=1)
        hint = self._hint.x.array.reshape(-1, self._d)[: len(x)]
        return PairGeometry(z, xi, self._old_weights, hint)

    def _without_face(self, alone: npt.NDArray[np.bool_]) -> Array:
        """Return the field of nodes that meet no face: open, with a frame of their own."""
        d, own = self._d, self._secondary.own
        normal = -self._secondary.node_normals(self._secondary.X)[own][alone]
        reach = self.policy.distance(self.faces)
        parts = [np.full((len(normal), 1), reach), np.zeros_like(normal), normal]
        if d == 3:
            hint = self._hint.x.array.reshape(-1, d)[: len(alone)][alone]
            first = hint - np.sum(hint * normal, axis=1)[:, None] * normal
            length = np.linalg.norm(first, axis=1)[:, None]
            parts.append(first / np.where(length > 0.0, length, 1.0))
        return np.hstack(parts)

    def prescribed(
        self, fixed: fem.Function, nodes: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        """Keep the directions in which the node and all that it meets are prescribed.

        A node without a face keeps up to all but one of its directions, as on symmetry planes.
        """
        primary = self.faces.gather_dofs(fixed.x.array) > 0.5
        self.update()
        face = self.faces.faces[self.pairs.face]
        ignored = abs(self.weights) < WEIGHTLESS
        both = nodes & np.all(primary[face] | ignored[:, :, None], axis=1)
        alone = nodes & ~np.all(nodes, axis=1, keepdims=True)
        return np.where(self.pairs.paired[:, None], both, alone)
