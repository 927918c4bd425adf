# SPDX-License-Identifier: MIT
"""Rigid obstacles: a gap in UFL, from which normal and tangent frame follow."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from .errors import ContactInputError
from .kinematics import Kinematics, Obstacle
from .motion import RigidMotion
from .passage import Array, Mask, through_anything, through_ball, ways

if TYPE_CHECKING:
    from .contact import Contact


@dataclass(frozen=True, kw_only=True)
class RigidObstacle(Obstacle):
    """A rigid obstacle, at rest or moving.

    Attributes:
        motion: Moves the obstacle from where its shape describes it.
    """

    motion: RigidMotion | None = field(default=None)

    @abstractmethod
    def shape(self, X: Expr) -> Expr:
        """Return the signed distance (m) of ``X`` from the unmoved obstacle, positive outside."""

    def gap(self, x: Expr) -> Expr:
        """Return the signed distance (m) of the current point ``x``, eq. (1) for any obstacle."""
        return self.shape(x if self.motion is None else self.motion.undo(x))

    def carry(self, x: Expr) -> Expr:
        """Return where the obstacle's point that was at ``x`` at the last step is now."""
        return x if self.motion is None else self.motion.carry(x)

    def kinematics(self, contact: Contact, u: fem.Function, u_old: fem.Function) -> Kinematics:
        """Derive the kinematics from the gap, see :func:`kinematics`."""
        X = ufl.SpatialCoordinate(contact.surface.mesh)
        return kinematics(self, X + u, X + u_old, contact.hint)

    def crossed(self, contact: Contact, u: fem.Function, u_old: fem.Function, closed: Mask) -> Mask:
        """Tell which open nodes have passed right through the obstacle; collective."""
        start, end = ways(contact, u, u_old, self.motion)
        return self.passed(contact, u, start, end, ~closed)

    def passed(
        self, contact: Contact, u: fem.Function, start: Array, end: Array, open_: Mask
    ) -> Mask:
        """Tell which open nodes pass through the obstacle on their ways; collective.

        Args:
            contact: The contact.
            u: Displacement; put back if it is changed.
            start: Where local nodes were (m), carried along by the obstacle.
            end: Where they are (m).
            open_: Owned nodes that are asked for.
        """
        return through_anything(contact, u, start, end, open_)

    def _undone(self, x: Array) -> Array:
        """Return the points of the unmoved obstacle that are at ``x`` now, in numbers."""
        return x if self.motion is None else self.motion.undone(x)


@dataclass(frozen=True)
class RigidPlane(RigidObstacle):
    """A plane through ``point`` with ``normal`` pointing to the body.

    Attributes:
        point: Any point of the plane (m).
        normal: Normal of any length, pointing out of the obstacle, towards the body.
    """

    point: Sequence[float]
    normal: Sequence[float]

    def __post_init__(self) -> None:
        """Check that the normal is one."""
        _unit(self.normal, "The plane's normal")
        _check_point(self.point, len(self.normal), "The plane's point")

    def shape(self, X: Expr) -> Expr:
        """Return the distance from the plane."""
        _check_dimension(X, self.normal, "A plane with normal")
        unit = _unit(self.normal, "The plane's normal")
        return ufl.dot(ufl.as_vector(unit), X - ufl.as_vector(list(self.point)))

    def passed(
        self, contact: Contact, u: fem.Function, start: Array, end: Array, open_: Mask
    ) -> Mask:
        """Tell which nodes pass through: none, there is no far side."""
        return np.zeros_like(open_)


@dataclass(frozen=True)
class RigidSphere(RigidObstacle):
    """A sphere (in 2D a circle).

    Attributes:
        center: Center (m).
        radius: Radius (m), ``> 0``.
        inside: The body is inside, as in a socket.
    """

    center: Sequence[float]
    radius: float
    inside: bool = False

    def __post_init__(self) -> None:
        """Check the radius."""
        _check_point(self.center, len(self.center), "The sphere's center")
        _check_radius(self.radius)

    def shape(self, X: Expr) -> Expr:
        """Return the distance from the sphere."""
        _check_dimension(X, self.center, "A sphere with center")
        d = X - ufl.as_vector(list(self.center))
        distance = ufl.sqrt(ufl.dot(d, d)) - self.radius
        return -distance if self.inside else distance

    def passed(
        self, contact: Contact, u: fem.Function, start: Array, end: Array, open_: Mask
    ) -> Mask:
        """Tell which open nodes pass through the sphere; no straight way does leave a socket."""
        if self.inside:
            return np.zeros_like(open_)
        first, last = self._undone(start[: len(open_)]), self._undone(end[: len(open_)])
        return open_ & through_ball(first - self.center, last - self.center, self.radius)


@dataclass(frozen=True)
class RigidCylinder(RigidObstacle):
    """An infinite circular cylinder in 3D (in 2D use a sphere).

    Attributes:
        point: A point of the axis (m).
        axis: Direction of the axis, of any length.
        radius: Radius (m), ``> 0``.
        inside: The body is inside, as in a bearing.
    """

    point: Sequence[float]
    axis: Sequence[float]
    radius: float
    inside: bool = False

    def __post_init__(self) -> None:
        """Check axis and radius."""
        _unit(self.axis, "The cylinder's axis")
        _check_point(self.point, 3, "The cylinder's point")
        _check_radius(self.radius)

    def shape(self, X: Expr) -> Expr:
        """Return the distance from the cylinder."""
        _check_dimension(X, self.point, "A cylinder with point")
        axis = ufl.as_vector(_unit(self.axis, "The cylinder's axis"))
        d = X - ufl.as_vector(list(self.point))
        radial = d - ufl.dot(d, axis) * axis
        distance = ufl.sqrt(ufl.dot(radial, radial)) - self.radius
        return -distance if self.inside else distance

    def passed(
        self, contact: Contact, u: fem.Function, start: Array, end: Array, open_: Mask
    ) -> Mask:
        """Tell which open nodes pass through the cylinder; no straight way does leave a bearing."""
        if self.inside:
            return np.zeros_like(open_)
        axis = np.array(_unit(self.axis, "The cylinder's axis"))
        across = np.eye(3) - np.outer(axis, axis)
        first, last = self._undone(start[: len(open_)]), self._undone(end[: len(open_)])
        start, end = ((x - self.point) @ across for x in (first, last))
        return open_ & through_ball(start, end, self.radius)


@dataclass(frozen=True)
class ImplicitObstacle(RigidObstacle):
    """Any obstacle given by its gap.

    Attributes:
        distance: Function of the point ``X`` (UFL vector, m) to its signed distance from the
            obstacle (UFL scalar, m), positive outside. Near the surface its gradient should be of
            length one, for gaps to be lengths; only the sign and the gradient's direction matter
            on it. Nowhere should it be far more than the distance, or a thin obstacle that nodes
            pass through within a step may not be seen.
    """

    distance: Callable[[Expr], Expr]

    def shape(self, X: Expr) -> Expr:
        """Return the given distance."""
        value = ufl.as_ufl(self.distance(X))
        if value.ufl_shape != ():
            raise ContactInputError(f"The gap must be scalar, its shape is {value.ufl_shape}.")
        return value


def kinematics(obstacle: RigidObstacle, x: Expr, x_old: Expr, hint: Expr) -> Kinematics:
    """Derive the kinematics of the current point ``x`` against ``obstacle``.

    The slip increment is the way from where the obstacle's point once under the node is now to
    where the node is now, in the current frame: a motion of node and obstacle together as one
    rigid body adds nothing to it.

    Args:
        obstacle: The rigid obstacle.
        x: Current position ``X + u`` (m).
        x_old: Position at the last accepted step (m).
        hint: Vector whose projection on the tangent plane is the first tangent (3D only).
    """
    point = ufl.variable(x)
    gap = obstacle.gap(point)
    gradient = ufl.diff(gap, point)
    normal = gradient / ufl.sqrt(ufl.dot(gradient, gradient))
    if x.ufl_shape[0] == 2:
        tangents: tuple[Expr, ...] = (ufl.as_vector([normal[1], -normal[0]]),)
    else:
        first = hint - ufl.dot(hint, normal) * normal
        first = first / ufl.sqrt(ufl.dot(first, first))
        tangents = (first, ufl.cross(normal, first))
    way = x - obstacle.carry(x_old)
    slip = ufl.as_vector([ufl.dot(e, way) for e in tangents])
    return Kinematics(gap, slip, normal, tangents)


def _unit(direction: Sequence[float], what: str) -> list[float]:
    """Return the unit vector of a direction, or raise."""
    vector = np.asarray(direction, dtype=float)
    length = np.linalg.norm(vector)
    if not (np.isfinite(length) and length > 0.0):
        raise ContactInputError(f"{what} {direction} has no direction.")
    return list((vector / length).tolist())


def _check_point(point: Sequence[float], dimension: int, what: str) -> None:
    """Raise unless the point is finite and of the dimension."""
    if len(point) != dimension or not np.all(np.isfinite(point)):
        raise ContactInputError(
            f"{what} {point} must be finite and have as many components as the space, {dimension}."
        )


def _check_radius(radius: float) -> None:
    """Raise unless the radius is positive."""
    if not 0.0 < radius < float("inf"):
        raise ContactInputError(f"The radius {radius} must be positive and finite.")


def _check_dimension(X: Expr, vector: Sequence[float], what: str) -> None:
    """Raise unless the obstacle lives in the space of ``X``."""
    if len(vector) != X.ufl_shape[0]:
        raise ContactInputError(
            f"{what} {vector} cannot be met by points of {X.ufl_shape[0]} components."
        )
