# SPDX-License-Identifier: MIT
"""Rigid obstacles: a gap in UFL, from which normal and tangent frame follow."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from ..base.collective import any_rank
from ..base.errors import ContactInputError
from ..base.validators import call, instance, kind, shown, vector
from ..surfaces.nodal_kernel import NodalKernel
from .kinematics import Array, first_tangent
from .motion import RigidMotion
from .obstacle import Mask, Obstacle, Pairing
from .passage import through_anything, ways
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

    def meet(self, side: Side) -> RigidPairing:
        """Return the pairing of a side's nodes with the obstacle; collective."""
        return RigidPairing(self, side)

    def gap(self, x: Expr) -> Expr:
        """Return the signed distance (m) of the current point ``x``, eq. (1) for any obstacle."""
        return self.shape(x if self.motion is None else self.motion.undo(x))

    def way(self, X: Expr, u: Expr, u_old: Expr) -> Expr:
        """Return the node's way (m) in the step, relative to the obstacle.

        It starts at the obstacle's point under the last position, where that point is now. A motion
        of node and obstacle as one rigid body adds nothing. Coordinates would add rounding; they
        enter only where the obstacle turns.
        """
        step = u - u_old
        return step if self.motion is None else step - self.motion.carried_along(X + u_old)

    def gap_and_normal(self, X: Expr, u: Expr) -> tuple[Expr, Expr]:
        """Return gap (m) and unit normal of a node at rest at ``X`` that has moved by ``u``."""
        point = ufl.variable(X + u)
        gap = self.gap(point)
        gradient = ufl.diff(gap, point)
        return gap, gradient / ufl.sqrt(ufl.dot(gradient, gradient))

    def kinematic_values(self, X: Expr, u: Expr, u_old: Expr, hint: Expr) -> Expr:
        """Return the entries of the kinematic field of a node.

        Args:
            X: Reference position (m).
            u: Displacement (m).
            u_old: Displacement at the last accepted step (m).
            hint: Vector whose projection on the tangent plane is the first tangent (3D only).
        """
        gap, normal = self.gap_and_normal(X, u)
        first = [] if len(X) == 2 else [*first_tangent(normal, hint)]
        return ufl.as_vector([gap, *self.way(X, u, u_old), *normal, *first, *(X + u)])

    def near(self, side: Side) -> RigidObstacle:
        """Return the same obstacle with a gap that loses no digits at a side's nodes."""
        return self

    def rounding(self, pairing: Pairing) -> Array:
        """Return the lengths (m) whose rounding gaps contain, see ``Pairing.rounding``."""
        x, normals = pairing.positions(), abs(pairing.normals())
        lengths = np.sum(normals * abs(x), axis=1)
        if self.motion is not None:
            lengths += np.sum(normals * abs(x - self.undone(x)), axis=1)
            lengths += np.linalg.norm(self.motion.turned_by()) * np.linalg.norm(x, axis=1)
        return np.asarray(lengths)

    def passed(self, pairing: Pairing, start: Array, end: Array, open_: Mask) -> Mask:
        """Tell which open nodes pass through the obstacle on their ways; collective.

        Args:
            pairing: The pairing; the displacement is put back if it is changed.
            start: Where local nodes were (m), carried along by the obstacle.
            end: Where they are (m).
            open_: Owned nodes to be tested.
        """
        return through_anything(pairing, start, end, open_)

    def undone(self, x: Array) -> Array:
        """Return the points of the unmoved obstacle that are at ``x`` now, in numbers."""
        return x if self.motion is None else self.motion.undone(x)


class RigidPairing(Pairing):
    """Nodes that meet a rigid obstacle: each stencil is the node alone.

    Args:
        obstacle: The obstacle.
        side: The side.
    """

    def __init__(self, obstacle: RigidObstacle, side: Side) -> None:
        super().__init__(side)
        self.obstacle = obstacle
        X = ufl.SpatialCoordinate(side.surface.mesh)
        values = obstacle.near(side).kinematic_values(X, side.u, side.u_old, side.hint)
        self._kernel = NodalKernel(side.surface, values, [side.u])

    def update(self) -> None:
        """Follow the displacement, as far as it has changed; collective."""
        if not any_rank(self.side.surface.mesh.comm, self._kernel.refresh()):
            return
        values = self._kernel.values(refresh=False)
        self.field.x.array[: values.size] = values.ravel()
        self.field.x.scatter_forward()

    def derivatives(self) -> tuple[Array, None]:
        """Return the derivatives of the field by the displacement of the node."""
        return self._kernel.derivatives(refresh=False)[0], None

    def weights(self) -> Array:
        """Return one share for each node."""
        return np.ones((self.side.surface.num_owned, 1))

    def gather(self, values: npt.NDArray, missing: float = 0.0) -> npt.NDArray:
        """Return the entries at the nodes."""
        return self.side.owned(values)[:, None]

    def rounding(self) -> Array:
        """Return the lengths whose rounding gaps contain.

        The rounding of slips needs no entry: it is that of the motion in a step. Where this motion
        is large, either the node slides, and only the direction of the slip matters; or the node
        moves with the obstacle, and its displacement counts anyway.
        """
        return self.obstacle.rounding(self)

    def crossed(self, closed: Mask) -> Mask:
        """Tell which open nodes have passed right through the obstacle; collective."""
        start, end = ways(self.side, self.obstacle.motion)
        return self.obstacle.passed(self, start, end, ~closed)


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
        """Refuse subclasses: a plane never calls a ``shape`` of a subclass."""
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

    def near(self, side: Side) -> RigidObstacle:
        """Return the same plane, with its point nearest to a side, and distances of nodes."""
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
        """Add displacements to the distance at the start, without the rounding of coordinates.

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

    def rounding(self, pairing: Pairing) -> Array:
        """Return how far the motion carries the plane along its normal at each node."""
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

    def passed(self, pairing: Pairing, start: Array, end: Array, open_: Mask) -> Mask:
        """Tell which nodes pass through: none, there is no far side."""
        return np.zeros_like(open_)


@dataclass(frozen=True)
class ImplicitObstacle(RigidObstacle):
    """Any obstacle given by its gap.

    Attributes:
        distance: Function of the point ``X`` (UFL vector, m) to its signed distance from the
            obstacle (UFL scalar, m), positive outside. On the surface, only its sign and the
            direction of its gradient matter. Near the surface the gradient should be of length
            one, so that gaps are lengths. If values far exceed the distance, the package may miss
            nodes that pass through a thin obstacle within a step.
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
