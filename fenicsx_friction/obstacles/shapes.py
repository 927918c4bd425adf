# SPDX-License-Identifier: MIT
"""Rigid planes, and obstacles of any gap in UFL."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from ..base.errors import ContactInputError
from ..base.validators import call, kind, shown, vector
from .kinematics import Array
from .pairing import Mask
from .passage import Travelling
from .rigid import RigidObstacle, check_dimension, middle, unit
from .rigid_pairing import RigidPairing
from .side import Side


@dataclass(frozen=True)
class _Place:
    """Where a plane is, in UFL.

    Attributes:
        normal: Unit normal.
        point: A point of the plane (m).
        distance: Distance (m) of the unmoved plane from nodes at rest.
    """

    normal: fem.Constant
    point: fem.Constant
    distance: fem.Function


@dataclass(frozen=True)
class RigidPlane(RigidObstacle):
    """A plane through ``point`` with ``normal`` pointing to the body.

    Attributes:
        point: Any point of the plane (m).
        normal: Normal of any length, pointing out of the obstacle, towards the body.
        place: Normal, point and distances in UFL; found by the pairing.
    """

    point: Sequence[float]
    normal: Sequence[float]
    place: _Place | None = field(default=None, repr=False, compare=False)

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
        check_dimension(len(self.normal), len(X), f"A plane with normal {self.normal}")
        normal = unit(self.normal, "The plane's normal")
        return ufl.dot(ufl.as_vector(normal), X - ufl.as_vector([*map(float, self.point)]))

    def near(self, side: Side, *, nodal: bool = True) -> RigidObstacle:
        """Return the same plane by its point under a side, with the nodes' distances as numbers."""
        if not nodal:
            return self
        S, normal = side.surface.S, np.array(unit(self.normal, "The plane's normal"))
        check_dimension(len(normal), side.d, f"A plane with normal {self.normal}")
        distance = fem.Function(S, name="distance_at_start")
        X = S.tabulate_dof_coordinates()[:, : side.d]
        distance.x.array[:] = (X - np.asarray(self.point)) @ normal
        away = middle(side) - np.asarray(self.point)
        foot = np.asarray(self.point) + away - (away @ normal) * normal
        msh = side.surface.mesh
        place = _Place(fem.Constant(msh, normal), fem.Constant(msh, foot), distance)
        return replace(self, place=place)

    def gap_and_normal(self, X: Expr, u: Expr) -> tuple[Expr, Expr]:
        """Add displacements to the distance at the start: the coordinates round nothing.

        A plane through ``p`` whose normal has turned from ``n`` to ``n'`` is at
        ``n . (X - p) + (n' - n) . (X - p) + n' . (u - displacement of p)``.
        """
        if self.place is None:
            return super().gap_and_normal(X, u)
        normal, point, start = self.place.normal, self.place.point, self.place.distance
        if self.motion is None:
            return start + ufl.dot(normal, u), normal
        turned = self.motion.turned(normal)
        away = u - self.motion.displacement(point)
        gap = start + ufl.dot(turned, X - point) + ufl.dot(normal + turned, away)
        return gap, normal + turned

    def rounding(self, pairing: RigidPairing) -> Array:
        """Return how far it has carried its point along the normal, and what it has turned."""
        if not pairing.nodal:
            return super().rounding(pairing)
        n = pairing.side.surface.num_owned
        if self.motion is None:
            return np.zeros(n)
        normal, point = np.array(unit(self.normal, "The plane's normal")), np.asarray(self.point)
        x = pairing.side.surface.x[:, : len(normal)]
        foot = x.mean(axis=0) if n else point
        foot = foot - ((foot - point) @ normal) * normal
        moved, turned = self.motion.moved(foot), self.motion.turned_by() @ normal
        along = np.sum(abs((normal + turned) * moved))
        return np.asarray(along + np.linalg.norm(turned) * np.linalg.norm(x - foot, axis=1))

    def passed(self, pairing: Travelling, start: Array, end: Array, open_: Mask) -> Mask:
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
