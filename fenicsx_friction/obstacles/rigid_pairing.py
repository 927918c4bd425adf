# SPDX-License-Identifier: MIT
"""Nodes that meet a rigid obstacle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from ..base.collective import any_rank
from ..surfaces.nodal_kernel import NodalKernel, Sites
from .kinematics import Array
from .motion import Motion
from .pairing import Mask, Pairing
from .passage import ways
from .rigid_body import RigidBody
from .side import Side


class Rigid(Protocol):
    """What a pairing asks of a rigid obstacle, see :mod:`~fenicsx_friction.obstacles.rigid`."""

    @property
    def motion(self) -> Motion | None:
        """Moves the obstacle."""

    def near(self, side: Side, *, nodal: bool = True) -> Rigid:
        """Return the same obstacle with a gap that loses no digits at a side."""

    def gap_and_normal(self, X: Expr, u: Expr) -> tuple[Expr, Expr]:
        """Return gap (m) and unit normal of a node."""

    def kinematic_values(
        self, X: Expr, u: Expr, u_old: Expr, hint: Expr, axis: Expr | None = None
    ) -> Expr:
        """Return the entries of the kinematic field."""

    def rounding(self, pairing: Any) -> Array:
        """Return the lengths (m) whose rounding gaps contain."""

    def passed(self, pairing: Any, start: Array, end: Array, open_: Mask) -> Mask:
        """Tell which open points pass through the obstacle."""


class RigidPairing(Pairing):
    """Nodes that meet a rigid obstacle: each stencil is the node alone.

    Args:
        obstacle: The obstacle.
        side: The side.

    Attributes:
        obstacle: As given.
        near: The same, with a gap that loses no digits.
        kernel: The kinematics where the obstacle is met, with their derivatives.
        nodal: Whether the obstacle is met at the nodes, not at other points.
    """

    nodal = True

    def __init__(self, obstacle: Rigid, side: Side) -> None:
        super().__init__(side)
        self.obstacle = obstacle
        X = ufl.SpatialCoordinate(side.surface.mesh)
        self.near = obstacle.near(side, nodal=self.nodal)
        values = self.near.kinematic_values(X, side.u, side.u_old, side.hint, self._axis())
        motion = obstacle.motion
        self.body = motion if isinstance(motion, RigidBody) else None
        by = [side.u] if self.body is None else [side.u, self.body.q]
        self.kernel = NodalKernel(self._sites(), values, by)
        self._written = 0

    def _axis(self) -> fem.Function | None:
        """Return the normals of frames that are carried to the points, if they are."""
        return None

    def _sites(self) -> Sites:
        """Return the points where the obstacle is met: the nodes."""
        return self.side.surface

    def averages(self, values: Array) -> Array:
        """Return the values of the nodes from those where the obstacle is met, one row each."""
        return values

    def spread(self, values: Array) -> Array:
        """Return what values where the obstacle is met give the stencils: (nodes, points, ...)."""
        return values[:, None]

    def node_of_site(self) -> Any:
        """Return the node of each place where the obstacle is met, to index rows of nodes."""
        return slice(None)

    def _follow(self) -> None:
        """Follow the displacement, as far as it has changed; collective."""
        version = self.kernel.version()
        if not any_rank(self.side.surface.mesh.comm, version != self._written):
            return
        values = self.averages(self.kernel.values())
        self.field.x.array[: values.size] = values.ravel()
        self.field.x.scatter_forward()
        self._written = version

    def derivatives(self) -> tuple[Array, None]:
        """Return the derivatives of the field by the displacement of the node."""
        return self.kernel.derivatives()[0], None

    def weights(self) -> Array:
        """Return one share for each node."""
        return np.ones((self.side.surface.num_owned, 1))

    def gather(self, values: npt.NDArray, missing: float = 0.0) -> npt.NDArray:
        """Return the entries at the nodes."""
        return self.side.owned(values)[:, None]

    def meeting(self) -> Mask:
        """Tell which owned nodes have the obstacle before them, near or far."""
        return np.ones(self.side.surface.num_owned, dtype=bool)

    def rounding(self) -> Array:
        """Return the lengths whose rounding gaps contain, and slips against a body that is loaded.

        The rounding of other slips needs no entry: it is that of the motion in a step. Where this
        motion is large, either the node slides, and only the direction of the slip matters; or the
        node moves with the obstacle, and its displacement counts anyway.
        """
        lengths, body = self.obstacle.rounding(self), self.body
        return lengths if body is None else lengths + np.max(abs(body.q.x.array / body.unit))

    def crossed(self, closed: Mask) -> Mask:
        """Tell which open nodes have passed right through the obstacle; collective."""
        start, end = ways(self.side, self.obstacle.motion)
        return self.obstacle.passed(self, start, end, ~closed)

    def sizes(self) -> Array:
        """Return the sizes (m) of the facets where the obstacle is met, one a point."""
        return self.side.facet_size()

    def outward(self) -> Array | None:
        """Return the body's outward normals where open points may be inside the obstacle."""
        return None

    def look(self, start: Array, end: Array) -> Callable[[float], tuple[Array, Array]]:
        """Return what finds gaps and normals on ways, changing the displacement; collective.

        Args:
            start: Where the local nodes start, at 0.
            end: Where they are now, at 1.
        """
        values = self.side.u.x.array.reshape(-1, self.side.d)
        nodes, end_u = self.side.parent_dofs, values[self.side.parent_dofs]

        def at(t: float) -> tuple[Array, Array]:
            """Go to a point of the ways."""
            values[nodes] = end_u + (1.0 - t) * (start - end)
            return self.gaps().copy(), self.normals().copy()

        return at
