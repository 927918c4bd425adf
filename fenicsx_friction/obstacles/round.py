# SPDX-License-Identifier: MIT
"""Rigid spheres and cylinders, whose gap keeps its digits however large the radius is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from ..base.validators import flag, number, vector
from .passage import Array, Mask, through_ball
from .rigid import RigidObstacle, check_dimension, middle, unit
from .side import Side


@dataclass(frozen=True)
class RigidSphere(RigidObstacle):
    """A sphere (in 2D a circle).

    Attributes:
        center: Center (m).
        radius: Radius (m), ``> 0``.
        inside: The body is inside, as in a socket.
        pole: Unit vector from the center to where the body is; found by the contact.
    """

    center: Sequence[float]
    radius: float
    inside: bool = False
    pole: Sequence[float] | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check center and radius."""
        super().__post_init__()
        vector(self.center, "The sphere's center")
        _check_round(self.radius, self.inside)

    def shape(self, X: Expr) -> Expr:
        """Return the distance from the sphere."""
        check_dimension(X, self.center, "A sphere with center")
        return _distance(X, self.center, self.radius, self.pole, self.inside)

    def near(self, contact: Side) -> RigidObstacle:
        """Return the same sphere, its gap measured from a pole near a contact."""
        return replace(self, pole=_direction(middle(contact) - np.asarray(self.center)))

    def passed(self, contact: Side, u: fem.Function, start: Array, end: Array, open_: Mask) -> Mask:
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
        pole: Unit vector from the axis to where the body is; found by the contact.
    """

    point: Sequence[float]
    axis: Sequence[float]
    radius: float
    inside: bool = False
    pole: Sequence[float] | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check axis and radius."""
        super().__post_init__()
        unit(self.axis, "The cylinder's axis", 3)
        vector(self.point, "The cylinder's point", dimension=3)
        _check_round(self.radius, self.inside)

    def shape(self, X: Expr) -> Expr:
        """Return the distance from the cylinder."""
        check_dimension(X, self.point, "A cylinder with point")
        axis = ufl.as_vector(unit(self.axis, "The cylinder's axis"))
        across = X - ufl.dot(X - ufl.as_vector([*map(float, self.point)]), axis) * axis
        return _distance(across, self.point, self.radius, self.pole, self.inside)

    def near(self, contact: Side) -> RigidObstacle:
        """Return the same cylinder, its gap measured from a line near a contact."""
        axis = np.array(unit(self.axis, "The cylinder's axis"))
        away = middle(contact) - np.asarray(self.point)
        pole = np.array(_direction(away - (away @ axis) * axis))
        pole -= (pole @ axis) * axis
        return replace(self, pole=tuple((pole / np.linalg.norm(pole)).tolist()))

    def passed(self, contact: Side, u: fem.Function, start: Array, end: Array, open_: Mask) -> Mask:
        """Tell which open nodes pass through the cylinder; no straight way does leave a bearing."""
        if self.inside:
            return np.zeros_like(open_)
        axis = np.array(unit(self.axis, "The cylinder's axis"))
        across = np.eye(3) - np.outer(axis, axis)
        first, last = self._undone(start[: len(open_)]), self._undone(end[: len(open_)])
        start, end = ((x - self.point) @ across for x in (first, last))
        return open_ & through_ball(start, end, self.radius)


def _distance(
    X: Expr, center: Sequence[float], radius: float, pole: Sequence[float] | None, inside: bool
) -> Expr:
    """Return the distance from a ball.

    ``|X - c| - R`` is known to the digits of ``R`` only. With a point ``p`` of the surface near the
    body, ``q = p - c`` and ``y = X - p`` it is ``(|y|^2 + 2 q . y + |q|^2 - R^2) / (|y + q| + R)``,
    where nothing large is subtracted, if ``|q|^2 - R^2`` is taken from exact fractions.
    """
    center = [*map(float, center)]
    if pole is None:
        d = X - ufl.as_vector(center)
        distance = ufl.sqrt(ufl.dot(d, d)) - radius
    else:
        p = [c + radius * e for c, e in zip(center, pole, strict=True)]
        q = [Fraction(a) - Fraction(c) for a, c in zip(p, center, strict=True)]
        offset = float(sum(a * a for a in q) - Fraction(radius) ** 2)
        y, to_pole = X - ufl.as_vector(p), ufl.as_vector([*map(float, q)])
        length = ufl.sqrt(ufl.dot(y + to_pole, y + to_pole))
        distance = (ufl.dot(y, y) + 2.0 * ufl.dot(to_pole, y) + offset) / (length + radius)
    return -distance if inside else distance


def _direction(away: Array) -> tuple[float, ...]:
    """Return a unit vector about along another, along an axis where that is near.

    It is rounded, so that forms do not depend on the last digits of a mesh or on its partition.
    """
    length = np.linalg.norm(away)
    rounded = np.round(away / length, 1) if length > 0.0 else np.eye(len(away))[0]
    return tuple((rounded / np.linalg.norm(rounded)).tolist())


def _check_round(radius: float, inside: bool) -> None:
    """Raise unless radius and side of a round obstacle are right."""
    number(radius, "The radius", above=0.0)
    flag(inside, "inside (the body is inside the obstacle)")
