# SPDX-License-Identifier: MIT
"""Rigid obstacles: a gap in UFL, from which normal and tangent frame follow."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import ufl
from ufl.core.expr import Expr

from .errors import ContactInputError


class Obstacle(Protocol):
    """A rigid obstacle."""

    def gap(self, x: Expr) -> Expr:
        """Return the signed distance (m) of the current point ``x``, positive outside."""
        ...


@dataclass(frozen=True)
class RigidPlane:
    """A fixed plane through ``point`` with ``normal`` pointing to the body.

    Attributes:
        point: Any point of the plane (m).
        normal: Normal of any length, pointing out of the obstacle, towards the body.
    """

    point: Sequence[float]
    normal: Sequence[float]

    def __post_init__(self) -> None:
        """Check that the normal is one."""
        length = np.linalg.norm(np.asarray(self.normal, dtype=float))
        if not (np.isfinite(length) and length > 0.0):
            raise ContactInputError(f"The plane's normal {self.normal} has no direction.")
        if len(self.point) != len(self.normal) or not np.all(np.isfinite(self.point)):
            raise ContactInputError(
                f"The plane's point {self.point} must be finite and have as many components as "
                f"its normal {self.normal}."
            )

    def gap(self, x: Expr) -> Expr:
        """Return the distance of ``x`` from the plane, eq. (1) for any plane."""
        if len(self.normal) != x.ufl_shape[0]:
            raise ContactInputError(
                f"A plane with normal {self.normal} cannot be met by points of "
                f"{x.ufl_shape[0]} components."
            )
        unit = np.asarray(self.normal, dtype=float) / np.linalg.norm(self.normal)
        return ufl.dot(ufl.as_vector(unit.tolist()), x - ufl.as_vector(list(self.point)))


class Kinematics(NamedTuple):
    """Gap, slip increment and frame of a contact point, in UFL."""

    gap: Expr
    slip: Expr
    normal: Expr
    tangents: tuple[Expr, ...]

    def traction(self, c: Expr) -> Expr:
        """Return the traction vector of the multipliers ``c = (c_n, c_1[, c_2])``."""
        return sum((c[k + 1] * e for k, e in enumerate(self.tangents)), c[0] * self.normal)


def kinematics(obstacle: Obstacle, x: Expr, increment: Expr, hint: Expr) -> Kinematics:
    """Derive the kinematics of the current point ``x`` against ``obstacle``.

    Args:
        obstacle: The rigid obstacle.
        x: Current position ``X + u`` (m).
        increment: Displacement since the last accepted step (m).
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
    slip = ufl.as_vector([ufl.dot(e, increment) for e in tangents])
    return Kinematics(gap, slip, normal, tangents)
