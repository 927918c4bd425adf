# SPDX-License-Identifier: MIT
"""Rigid bodies that carry loads: obstacles whose motion is unknown."""

from __future__ import annotations

from collections.abc import Sequence

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, mesh
from ufl.core.expr import Expr

from ..base.compilation import compiled
from ..base.errors import ContactInputError
from ..base.validators import shown, text, vector
from ..surfaces.cells import extent
from .motion import Motion
from .rotations import as_rotation, cayley_vector, cross_matrix, turned_by, turned_in_plane

Array = npt.NDArray[np.floating]

#: Names of the components of the motion.
COMPONENTS = {2: ("x", "y", "rz"), 3: ("x", "y", "z", "rx", "ry", "rz")}


class RigidBody(Motion):
    """A rigid body whose motion follows from its loads, or is prescribed, component by component.

    It is the ``motion`` of one or several obstacles. Each component is free, with a load (zero by
    default), or it has a given value. The components are ``x, y[, z]`` of the translation and
    ``rz`` in 2D, ``rx, ry, rz`` in 3D of the rotation::

        tool = ff.RigidBody(msh, center=(0.0, 1.0), free=("y", "rz"))
        tool.force.value[:] = (0.0, -100.0)
        ball = ff.RigidSphere((0.0, 1.0), 1.0, motion=tool)

    Rotations are finite. In 3D the unknown is the rotation of the step, about axes of space. A
    rotation that is given is the whole one, as a rotation vector. Where only some of its components
    are given, the step leads there with the others as they were; what these do in the step is made
    good in the next one.

    Args:
        msh: The mesh of the deformable body.
        center: The point that translation, moment and rotation refer to (m); the origin by default.
        free: The free components; all others have given values.
        spring: Stiffness (N/m; N m/rad) of a spring to the ground at each component; in 3D for
            translations only.
        name: Name used in messages and reports.

    Attributes:
        q: The unknown motion: translation (m), and rotation (rad).
        q_rate: Change of ``q`` in the last accepted step over its length (m/s, rad/s).
        force: Force at the center (N; per unit depth in 2D), which moves with the body: a Constant.
        moment: Moment about the center (N m): a Constant, one component in 2D.
        given: Translation (m) and rotation (rad) of components that are not free: a Constant.
        spring: As given, a Constant.
        length: By which moments become forces (m).
        unit: What makes forces of the rows: one, and one over the length for moments.
    """

    def __init__(
        self,
        msh: mesh.Mesh,
        *,
        center: Sequence[float] | None = None,
        free: Sequence[str] = (),
        spring: Sequence[float] | None = None,
        name: str = "body",
    ) -> None:
        super().__init__(msh, center)
        self.name, d = text(name, "The name of a rigid body"), msh.geometry.dim
        self.names = COMPONENTS[d]
        n = len(self.names)
        element = basix.ufl.real_element(msh.basix_cell(), (n,))
        self.q = fem.Function(fem.functionspace(msh, element), name=name)
        self.q_rate = fem.Function(self.q.function_space, name=f"{name}_rate")
        self.translation = ufl.as_vector([self.q[i] for i in range(d)])
        self.force = fem.Constant(msh, np.zeros(d))
        self.moment = fem.Constant(msh, np.zeros(n - d))
        self.given, self.spring, self._target = (fem.Constant(msh, np.zeros(n)) for _ in range(3))
        self._old_angle = fem.Constant(msh, 0.0)
        self._old_turned = fem.Constant(msh, np.zeros((d, d)))
        self._mask, self._stiffness = (fem.Constant(msh, np.ones(n)) for _ in range(2))
        self.length = extent(msh)
        self.unit = np.array([1.0] * d + [1.0 / self.length] * (n - d))
        self.free = free
        if spring is not None:
            self.spring.value[:] = self._checked(spring)

    def _checked(self, spring: Sequence[float]) -> Array:
        """Return the stiffness of the springs, or raise."""
        values = vector(spring, f"The springs of body '{self.name}'", dimension=len(self.names))
        if np.any(values < 0.0) or (len(self.center) == 3 and np.any(values[3:] != 0.0)):
            raise ContactInputError(
                f"The springs of body '{self.name}', {shown(spring)}, must not be negative, and "
                f"zero for the rotations in 3D; give one for each of {', '.join(self.names)}."
            )
        return values

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse another object in place of a Constant, which the equations would not know."""
        if name in ("force", "moment", "given", "spring", "q") and name in vars(self):
            raise ContactInputError(
                f"Body '{self.name}': set the values of its {name}, body.{name}.value[:] = ..., "
                "not the attribute itself."
            )
        super().__setattr__(name, value)

    @property
    def free(self) -> tuple[str, ...]:
        """The free components; may be changed between steps."""
        pairs = zip(self.names, self._mask.value, strict=True)
        return tuple(name for name, free in pairs if free > 0.5)

    @free.setter
    def free(self, names: Sequence[str]) -> None:
        names = (names,) if isinstance(names, str) else names
        if not isinstance(names, list | tuple):
            raise ContactInputError(
                f"Body '{self.name}': free = {shown(names)} must be names out of "
                f"{', '.join(self.names)}."
            )
        if unknown := [name for name in names if name not in self.names]:
            raise ContactInputError(
                f"Body '{self.name}': free = {shown(names)} has {unknown[0]!r}; the components are "
                f"{', '.join(self.names)}."
            )
        self._mask.value[:] = [name in names for name in self.names]

    @property
    def released(self) -> npt.NDArray[np.bool_]:
        """Tells of each component whether it is free."""
        return np.asarray(self._mask.value > 0.5)

    # -- the equations ---------------------------------------------------------------------------

    def scale(self, stiffness: float) -> None:
        """Take a stiffness (N/m) by which distances from given values become forces."""
        self._stiffness.value[:] = stiffness
        self._stiffness.value[len(self.center) :] *= self.length

    def residual(self) -> ufl.Form:
        """Return the balance of forces, and of moments over the length, without contact (N).

        Rows of components that are not free hold their distance from the given value.
        """
        msh, v = self.mesh, ufl.TestFunction(self.q.function_space)
        d, n = len(self.center), len(self.names)
        dx = ufl.dx(domain=msh, metadata={"quadrature_degree": 2})
        volume = compiled(fem.form, msh.comm)(fem.Constant(msh, 1.0) * dx)
        share = fem.Constant(msh, 1.0 / msh.comm.allreduce(fem.assemble_scalar(volume)))
        unit = fem.Constant(msh, self.unit)
        loads = [self.force[i] for i in range(d)] + [self.moment[i] for i in range(n - d)]
        rows = []
        for i in range(n):
            balance = unit[i] * (self.spring[i] * self.q[i] - loads[i])
            held = self._stiffness[i] * (self.q[i] - self._target[i])
            rows.append(self._mask[i] * balance + (1.0 - self._mask[i]) * held)
        return share * sum(row * v[i] for i, row in enumerate(rows)) * dx

    def slopes(self) -> Array:
        """Return the derivatives of the rows of :meth:`residual`, each by its own component."""
        return np.where(self.released, self.unit * self.spring.value, self._stiffness.value)

    def loads(self) -> float:
        """Return the largest load or force of a spring, of free components (N)."""
        loads = np.append(self.force.value, self.moment.value)
        sizes = self.unit * np.maximum(abs(loads), abs(self.spring.value * self.q.x.array))
        return float(np.max(sizes[self.released], initial=0.0))

    def enter(self) -> None:
        """Take the given values."""
        held = ~self.released
        self.q.x.array[held] = self._target.value[held]

    def settings(self) -> Array:
        """Return all that the user sets, for comparison between ranks."""
        parts = (self.force, self.moment, self.given, self.spring, self._mask)
        return np.concatenate([np.ravel(part.value) for part in parts])

    def begin(self) -> None:
        """Begin a step: find the motion of the step that leads to the given values."""
        d, target = len(self.center), self.given.value.copy()
        if d == 3:
            old = np.eye(3) + self._old_turned.value
            target[3:] = cayley_vector(old, target[3:], ~self.released[3:])
        self._target.value[:] = target

    # -- where it is -----------------------------------------------------------------------------

    def _step_matrix(self) -> Expr:
        """Return the rotation matrix of the step in 3D, less the identity (Cayley's)."""
        v = ufl.as_vector([self.q[i] for i in range(3, 6)])
        K = cross_matrix(v)
        return 4.0 / (4.0 + ufl.dot(v, v)) * (K + 0.5 * K * K)

    def _turned(self) -> Expr:
        """Return the rotation matrix less the identity."""
        if len(self.center) == 2:
            return turned_in_plane(self.q[2])
        step = self._step_matrix()
        return step + self._old_turned + step * self._old_turned

    def _turned_in_step(self) -> Expr:
        """Return that of the rotation of the step."""
        if len(self.center) == 2:
            return turned_in_plane(self.q[2] - self._old_angle)
        return self._step_matrix()

    def translated(self) -> Array:
        """Return the translation (m)."""
        return np.asarray(self.q.x.array[: len(self.center)])

    def turned_in_step_by(self) -> Array:
        """Return that of the rotation of the step."""
        if len(self.center) == 2:
            return turned_by(float(self.q.x.array[2] - self._old_angle.value))
        x, y, z = v = self.q.x.array[3:]
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return np.asarray(4.0 / (4.0 + v @ v) * (K + 0.5 * K @ K))

    def turned_by(self) -> Array:
        """Return the rotation matrix less the identity."""
        if len(self.center) == 2:
            return turned_by(float(self.q.x.array[2]))
        step, old = self.turned_in_step_by(), self._old_turned.value
        return np.asarray(step + old + step @ old)

    def rotation(self) -> Array:
        """Return the rotation (rad): the angle in 2D, the rotation vector in 3D."""
        if len(self.center) == 2:
            return self.q.x.array[2:].copy()
        return np.asarray(as_rotation(np.eye(3) + self.turned_by()).as_rotvec())

    def commit(self) -> None:
        """Make the present position that of the last accepted step."""
        super().commit()
        if len(self.center) == 2:
            self._old_angle.value = self.q.x.array[2]
            return
        self._old_turned.value = as_rotation(np.eye(3) + self.turned_by()).as_matrix() - np.eye(3)
        self.q.x.array[3:] = 0.0  # the next step's

    @property
    def _values(self) -> Sequence[Array]:
        """All that describes the position."""
        constants = (self._old_translation, self._old_angle, self._old_turned, self._mask)
        return [self.q.x.array, self.q_rate.x.array, *(constant.value for constant in constants)]
