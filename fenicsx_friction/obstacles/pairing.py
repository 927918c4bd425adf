# SPDX-License-Identifier: MIT
"""What each node of a surface meets of an obstacle."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..surfaces.faces import surface_normals
from .following import Follower
from .kinematics import Array, Kinematics, LastFrames, frame_slopes, kinematic_field, slices
from .rigid_body import RigidBody
from .side import Side
from .view import View

Mask = npt.NDArray[np.bool_]


class Pairing(Follower):
    """What each owned node of a side meets: its kinematics, and the points its force acts on.

    The kinematics of a node depend on the displacements of a few points, its *stencil*, the node
    itself first. Its force acts on the first points of the stencil by ``levers``: in proportion to
    ``weights``, whose sum is zero where the other side is deformable. A new kind of contact brings
    a stencil, the field and their derivatives; nothing else is asked of an obstacle.

    Args:
        side: The side.

    Attributes:
        field: The kinematics as a field, see :mod:`~fenicsx_friction.obstacles.kinematics`.
        kinematics: The same in UFL.
        deformable: Whether the other side is deformable.
        early: Whether what nodes meet does not depend on what they met on the way there.
        bondable: Whether its nodes may be tied to what they meet.
        tilted: Whether normals are those of faces or averages, a bit off the obstacle's own.
        body: The obstacle as a body that carries loads, if it is one.
        loaded: On how many points of its stencil a node's force acts; by default on all.
        version: Changes with the stencils.
        lost: Owned nodes whose gap is not known at the present displacement, if any.
    """

    deformable = early = tilted = False
    bondable = True
    loaded: int | None = None
    body: RigidBody | None = None
    version = 0
    lost: Mask | None = None

    def __init__(self, side: Side) -> None:
        self.side, self.field = side, kinematic_field(side.surface)
        self.kinematics, self._frames_of = Kinematics.of(self.field, side.d), LastFrames()

    # -- kinematics ------------------------------------------------------------------------------

    @abstractmethod
    def derivatives(self) -> tuple[Array, Array | None]:
        """Return the derivatives of field and weights by the stencil's positions, flattened.

        They are those of the last :meth:`update`. ``None`` for weights that do not change.
        """

    @abstractmethod
    def weights(self) -> Array:
        """Return the shares of the force, (nodes, points): one for the node, first."""

    def levers(self) -> Array:
        """Return the forces of unit multipliers over the area: (nodes, d, points, d); collective.

        They are conjugate to gap and slip, at fixed frames: virtual work is that of the gap.
        """
        return np.asarray(self.weights()[:, None, :, None] * self.frames()[:, :, None])

    def forces(self, c: Array) -> Array:
        """Return the forces of multipliers over the area: (nodes, points, d); collective."""
        return np.asarray(np.einsum("nk,nkpd->npd", c, self.levers()))

    def turning(self, slopes: Array, weight_slopes: Array | None) -> list[Array]:
        """Return how displacements turn the forces (N/m): (blocks, rows, columns); collective.

        The multipliers are those of now. The arguments are those of :meth:`derivatives`. One block
        a node, unless :meth:`turned` says otherwise.
        """
        d, c = self.side.d, self.side.nodal(self.side.c)
        turned = np.einsum("nk,nkdz->ndz", c, frame_slopes(self.values(), slopes, d))
        result = self.weights()[:, :, None, None] * turned[:, None]
        if weight_slopes is not None:
            result += self.traction()[:, None, :, None] * weight_slopes[:, :, None]
        result *= self.area()[:, None, None, None]
        n, points, d, z = result.shape
        return [result.reshape(n, points * d, z)]

    def turned(self, values: npt.NDArray, missing: float) -> list[tuple[npt.NDArray, npt.NDArray]]:
        """Return entries as :meth:`gather` does, at the rows and columns of these blocks."""
        around = self.gather(values, missing)
        n, points, d = around.shape
        columns = around.reshape(n, points * d)
        return [(columns[:, : (self.loaded or points) * d], columns)]

    def acting(self) -> tuple[Array, Array]:
        """Return points (m) and the forces on the body there (N), one row each; collective."""
        return self.positions(), self.area()[:, None] * self.traction()

    def penetration(self) -> float:
        """Return the largest penetration of a point (m), on this rank; collective."""
        return float(np.max(-self.gaps(), initial=0.0))

    def area(self) -> Array:
        """Return the areas of the owned nodes (m²; m per unit depth in 2D)."""
        return self.side.surface.area.x.array[: self.side.surface.num_owned]

    def acting_area(self) -> Array:
        """Return the parts of the areas on which forces act."""
        return self.area()

    @abstractmethod
    def gather(self, values: npt.NDArray, missing: float = 0.0) -> npt.NDArray:
        """Return the entries of a local array over the displacement's dofs at the stencils.

        Args:
            values: One entry a dof, owned and ghost.
            missing: Stands for points that a stencil does not have.

        Returns:
            One row a node: (nodes, points, d); collective.
        """

    def values(self) -> Array:
        """Return the entries of the field now, one row an owned node; collective."""
        self.update()
        n, size = self.side.surface.num_owned, self.field.function_space.dofmap.bs
        return self.field.x.array[: n * size].reshape(n, size)

    def gaps(self) -> Array:
        """Return the gaps (m); collective."""
        return self.values()[:, 0]

    def slips(self) -> Array:
        """Return the slips of the step (m) in the frames; collective."""
        return self.values()[:, slice(*slices(self.side.d)[1])]

    def normals(self) -> Array:
        """Return the unit normals towards the body; collective."""
        return self.values()[:, slice(*slices(self.side.d)[2])]

    def positions(self) -> Array:
        """Return the current positions (m); collective."""
        return self.values()[:, slice(*slices(self.side.d)[-1])]

    def frames(self) -> Array:
        """Return the frames ``(n, e_1[, e_2])``, (nodes, d, d); collective."""
        return self._frames_of(self.values(), self.side.d)

    def traction(self) -> Array:
        """Return the tractions of the multipliers in global axes (Pa); collective."""
        return np.asarray(np.einsum("nk,nkd->nd", self.side.nodal(self.side.c), self.frames()))

    # -- what else is asked of an obstacle -------------------------------------------------------

    def view(self, u: fem.Function) -> View:
        """Return how the obstacle looks at the surface at a displacement; collective."""
        cosine = np.sum(self.normals() * surface_normals(self.side.surface, u), axis=1)
        gap = self.gaps().copy()
        return View(cosine, gap, np.zeros_like(gap))

    def stiffness(self, diagonal: Array, V: fem.FunctionSpace) -> float:
        """Return the smallest stiffness over area (Pa/m) of the obstacle's nodes; collective.

        Args:
            diagonal: Mean diagonal of the bulk stiffness (N/m) at the local (blocked) dofs.
            V: Space of the displacement.
        """
        return float("inf")

    def partners(self, V: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """Return the (blocked) dofs of this rank's nodes that the side may meet."""
        return np.zeros(0, dtype=np.int32)

    def rounding(self) -> Array:
        """Return lengths (m), one an owned node, whose rounding gaps and slips contain; collective.

        They come from coordinates and from the obstacle's motion; displacements count apart.
        """
        return np.zeros(self.side.surface.num_owned)

    def crossed(self, closed: Mask) -> Mask:
        """Tell which owned nodes have gone through the obstacle in the step; collective."""
        return np.zeros(len(closed), dtype=bool)

    def pierced(self, closed: Mask) -> Mask:
        """Tell which nodes have faces that nodes of the obstacle have gone through; collective."""
        return np.zeros(len(closed), dtype=bool)

    def sunk(self) -> Mask:
        """Tell which owned nodes are deep in the obstacle, beside what they meet; collective."""
        return np.zeros(self.side.surface.num_owned, dtype=bool)

    def held_depths(self, held: fem.Function) -> Array:
        """Return how deep held points beside the nodes are in the obstacle (m)."""
        return np.zeros(0)

    def missed(self, closed: Mask) -> Mask:
        """Tell which nodes that are not closed have the obstacle deep in faces; collective."""
        return np.zeros(len(closed), dtype=bool)

    def askew(self, closed: Mask, held: Mask) -> Mask:
        """Tell which closed nodes press in a wrong direction; held dofs count not; collective."""
        return np.zeros(len(closed), dtype=bool)

    def prescribed(self, fixed: fem.Function, nodes: Mask, still: Mask) -> Mask:
        """Return which directions are prescribed to both sides; collective.

        Args:
            fixed: 1 at the prescribed dofs of the displacement, else 0.
            nodes: The same for the owned nodes of the surface, one row a node.
            still: The prescribed dofs that do not move in this step, as on symmetry planes.
        """
        return nodes

    # -- from step to step -----------------------------------------------------------------------

    def anchor(self) -> None:
        """Begin an increment at ``u_old``; collective."""

    def begin_search(self) -> None:
        """Begin a series of searches, in which nodes that go to and fro keep their faces."""

    def search(self) -> bool:
        """Look again for what each node meets, after a solve; collective.

        Returns:
            Whether it has changed for any node of any rank.
        """
        return False

    def save(self) -> object:
        """Return what a step changes here, the obstacle's motion aside; not collective."""
        return None

    def restore(self, saved: Any) -> None:
        """Put back what :meth:`save` returned, bit for bit; not collective."""
