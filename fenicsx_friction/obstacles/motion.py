# SPDX-License-Identifier: MIT
"""Rigid motions of obstacles: a translation and a rotation."""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import scipy
import ufl
from dolfinx import default_scalar_type, fem, mesh
from ufl.core.expr import Expr

from ..base.errors import ContactInputError
from ..base.validators import instance, vector
from .rotations import cross_matrix, turned_in_plane

Array = npt.NDArray[np.floating]


class Motion(ABC):
    """A rigid motion, now and at the last accepted step.

    A point ``X`` of the unmoved obstacle is at ``center + translation + R (X - center)``.

    Args:
        msh: The mesh of the body that meets the obstacle.
        center: The center (m); the origin by default.

    Attributes:
        mesh: The mesh of the body.
        translation: Translation (m), in UFL.
    """

    translation: Expr

    def __init__(self, msh: mesh.Mesh, center: Sequence[float] | None) -> None:
        what = f"The mesh of a {type(self).__name__}"
        instance(msh, mesh.Mesh, what, "the mesh of the body")
        self.mesh, d = msh, msh.geometry.dim
        self.center = vector(
            np.zeros(d) if center is None else center, "The center of rotation", dimension=d
        )
        self._center_in_ufl = fem.Constant(msh, self.center)
        self._old_translation = fem.Constant(msh, np.zeros(d, dtype=default_scalar_type))
        self._problem: weakref.ref[object] | None = None

    # -- in UFL ----------------------------------------------------------------------------------

    @abstractmethod
    def _turned(self) -> Expr:
        """Return the rotation matrix less the identity, exact where it is small."""

    @abstractmethod
    def _turned_in_step(self) -> Expr:
        """Return that of the rotation since the last accepted step."""

    def undo(self, x: Expr) -> Expr:
        """Return the point of the unmoved obstacle that is at ``x`` now."""
        center = self._center_in_ufl
        back = ufl.transpose(ufl.Identity(len(self.center)) + self._turned())
        return center + ufl.dot(back, x - center - self.translation)

    def displacement(self, X: Expr) -> Expr:
        """Return how far the point ``X`` of the unmoved obstacle has moved (m)."""
        return self.translation + ufl.dot(self._turned(), X - self._center_in_ufl)

    def turned(self, direction: Expr) -> Expr:
        """Return how much the rotation has changed a direction."""
        return ufl.dot(self._turned(), direction)

    def carried_along(self, x: Expr) -> Expr:
        """Return how far the point at ``x`` at the last accepted step has moved since (m)."""
        arm = x - self._center_in_ufl - self._old_translation
        return self.translation - self._old_translation + ufl.dot(self._turned_in_step(), arm)

    # -- in numbers ------------------------------------------------------------------------------

    @abstractmethod
    def translated(self) -> Array:
        """Return the translation (m)."""

    @abstractmethod
    def turned_by(self) -> Array:
        """Return the rotation matrix less the identity."""

    @abstractmethod
    def turned_in_step_by(self) -> Array:
        """Return that of the rotation since the last accepted step."""

    def undone(self, x: Array) -> Array:
        """Return :meth:`undo` of points, one row a point."""
        arm = x - self.center - self.translated()
        return np.asarray(self.center + arm + arm @ self.turned_by())

    def carried(self, x: Array) -> Array:
        """Return where points of the last accepted step are now, one row a point."""
        arm = x - self.center - self._old_translation.value
        turned = arm @ self.turned_in_step_by().T
        return np.asarray(self.center + self.translated() + arm + turned)

    def moved(self, X: Array) -> Array:
        """Return :meth:`displacement` of a point."""
        return np.asarray(self.translated() + self.turned_by() @ (X - self.center))

    # -- from step to step -----------------------------------------------------------------------

    def claim(self, problem: object) -> None:
        """Belong to a problem, which commits the positions.

        Raises:
            ContactInputError: If another living problem does that.
        """
        owner = None if self._problem is None else self._problem()
        if owner is not None and owner is not problem:
            name = type(self).__name__
            raise ContactInputError(
                f"This {name} already moves an obstacle of another problem, which would commit "
                f"its positions; make a {name} of its own for each problem."
            )
        self._problem = weakref.ref(problem)

    def commit(self) -> None:
        """Make the present position that of the last accepted step."""
        self._old_translation.value = self.translated()

    @property
    @abstractmethod
    def _values(self) -> Sequence[Array]:
        """All that describes the position, to be read and written."""

    def save(self) -> list[npt.NDArray[np.floating]]:
        """Copy the position, present and of the last accepted step."""
        return [values.copy() for values in self._values]

    def restore(self, position: list[npt.NDArray[np.floating]]) -> None:
        """Put a saved position back."""
        for values, saved in zip(self._values, position, strict=True):
            values[...] = saved


class RigidMotion(Motion):
    """Translation and rotation of an obstacle, two Constants to be set before a step.

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

    translation: fem.Constant

    def __init__(
        self,
        msh: mesh.Mesh,
        *,
        center: Sequence[float] | None = None,
        axis: Sequence[float] = (0.0, 0.0, 1.0),
    ) -> None:
        super().__init__(msh, center)
        direction = vector(axis, "The axis of rotation", dimension=3)
        if not direction.any():
            raise ContactInputError(f"The axis of rotation {axis} has no direction.")
        self._axis = direction / np.linalg.norm(direction)
        self._axis_in_ufl = fem.Constant(msh, self._axis)
        d = msh.geometry.dim
        self.translation = fem.Constant(msh, np.zeros(d, dtype=default_scalar_type))
        self.angle, self._old_angle = (
            fem.Constant(msh, default_scalar_type(0.0)) for _ in range(2)
        )

    def _turned(self) -> Expr:
        """Return the rotation matrix less the identity."""
        return self._by(self.angle)

    def _turned_in_step(self) -> Expr:
        """Return that of the rotation of the step."""
        return self._by(self.angle - self._old_angle)

    def _by(self, angle: Expr) -> Expr:
        """Return the matrix of a rotation by an angle, less the identity."""
        if len(self.center) == 2:
            return turned_in_plane(angle)
        a, versine = self._axis_in_ufl, 2.0 * ufl.sin(angle / 2.0) ** 2
        return ufl.sin(angle) * cross_matrix(a) + versine * (ufl.outer(a, a) - ufl.Identity(3))

    def translated(self) -> Array:
        """Return the translation (m)."""
        return np.asarray(self.translation.value)

    def turned_by(self) -> Array:
        """Return the rotation matrix less the identity."""
        return self._turn(float(self.angle.value)) - np.eye(len(self.center))

    def turned_in_step_by(self) -> Array:
        """Return that of the rotation of the step."""
        angle = float(self.angle.value) - float(self._old_angle.value)
        return self._turn(angle) - np.eye(len(self.center))

    def _turn(self, angle: float) -> Array:
        """Return the rotation matrix of an angle."""
        d = len(self.center)
        axis = self._axis if d == 3 else np.array([0.0, 0.0, 1.0])
        rotation = scipy.spatial.transform.Rotation.from_rotvec(angle * axis)
        return np.asarray(rotation.as_matrix()[:d, :d])

    def commit(self) -> None:
        """Make the present position that of the last accepted step."""
        super().commit()
        self._old_angle.value = self.angle.value

    @property
    def _values(self) -> Sequence[Array]:
        """All that describes the position."""
        constants = (self.translation, self._old_translation, self.angle, self._old_angle)
        return [constant.value for constant in constants]
