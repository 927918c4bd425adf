# SPDX-License-Identifier: MIT
"""Contact with a rigid obstacle at all nodes of a displacement of degree 2.

On edges, and on the faces of hexahedra, the shape functions of all nodes have positive integrals,
Simpson's weights: a uniform pressure is in balance with forces at the nodes. Each node then has a
gap and a slip of its own, as with degree 1. The obstacle is looked for between the nodes, too.
"""

from __future__ import annotations

import numpy as np
import ufl

from ..surfaces.elements import degree_on_facets
from ..surfaces.face_points import FacePoints
from ..surfaces.face_tables import gauss
from ..surfaces.nodal_kernel import NodalKernel
from .between import Between
from .kinematics import Array
from .pairing import Mask
from .rigid_pairing import Rigid, RigidPairing
from .side import Side


class AllNodesPairing(RigidPairing):
    """All nodes of a displacement of degree 2 that meet a rigid obstacle.

    Args:
        obstacle: The obstacle.
        side: The side.
    """

    def __init__(self, obstacle: Rigid, side: Side) -> None:
        super().__init__(obstacle, side)
        V, X = side.u.function_space, ufl.SpatialCoordinate(side.surface.mesh)
        rule = gauss(side.surface, 2 * degree_on_facets(V))
        points = FacePoints(side.surface, V, rule, by_node=False)
        gap, normal = obstacle.near(side, nodal=False).gap_and_normal(X, side.u)
        kernel = NodalKernel(points, ufl.as_vector([gap, *normal]))

        def read() -> tuple[Array, Array]:
            """Return gaps and normals at the points between."""
            values = kernel.values()
            return values[:, 0], values[:, 1:]

        self._between = Between(obstacle, side, points, read)

    def penetration(self) -> float:
        """Return the largest penetration of a node or of a point between them (m), on this rank."""
        depths = self._between.depths()
        return max(super().penetration(), float(np.max(depths, initial=0.0)))

    def missed(self, closed: Mask) -> Mask:
        """Tell which open nodes have faces that the obstacle enters deeply; collective."""
        return self._between.missed(closed)

    def crossed(self, closed: Mask) -> Mask:
        """Tell which open nodes have passed through the obstacle, or points beside; collective."""
        return super().crossed(closed) | self._between.crossed(closed)
