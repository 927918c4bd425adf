# SPDX-License-Identifier: MIT
"""Rigid obstacles: a gap in UFL, from which normal and tangent frame follow."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import ufl
from ufl.core.expr import Expr

from ..base.errors import ContactInputError
from ..base.validators import instance, vector
from ..surfaces.elements import nodal_on_facets
from .all_nodes import AllNodesPairing
from .kinematics import Array, entries
from .motion import Motion
from .obstacle import Obstacle
from .pairing import Mask
from .passage import Travelling, through_anything
from .rigid_pairing import RigidPairing
from .side import Side
from .weighted import WeightedPairing


@dataclass(frozen=True, kw_only=True, eq=False)
class MovedObstacle(Obstacle):
    """What is rigid, at rest or moving.

    Attributes:
        motion: Moves the obstacle from where it is described.
    """

    motion: Motion | None = field(default=None)

    def __post_init__(self) -> None:
        """Check the motion; shapes check their own arguments, too."""
        if self.motion is not None:
            wanted = "a RigidMotion, a RigidBody, or None"
            instance(self.motion, Motion, "The obstacle's motion", wanted)

    @abstractmethod
    def gap_and_normal(self, X: Expr, u: Expr) -> tuple[Expr, Expr]:
        """Return gap (m) and unit normal of a node at rest at ``X`` that has moved by ``u``."""

    def way(self, X: Expr, u: Expr, u_old: Expr) -> Expr:
        """Return the node's way (m) in the step, relative to the obstacle.

        It starts at the obstacle's point under the last position, where that point is now. A motion
        of node and obstacle as one rigid body adds nothing. Coordinates would add rounding; they
        enter only where the obstacle turns.
        """
        step = u - u_old
        return step if self.motion is None else step - self.motion.carried_along(X + u_old)

    def kinematic_values(
        self, X: Expr, u: Expr, u_old: Expr, hint: Expr, axis: Expr | None = None
    ) -> Expr:
        """Return the entries of the kinematic field of a node.

        Args:
            X: Reference position (m).
            u: Displacement (m).
            u_old: Displacement at the last accepted step (m).
            hint: Vector whose projection on the tangent plane is the first tangent (3D only).
            axis: Normal of the frame that is carried to the node's, ``None`` to make it there.
        """
        gap, normal = self.gap_and_normal(X, u)
        way = self.way(X, u, u_old)
        return ufl.as_vector([*entries(gap, way, normal, hint, axis), *(X + u)])

    def undone(self, x: Array) -> Array:
        """Return the points of the unmoved obstacle that are at ``x`` now, in numbers."""
        return x if self.motion is None else self.motion.undone(x)


@dataclass(frozen=True, kw_only=True)
class RigidObstacle(MovedObstacle):
    """A rigid obstacle, at rest or moving.

    Attributes:
        motion: Moves the obstacle from where its shape describes it.
    """

    @abstractmethod
    def shape(self, X: Expr) -> Expr:
        """Return the signed distance (m) of ``X`` from the unmoved obstacle, positive outside."""

    def meet(self, side: Side) -> RigidPairing:
        """Return the pairing of a side's nodes with the obstacle; collective."""
        if nodal_on_facets(side.u.function_space):
            return RigidPairing(self, side)
        return (WeightedPairing if side.surface.degree == 1 else AllNodesPairing)(self, side)

    def gap(self, x: Expr) -> Expr:
        """Return the signed distance (m) of the current point ``x``, eq. (1) for any obstacle."""
        return self.shape(x if self.motion is None else self.motion.undo(x))

    def gap_and_normal(self, X: Expr, u: Expr) -> tuple[Expr, Expr]:
        """Return gap (m) and unit normal of a node at rest at ``X`` that has moved by ``u``."""
        point = ufl.variable(X + u)
        gap = self.gap(point)
        gradient = ufl.diff(gap, point)
        return gap, gradient / ufl.sqrt(ufl.dot(gradient, gradient))

    def near(self, side: Side, *, nodal: bool = True) -> RigidObstacle:
        """Return the same obstacle with a gap that loses no digits at a side.

        Args:
            side: The side.
            nodal: Whether the gap is evaluated at the nodes only.
        """
        return self

    def rounding(self, pairing: RigidPairing) -> Array:
        """Return the lengths (m) whose rounding gaps contain, see ``Pairing.rounding``."""
        x, normals = pairing.positions(), abs(pairing.normals())
        lengths = np.sum(normals * abs(x), axis=1)
        if self.motion is not None:
            lengths += np.sum(normals * abs(x - self.undone(x)), axis=1)
            lengths += np.linalg.norm(self.motion.turned_by()) * np.linalg.norm(x, axis=1)
        return np.asarray(lengths)

    def passed(self, pairing: Travelling, start: Array, end: Array, open_: Mask) -> Mask:
        """Tell which open nodes pass through the obstacle on their ways; collective.

        Args:
            pairing: What travels; the displacement is put back if it is changed.
            start: Where local nodes were (m), carried along by the obstacle.
            end: Where they are (m).
            open_: Owned nodes to be tested.
        """
        length = np.linalg.norm(end - start, axis=1)[: len(open_)]
        look = pairing.look(start, end)
        sizes, outward = pairing.sizes(), pairing.outward()
        return through_anything(pairing.side, look, length, sizes, open_, outward)


def middle(side: Side) -> Array:
    """Return the mean of a side's nodes (m), on all ranks; collective."""
    x, comm = side.surface.x, side.surface.mesh.comm
    total = comm.allreduce(np.append(x.sum(axis=0), len(x)))
    return np.asarray(total[: side.d] / total[-1])


def unit(direction: Sequence[float], what: str, dimension: int | None = None) -> list[float]:
    """Return the unit vector of a direction, or raise."""
    components = vector(direction, what, dimension=dimension)
    length = np.linalg.norm(components)
    if not 0.0 < length < np.inf:
        raise ContactInputError(f"{what} {direction} has no direction; give a vector not zero.")
    return list((components / length).tolist())


def check_dimension(found: int, dimension: int, what: str) -> None:
    """Raise unless the obstacle lives in the space of the body."""
    if found != dimension:
        raise ContactInputError(f"{what} cannot be met by points of {dimension} components.")
