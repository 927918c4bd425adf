# SPDX-License-Identifier: MIT
"""Points of the faces between the nodes, where a rigid obstacle may be that no node has seen."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..surfaces.face_points import FacePoints
from ..surfaces.faces import surface_normals
from .averaged import DEEP
from .kinematics import Array
from .pairing import Mask
from .rigid_pairing import Rigid
from .side import Side


class Between:
    """Watches points of the faces of a side that meets a rigid obstacle.

    Args:
        obstacle: The obstacle.
        side: The side.
        points: The points.
        read: Returns gaps (m) and normals at the points now; collective.

    Attributes:
        obstacle, side, points: As given.
    """

    def __init__(
        self,
        obstacle: Rigid,
        side: Side,
        points: FacePoints,
        read: Callable[[], tuple[Array, Array]],
    ) -> None:
        self.obstacle, self.side, self.points, self._read = obstacle, side, points, read

    def depths(self) -> Array:
        """Return how deep the points are in the obstacle (m); collective."""
        return -self._read()[0]

    def missed(self, closed: Mask) -> Mask:
        """Tell which open nodes have faces that the obstacle enters deeply; collective."""
        return self.entered(self.points, self.depths(), closed)

    def entered(self, sites: FacePoints, depths: Array, closed: Mask) -> Mask:
        """Tell the same from the depths of other points."""
        deepest = np.zeros(len(closed))
        np.maximum.at(deepest, sites.node_of_point, depths)
        return np.asarray(~closed & (deepest > DEEP * self.side.facet_size()))

    def crossed(self, closed: Mask) -> Mask:
        """Tell which open nodes have points that passed right through the obstacle; collective."""
        points, (start, end) = self.points, self._paths()
        passed = self.obstacle.passed(self, start, end, ~closed[points.node_of_point])
        result = np.zeros(len(closed), dtype=bool)
        result[points.node_of_point[passed]] = True
        return result

    def normals_at_start(self) -> Array:
        """Return the normals where the points were at the start of the step; collective."""
        kept = self.side.u.x.array.copy()
        try:
            return self.look(*self._paths())(0.0)[1]
        finally:
            self.side.u.x.array[:] = kept

    def _paths(self) -> tuple[Array, Array]:
        """Return where the points start, carried along by the obstacle, and end; collective."""
        V, points = self.side.u.function_space, self.points
        X, owned = V.tabulate_dof_coordinates()[:, : self.side.d], points.owned_dofs
        old, new = (X + f.x.array.reshape(X.shape) for f in (self.side.u_old, self.side.u))
        motion = self.obstacle.motion
        old[owned] = old[owned] if motion is None else motion.carried(old[owned])
        self._step = old[owned] - new[owned]
        start, end = (points.interpolate(points.gather_all(x)) for x in (old, new))
        return start, end

    # -- as what travels, see ``passage`` --------------------------------------------------------

    def sizes(self) -> Array:
        """Return the sizes (m) of the facets where the obstacle is met, one a point."""
        return self.side.facet_size()[self.points.node_of_point]

    def outward(self) -> Array:
        """Return the body's outward normals, one a point."""
        normals = surface_normals(self.side.surface, self.side.u)
        return np.asarray(normals[self.points.node_of_point])

    def look(self, start: Array, end: Array) -> Callable[[float], tuple[Array, Array]]:
        """Return what finds gaps and normals on the ways of the points."""
        values, owned = self.side.u.x.array.reshape(-1, self.side.d), self.points.owned_dofs
        end_u = values[owned]

        def at(t: float) -> tuple[Array, Array]:
            """Go to a point of the ways."""
            values[owned] = end_u + (1.0 - t) * self._step
            return self._read()

        return at
