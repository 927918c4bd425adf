# SPDX-License-Identifier: MIT
"""Rigid spheres and cylinders, whose gap keeps its digits however large the radius is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np
import ufl
from dolfinx import fem, mesh
from ufl.core.expr import Expr

from ..base.validators import flag, number, vector
from .kinematics import Array
from .pairing import Mask
from .passage import Travelling, through_ball
from .rigid import RigidObstacle, check_dimension, middle, unit
from .side import Side


@dataclass(frozen=True)
class RigidSphere(RigidObstacle):
    """A sphere (in 2D a circle).

    Attributes:
        center: Center (m).
        radius: Radius (m), ``> 0``.
        inside: The body is inside, as in a socket.
        pole: A point of the surface near the body, in UFL; found by the pairing.
    """

    center: Sequence[float]
    radius: float
    inside: bool = False
    pole: _Pole | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check center and radius."""
        super().__post_init__()
        vector(self.center, "The sphere's center")
        _check_round(self.radius, self.inside)

    def shape(self, X: Expr) -> Expr:
        """Return the distance from the sphere."""
        check_dimension(len(self.center), len(X), f"A sphere with center {self.center}")
        return _distance(X, self.center, self.radius, self.pole, self.inside)

    def near(self, side: Side, *, nodal: bool = True) -> RigidObstacle:
        """Return the same sphere, its gap measured from a pole near a side."""
        check_dimension(len(self.center), side.d, f"A sphere with center {self.center}")
        direction = _direction(middle(side) - np.asarray(self.center))
        pole = _Pole.at(side.surface.mesh, self.center, self.radius, direction, direction)
        return replace(self, pole=pole)

    def passed(self, pairing: Travelling, start: Array, end: Array, open_: Mask) -> Mask:
        """Tell which open nodes pass through the sphere; straight ways leave no socket."""
        if self.inside:
            return np.zeros_like(open_)
        first, last = self.undone(start[: len(open_)]), self.undone(end[: len(open_)])
        return open_ & through_ball(first - self.center, last - self.center, self.radius)


@dataclass(frozen=True)
class RigidCylinder(RigidObstacle):
    """An infinite circular cylinder in 3D (in 2D use a sphere).

    Attributes:
        point: A point of the axis (m).
        axis: Direction of the axis, of any length.
        radius: Radius (m), ``> 0``.
        inside: The body is inside, as in a bearing.
        pole: A point of the surface near the body, in UFL; found by the pairing.
    """

    point: Sequence[float]
    axis: Sequence[float]
    radius: float
    inside: bool = False
    pole: _Pole | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check axis and radius."""
        super().__post_init__()
        unit(self.axis, "The cylinder's axis", 3)
        vector(self.point, "The cylinder's point", dimension=3)
        _check_round(self.radius, self.inside)

    def shape(self, X: Expr) -> Expr:
        """Return the distance from the cylinder."""
        check_dimension(len(self.point), len(X), f"A cylinder with point {self.point}")
        if self.pole is None:
            axis = ufl.as_vector(unit(self.axis, "The cylinder's axis"))
            point = ufl.as_vector([*map(float, self.point)])
        else:
            axis, point = self.pole.axis, self.pole.center
        across = X - ufl.dot(X - point, axis) * axis
        return _distance(across, self.point, self.radius, self.pole, self.inside)

    def near(self, side: Side, *, nodal: bool = True) -> RigidObstacle:
        """Return the same cylinder, its gap measured from a line near a side."""
        check_dimension(len(self.point), side.d, f"A cylinder with point {self.point}")
        axis = np.array(unit(self.axis, "The cylinder's axis"))
        away = middle(side) - np.asarray(self.point)
        direction = np.array(_direction(away - (away @ axis) * axis))
        direction -= (direction @ axis) * axis
        direction /= np.linalg.norm(direction)
        pole = _Pole.at(side.surface.mesh, self.point, self.radius, direction.tolist(), axis)
        return replace(self, pole=pole)

    def passed(self, pairing: Travelling, start: Array, end: Array, open_: Mask) -> Mask:
        """Tell which open nodes pass through the cylinder; straight ways leave no bearing."""
        if self.inside:
            return np.zeros_like(open_)
        axis = np.array(unit(self.axis, "The cylinder's axis"))
        across = np.eye(3) - np.outer(axis, axis)
        first, last = self.undone(start[: len(open_)]), self.undone(end[: len(open_)])
        start, end = ((x - self.point) @ across for x in (first, last))
        return open_ & through_ball(start, end, self.radius)


@dataclass(frozen=True)
class _Pole:
    """A point of a round surface to measure from, in UFL.

    Attributes:
        center: The center (m).
        radius: The radius (m).
        axis: The axis of a cylinder.
        point: The pole (m).
        offset: The pole as seen from the center (m).
        excess: ``|offset|^2 - radius^2``, without rounding.
    """

    center: fem.Constant
    radius: fem.Constant
    axis: fem.Constant
    point: fem.Constant
    offset: fem.Constant
    excess: fem.Constant

    @classmethod
    def at(
        cls,
        msh: mesh.Mesh,
        center: Sequence[float],
        radius: float,
        direction: Sequence[float],
        axis: Sequence[float] | Array,
    ) -> _Pole:
        """Return the pole in a direction from the center."""
        c = [*map(float, center)]
        p = [x + radius * e for x, e in zip(c, direction, strict=True)]
        q = [Fraction(a) - Fraction(b) for a, b in zip(p, c, strict=True)]
        excess = float(sum(a * a for a in q) - Fraction(radius) ** 2)
        values = (c, radius, axis, p, [*map(float, q)], excess)
        return cls(*(fem.Constant(msh, np.asarray(value, dtype=float)) for value in values))


def _distance(
    X: Expr, center: Sequence[float], radius: float, pole: _Pole | None, inside: bool
) -> Expr:
    """Return the distance from a ball.

    ``|X - c| - R`` has the absolute rounding error of ``R``. Take a point ``p`` of the surface near
    the body, ``q = p - c`` and ``y = X - p``. Then the distance is
    ``(|y|^2 + 2 q . y + |q|^2 - R^2) / (|y + q| + R)``. No large numbers are subtracted, because
    ``|q|^2 - R^2`` comes from exact fractions.
    """
    if pole is None:
        d = X - ufl.as_vector([*map(float, center)])
        distance = ufl.sqrt(ufl.dot(d, d)) - radius
    else:
        y = X - pole.point
        length = ufl.sqrt(ufl.dot(y + pole.offset, y + pole.offset))
        above = ufl.dot(y, y) + 2 * ufl.dot(pole.offset, y) + pole.excess
        distance = above / (length + pole.radius)
    return -distance if inside else distance


def _direction(away: Array) -> tuple[float, ...]:
    """Return a unit vector nearly along another, along an axis where that is near.

    It is rounded, so that it does not depend on the last digits of a mesh or on its partition.
    """
    length = np.linalg.norm(away)
    rounded = np.round(away / length, 1) if length > 0.0 else np.eye(len(away))[0]
    return tuple((rounded / np.linalg.norm(rounded)).tolist())


def _check_round(radius: float, inside: bool) -> None:
    """Raise unless radius and side of a round obstacle are right."""
    number(radius, "The radius", above=0.0)
    flag(inside, "inside (the body is inside the obstacle)")
