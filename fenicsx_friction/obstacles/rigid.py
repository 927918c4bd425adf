# SPDX-License-Identifier: MIT
"""Rigid obstacles: a gap in UFL, from which normal and tangent frame follow."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from ..base.errors import ContactInputError
from ..base.validators import call, instance, kind, shown, vector
from .motion import RigidMotion
from .obstacle import Kinematics, Obstacle, first_tangent
from .passage import Array, Mask, through_anything, ways
from .side import Side


@dataclass(frozen=True, kw_only=True)
class RigidObstacle(Obstacle):
    """A rigid obstacle, at rest or moving.

    Attributes:
        motion: Moves the obstacle from where its shape describes it.
    """

    motion: RigidMotion | None = field(default=None)

    def __post_init__(self) -> None:
        """Check the motion; shapes check their own arguments, too."""
        if self.motion is not None:
            instance(self.motion, RigidMotion, "The obstacle's motion", "a RigidMotion, or None")

    @abstractmethod
    def shape(self, X: Expr) -> Expr:
        """Return the signed distance (m) of ``X`` from the unmoved obstacle, positive outside."""

    def gap(self, x: Expr) -> Expr:
        """Return the signed distance (m) of the current point ``x``, eq. (1) for any obstacle."""
        return self.shape(x if self.motion is None else self.motion.undo(x))

    def way(self, X: Expr, u: Expr, u_old: Expr) -> Expr:
        """Return the node's way (m) from where the obstacle's point once under it is now.

        A motion of node and obstacle together as one rigid body adds nothing to it. Coordinates,
        which would round it, enter only where the obstacle turns.
        """
        step = u - u_old
        return step if self.motion is None else step - self.motion.carried_along(X + u_old)

    def kinematics(self, contact: Side, u: fem.Function, u_old: fem.Function) -> Kinematics:
        """Derive the kinematics from gap and motion, see :func:`kinematics`."""
        X = ufl.SpatialCoordinate(contact.surface.mesh)
        return kinematics(self.near(contact), X, u, u_old, contact.hint)

    def gap_and_normal(self, X: Expr, u: Expr) -> tuple[Expr, Expr]:
        """Return gap (m) and unit normal of a node at rest at ``X`` that has moved by ``u``."""
        point = ufl.variable(X + u)
        gap = self.gap(point)
        gradient = ufl.diff(gap, point)
        return gap, gradient / ufl.sqrt(ufl.dot(gradient, gradient))

    def rounding(self, contact: Side) -> Array:
        """Return how far nodes are from the origin along their normals, and what was carried."""
        x = contact.nodal_position()
        return np.sum(abs(contact.nodal_normal() * x), axis=1) + self._carried(x)

    def _carried(self, x: Array) -> Array:
        """Return how far the obstacle has carried its points at ``x`` (m)."""
        return np.asarray(np.linalg.norm(x - self._undone(x), axis=1))

    def near(self, contact: Side) -> RigidObstacle:
        """Return the same obstacle with a gap that loses no digits at a contact's nodes."""
        return self

    def crossed(self, contact: Side, u: fem.Function, u_old: fem.Function, closed: Mask) -> Mask:
        """Tell which open nodes have passed right through the obstacle; collective."""
        start, end = ways(contact, u, u_old, self.motion)
        return self.passed(contact, u, start, end, ~closed)

    def passed(self, contact: Side, u: fem.Function, start: Array, end: Array, open_: Mask) -> Mask:
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
        start: Distance (m) of the unmoved plane from nodes at rest; found by the contact.
    """

    point: Sequence[float]
    normal: Sequence[float]
    start: fem.Function | None = field(default=None, repr=False, compare=False)

    def __init_subclass__(cls) -> None:
        """Refuse subclasses: a shape of their own would not be asked for."""
        raise ContactInputError(
            f"{cls.__name__}: a RigidPlane cannot be derived from; derive from RigidObstacle, or "
            "take an ImplicitObstacle."
        )

    def __post_init__(self) -> None:
        """Check point and normal."""
        super().__post_init__()
        normal = unit(self.normal, "The plane's normal")
        vector(self.point, "The plane's point", dimension=len(normal))

    def shape(self, X: Expr) -> Expr:
        """Return the distance from the plane."""
        check_dimension(X, self.normal, "A plane with normal")
        normal = unit(self.normal, "The plane's normal")
        return ufl.dot(ufl.as_vector(normal), X - ufl.as_vector([*map(float, self.point)]))

    def near(self, contact: Side) -> RigidObstacle:
        """Return the same plane, with the distances of a contact's nodes as numbers."""
        S, normal = contact.surface.S, unit(self.normal, "The plane's normal")
        distance = fem.Function(S, name="distance_at_start")
        X = S.tabulate_dof_coordinates()[:, : len(normal)]
        distance.x.array[:] = (X - np.asarray(self.point)) @ normal
        return replace(self, start=distance)

    def gap_and_normal(self, X: Expr, u: Expr) -> tuple[Expr, Expr]:
        """Add displacements to the distance at the start: the coordinates round nothing.

        A plane through ``p`` whose normal has turned from ``n`` to ``n'`` is at
        ``n . (X - p) + (n' - n) . (X - p) + n' . (u - displacement of p)``.
        """
        check_dimension(X, self.normal, "A plane with normal")
        normal = ufl.as_vector(unit(self.normal, "The plane's normal"))
        point = ufl.as_vector([*map(float, self.point)])
        start = ufl.dot(normal, X - point) if self.start is None else self.start
        if self.motion is None:
            return start + ufl.dot(normal, u), normal
        turned = self.motion.turned(normal)
        away = u - self.motion.displacement(point)
        gap = start + ufl.dot(turned, X - point) + ufl.dot(normal + turned, away)
        return gap, normal + turned

    def rounding(self, contact: Side) -> Array:
        """Return what the plane has carried."""
        return self._carried(contact.nodal_position())

    def passed(self, contact: Side, u: fem.Function, start: Array, end: Array, open_: Mask) -> Mask:
        """Tell which nodes pass through: none, there is no far side."""
        return np.zeros_like(open_)


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

    def __post_init__(self) -> None:
        """Check that the distance is a function."""
        super().__post_init__()
        if not callable(self.distance) or isinstance(self.distance, Expr):
            raise ContactInputError(
                f"The distance = {shown(self.distance)} is {kind(self.distance)}; give a function "
                "of the point X (UFL vector), such as lambda X: X[1]."
            )

    def shape(self, X: Expr) -> Expr:
        """Return the given distance."""
        return call(self.distance, "The obstacle's distance(X)", X)


def kinematics(obstacle: RigidObstacle, X: Expr, u: Expr, u_old: Expr, hint: Expr) -> Kinematics:
    """Derive the kinematics of the current point ``X + u`` against ``obstacle``.

    Args:
        obstacle: The rigid obstacle.
        X: Reference position (m).
        u: Displacement (m).
        u_old: Displacement at the last accepted step (m).
        hint: Vector whose projection on the tangent plane is the first tangent (3D only).
    """
    gap, normal = obstacle.gap_and_normal(X, u)
    return Kinematics.of(gap, obstacle.way(X, u, u_old), normal, first_tangent(normal, hint))


def middle(contact: Side) -> Array:
    """Return the mean of the contact's nodes (m), on all ranks; collective."""
    x, comm = contact.surface.x, contact.surface.mesh.comm
    total = comm.allreduce(np.append(x.sum(axis=0), len(x)))
    return np.asarray(total[: contact.surface.mesh.geometry.dim] / total[-1])


def unit(direction: Sequence[float], what: str, dimension: int | None = None) -> list[float]:
    """Return the unit vector of a direction, or raise."""
    components = vector(direction, what, dimension=dimension)
    length = np.linalg.norm(components)
    if not 0.0 < length < np.inf:
        raise ContactInputError(f"{what} {direction} has no direction; give a vector not zero.")
    return list((components / length).tolist())


def check_dimension(X: Expr, vector: Sequence[float], what: str) -> None:
    """Raise unless the obstacle lives in the space of ``X``."""
    if len(vector) != X.ufl_shape[0]:
        raise ContactInputError(
            f"{what} {vector} cannot be met by points of {X.ufl_shape[0]} components."
        )
