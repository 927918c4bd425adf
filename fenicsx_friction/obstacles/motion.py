# SPDX-License-Identifier: MIT
"""Rigid motion of an obstacle: a translation and a rotation, set by the user before each step."""

import weakref
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import default_scalar_type, fem, mesh
from scipy.spatial.transform import Rotation
from ufl.core.expr import Expr

from ..base.errors import ContactInputError
from ..base.validators import instance, vector

Array = npt.NDArray[np.floating]


class RigidMotion:
    """Translation and rotation of an obstacle, as ``fem.Constant``s to be set before a step.

    A point ``X`` of the unmoved obstacle is at ``center + translation + R(angle) (X - center)``.

    Args:
        msh: The mesh of the body that meets the obstacle.
        center: Center of rotation (m); the origin by default.
        axis: Axis of rotation in 3D, of any length; ``z`` by default. In 2D rotation is
            counter-clockwise.

    Attributes:
        mesh: The mesh of the body.
        translation: Translation (m).
        angle: Angle (rad).
    """

    def __init__(
        self,
        msh: mesh.Mesh,
        *,
        center: Sequence[float] | None = None,
        axis: Sequence[float] = (0.0, 0.0, 1.0),
    ) -> None:
        instance(msh, mesh.Mesh, "The mesh of a RigidMotion", "the mesh of the body")
        self.mesh, d = msh, msh.geometry.dim
        where = np.zeros(d) if center is None else center
        self._center = vector(where, "The center of rotation", dimension=d)
        direction = vector(axis, "The axis of rotation", dimension=3)
        if not direction.any():
            raise ContactInputError(f"The axis of rotation {axis} has no direction.")
        self._axis = direction / np.linalg.norm(direction)
        self._center_in_ufl = fem.Constant(msh, self._center)
        self._axis_in_ufl = fem.Constant(msh, self._axis)
        self._problem: weakref.ref[object] | None = None
        self.translation, self._old_translation = (
            fem.Constant(msh, np.zeros(d, dtype=default_scalar_type)) for _ in range(2)
        )
        self.angle, self._old_angle = (
            fem.Constant(msh, default_scalar_type(0.0)) for _ in range(2)
        )

    def undo(self, x: Expr) -> Expr:
        """Return the point of the unmoved obstacle that is at ``x`` now."""
        center = self._center_in_ufl
        back = ufl.transpose(self._rotation(self.angle))
        return center + ufl.dot(back, x - center - self.translation)

    def displacement(self, X: Expr) -> Expr:
        """Return how far the point ``X`` of the unmoved obstacle has moved (m)."""
        center = self._center_in_ufl
        return self.translation + ufl.dot(self._turned(self.angle), X - center)

    def turned(self, direction: Expr) -> Expr:
        """Return how much the rotation has changed a direction."""
        return ufl.dot(self._turned(self.angle), direction)

    def carried_along(self, x: Expr) -> Expr:
        """Return how far the point at ``x`` at the last accepted step has moved since (m)."""
        center = self._center_in_ufl
        turned = self._turned(self.angle - self._old_angle)
        arm = x - center - self._old_translation
        return self.translation - self._old_translation + ufl.dot(turned, arm)

    def undone(self, x: Array) -> Array:
        """Return :meth:`undo` of points in numbers, one row a point."""
        turn = self._turn(float(self.angle.value))
        return np.asarray(self._center + (x - self._center - self.translation.value) @ turn)

    def carried(self, x: Array) -> Array:
        """Return where points of the last accepted step are now, in numbers, one row a point."""
        turn = self._turn(float(self.angle.value) - float(self._old_angle.value))
        arm = x - self._center - self._old_translation.value
        return np.asarray(self._center + self.translation.value + arm @ turn.T)

    def moved(self, X: Array) -> Array:
        """Return :meth:`displacement` of a point in numbers."""
        return np.asarray(self.translation.value + self.turned_by() @ (X - self._center))

    def turned_by(self) -> Array:
        """Return the rotation matrix less the identity, in numbers."""
        return self._turn(float(self.angle.value)) - np.eye(len(self._center))

    def claim(self, problem: object) -> None:
        """Belong to a problem, which commits the positions.

        Raises:
            ContactInputError: If another living problem does that.
        """
        owner = None if self._problem is None else self._problem()
        if owner is not None and owner is not problem:
            raise ContactInputError(
                "This RigidMotion already moves an obstacle of another problem, which would commit "
                "its positions; make a RigidMotion of its own for each problem."
            )
        self._problem = weakref.ref(problem)

    def commit(self) -> None:
        """Make the present position that of the last accepted step."""
        self._old_translation.value = self.translation.value
        self._old_angle.value = self.angle.value

    def save(self) -> list[npt.NDArray[np.floating]]:
        """Copy the position, present and of the last accepted step."""
        return [constant.value.copy() for constant in self._constants]

    def restore(self, position: list[npt.NDArray[np.floating]]) -> None:
        """Put a saved position back."""
        for constant, value in zip(self._constants, position, strict=True):
            constant.value = value

    @property
    def _constants(self) -> tuple[fem.Constant, ...]:
        """All that describes the position."""
        return self.translation, self._old_translation, self.angle, self._old_angle

    def _turn(self, angle: float) -> Array:
        """Return the rotation matrix of an angle in numbers."""
        vector = angle * self._axis
        if len(self._center) == 2:
            vector = np.array([0.0, 0.0, angle])
        d = len(self._center)
        return np.asarray(Rotation.from_rotvec(vector).as_matrix()[:d, :d])

    def _rotation(self, angle: Expr) -> Expr:
        """Return the rotation matrix of an angle."""
        return ufl.Identity(len(self._center)) + self._turned(angle)

    def _turned(self, angle: Expr) -> Expr:
        """Return the rotation matrix less the identity (Rodrigues in 3D), exact at small angles."""
        versine, s = 2.0 * ufl.sin(angle / 2.0) ** 2, ufl.sin(angle)
        if len(self._center) == 2:
            return ufl.as_matrix([[-versine, -s], [s, -versine]])
        a = self._axis_in_ufl
        cross = ufl.as_matrix([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
        return s * cross + versine * (ufl.outer(a, a) - ufl.Identity(3))
