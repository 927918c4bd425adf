# SPDX-License-Identifier: MIT
"""Weighted contact with a rigid obstacle, for displacements with dofs on edges and faces.

Such displacements have no consistent force at a vertex: on a triangle with quadratic shape
functions it is zero. Gap and slip of a node are therefore averages over its faces, with the hat of
its vertex as weight, and its force acts where these averages come from: its virtual work is area
times multiplier times virtual gap. One law a node remains.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from ..base.errors import ContactInputError
from ..surfaces.elements import degree_on_facets
from ..surfaces.face_cells import normals
from ..surfaces.face_points import FacePoints
from ..surfaces.face_tables import gauss, lattice
from ..surfaces.faces import FaceSet
from ..surfaces.nodal_kernel import NodalKernel, Sites
from .averaged import WEIGHTLESS, Averaged
from .between import Between
from .kinematics import Array, frame_slopes, frames, slices
from .pairing import Mask
from .rigid_pairing import Rigid, RigidPairing
from .side import Side

#: Cosine of the normals of a face and of its node below which there is a corner: 74 degrees or more
#: between two faces.
KINK = 0.8


class WeightedPairing(Averaged, RigidPairing):
    """Nodes that meet a rigid obstacle on average over their faces.

    A stencil are the displacement's dofs of the faces round the node.

    Args:
        obstacle: The obstacle.
        side: The side.

    Attributes:
        points: The points of the averages.
        axis: Mean normal of each node at the start of a step, carried along by the obstacle. Its
            frame is carried to the points.
    """

    nodal, tilted = False, True

    def __init__(self, obstacle: Rigid, side: Side) -> None:
        V = side.u.function_space
        degree = degree_on_facets(V)
        self.points = FacePoints(side.surface, V, gauss(side.surface, 2 * degree))
        self._nodes = FacePoints(side.surface, V, lattice(side.surface, degree))
        _check_kinks(side)
        self.axis = fem.Function(side.hint.function_space, name="mean_normal")
        super().__init__(obstacle, side)
        self._watch()
        self.anchor()

    def _watch(self) -> None:
        """Look for the obstacle at points and nodes of the faces; collective."""
        gap, _ = self.near.gap_and_normal(
            ufl.SpatialCoordinate(self.side.surface.mesh), self.side.u
        )
        self._gaps = NodalKernel(self._nodes, ufl.as_vector([gap]))
        self._between = Between(self.obstacle, self.side, self.points, self._gaps_and_normals)

    def _axis(self) -> fem.Function:
        """Return the mean normals at the start of the step."""
        return self.axis

    def _sites(self) -> Sites:
        """Return the points of the averages."""
        return self.points

    # -- kinematics ------------------------------------------------------------------------------

    def averages(self, values: Array) -> Array:
        """Return the averages of the nodes."""
        return self.points.average(values)

    def node_of_site(self) -> npt.NDArray[np.int64]:
        """Return the node of each point."""
        return self.points.node_of_point

    def spread(self, values: Array) -> Array:
        """Return the averages times the shape functions."""
        return self.points.spread(values)

    def derivatives(self) -> tuple[Array, None]:
        """Return the derivatives of the field by the displacements of the stencil."""
        at_points = self.kernel.derivatives()[0]
        number, entries, d = at_points.shape
        n, m = self.points.stencil.shape
        slopes = self.points.spread(at_points.reshape(number, entries * d)).reshape(
            n, m, entries, d
        )
        return slopes.transpose(0, 2, 1, 3).reshape(n, entries, m * d), None

    def weights(self) -> Array:
        """Return the shares of the force at a plane."""
        return np.asarray(self.points.spread(np.ones((self.points.num_owned, 1)))[:, :, 0])

    def levers(self) -> Array:
        """Return the forces of unit multipliers over the area."""
        d = self.side.d
        at_points = frames(self.kernel.values(), d).reshape(-1, d * d)
        levers = self.points.spread(at_points)
        n, m, _ = levers.shape
        return levers.reshape(n, m, d, d).transpose(0, 2, 1, 3)

    def turning(self, slopes: Array, weight_slopes: Array | None) -> list[Array]:
        """Return how displacements turn the forces (N/m): not at all at a plane."""
        values, at_points = self.kernel.values(), self.kernel.derivatives()[0]
        d, (n, m) = self.side.d, self.points.stencil.shape
        c = self.side.nodal(self.side.c)[self.points.node_of_point]
        turned = np.einsum("nk,nkdz->ndz", c, frame_slopes(values, at_points, d))
        if not np.any(turned):
            return [np.zeros((n, m * d, m * d))]
        spread = self.points.spread_twice(turned.reshape(-1, d * d)).reshape(n, m, m, d, d)
        blocks = spread.transpose(0, 1, 3, 2, 4).reshape(n, m * d, m * d)
        return [blocks * self.area()[:, None, None]]

    def gather(self, values: npt.NDArray, missing: float = 0.0) -> npt.NDArray:
        """Return the entries at the stencils."""
        return np.asarray(self.points.gather(values, missing))

    def area(self) -> Array:
        """Return the integrals of the nodes' hats."""
        return np.asarray(self.points.area)

    def acting(self) -> tuple[Array, Array]:
        """Return all points (m) and the forces on the body there (N)."""
        points, values = self.points, self.kernel.values()
        c = self.side.nodal(self.side.c)[points.node_of_point]
        areas = (self.acting_area()[points.node][:, None] * points.share).ravel()
        forces = np.einsum("p,pk,pkd->pd", areas, c, frames(values, self.side.d))
        return values[:, slice(*slices(self.side.d)[-1])], forces

    # -- what else is asked of an obstacle -------------------------------------------------------

    def penetration(self) -> float:
        """Return the largest penetration of a point (m), on this rank; corners count, too."""
        return max(float(np.max(depth, initial=0.0)) for depth in self._depths())

    def _depths(self) -> tuple[Array, Array]:
        """Return how deep points and nodes of the faces are in the obstacle (m); collective."""
        return self._between.depths(), -self._gaps.values()[:, 0]

    def held_depths(self, held: fem.Function) -> Array:
        """Return how deep wholly held nodes of the faces are in the obstacle (m), else ``-inf``."""
        nodes = self._nodes
        fixed = np.all(nodes.interpolate(nodes.gather_all(held.x.array)) > 1.0 - 1e-6, axis=1)
        return np.where(fixed, self._depths()[1], -np.inf)

    def missed(self, closed: Mask) -> Mask:
        """Tell which open nodes have faces that the obstacle enters deeply; collective."""
        at_points, at_nodes = self._depths()
        found = self._between.entered(self.points, at_points, closed)
        return found | self._between.entered(self._nodes, at_nodes, closed)

    def partners(self, V: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """Return this rank's (blocked) dofs on the surface."""
        return self.points.owned_dofs

    def anchor(self) -> None:
        """Find the mean normals where the body was, carried along by the obstacle; collective."""
        mean = self.points.average(self._between.normals_at_start())
        length = np.linalg.norm(mean, axis=1, keepdims=True)
        self.side.nodal(self.axis)[:] = mean / np.where(length > 0.0, length, 1.0)
        self.axis.x.scatter_forward()

    def on_plane(self, still: Mask) -> Mask:
        """Tell in which directions the obstacle does not move the points that the nodes are at."""
        X, n = self.side.surface.x[:, : self.side.d], self.side.surface.num_owned
        old = X + self.side.owned(self.side.u_old.x.array)
        motion = self.obstacle.motion
        moved = np.zeros((n, self.side.d)) if motion is None else motion.carried(old) - old
        return np.asarray(abs(moved) <= WEIGHTLESS * (1.0 + abs(old)))

    def crossed(self, closed: Mask) -> Mask:
        """Tell which open nodes have points that passed right through the obstacle; collective."""
        return self._between.crossed(closed)

    def _gaps_and_normals(self) -> tuple[Array, Array]:
        """Return gaps and normals at the points; collective."""
        values = self.kernel.values()
        return values[:, 0], values[:, slice(*slices(self.side.d)[2])]


def _check_kinks(side: Side) -> None:
    """Raise where a surface goes round a corner: averages over both sides of it mean nothing.

    Raises:
        ContactInputError: On all ranks.
    """
    faces = FaceSet(side.surface, side.u)
    center = np.tile(faces.cell.center, (len(faces.faces), 1))
    of_faces = normals(faces.cell, faces.X[faces.faces], center)
    of_nodes = faces.node_normals(faces.X)[faces.faces]
    cosine = np.einsum("fd,fvd->fv", of_faces, of_nodes)
    if np.min(cosine, initial=1.0) < KINK:
        where = faces.X[faces.faces[np.unravel_index(np.argmin(cosine), cosine.shape)]]
        place = ", ".join(f"{x:.6g}" for x in where)
        raise ContactInputError(
            f"Contact surface '{side.surface.name}' goes round a corner at ({place}). A "
            "displacement of degree 2 or more meets a rigid obstacle on average over the faces "
            "round each node: give each side of the corner a contact of its own, or tag only the "
            "side that may touch."
        )
