# SPDX-License-Identifier: MIT
"""Gap, slip increment and frame of a contact node, in UFL and as the values of a field.

For every obstacle they are one field on the contact surface, one entry a node::

    gap, slip (d - 1), normal (d)[, first tangent (3, only in 3D)], position (d)

The laws see nothing else of an obstacle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from ..surfaces.surface import ContactSurface

Array = npt.NDArray[np.floating]


@dataclass(frozen=True)
class Kinematics:
    """Gap, slip increment and frame of a contact point, in UFL.

    Attributes:
        gap: Signed gap (m).
        slip: Slip increment (m) in the frame, ``gdim - 1`` components.
        normal: Unit normal towards the body.
        tangents: Unit tangents.
        position: Current position of the node (m).
    """

    gap: Expr
    slip: Expr
    normal: Expr
    tangents: tuple[Expr, ...]
    position: Expr

    @classmethod
    def of(cls, field: Expr, d: int) -> Kinematics:
        """Read the kinematics in ``d`` dimensions from the entries of the field."""
        part = [ufl.as_vector([field[i] for i in range(*where)]) for where in slices(d)[1:]]
        slip, normal, *first, position = part
        return cls(field[0], slip, normal, tangents_of(normal, first), position)


def slices(d: int) -> list[tuple[int, int]]:
    """Return where the field has gap, slip, normal[, first tangent] and position."""
    sizes = [1, d - 1, d, d, d] if d == 3 else [1, d - 1, d, d]
    ends = np.cumsum(sizes)
    return [(int(end - size), int(end)) for size, end in zip(sizes, ends, strict=True)]


def kinematic_field(surface: ContactSurface) -> fem.Function:
    """Return a field for the kinematics of a surface's nodes."""
    size = slices(surface.mesh.geometry.dim)[-1][1]
    return fem.Function(surface.space((size,)), name="kinematics")


def tangents_of(normal: Expr, first: Sequence[Expr]) -> tuple[Expr, ...]:
    """Return the tangents of a frame, in 3D from the first of them."""
    if len(normal) == 2:
        return (ufl.as_vector([normal[1], -normal[0]]),)
    return (first[0], ufl.cross(normal, first[0]))


def entries(gap: Expr, way: Expr, normal: Expr, hint: Expr, axis: Expr | None = None) -> list[Expr]:
    """Return the entries of the field before the position.

    Args:
        gap: Signed gap (m).
        way: Way of the step (m), from where the met point is now.
        normal: Unit normal towards the body.
        hint: Vector whose projection on the tangent plane is the first tangent (3D only).
        axis: Unit normal of a frame that is carried to this normal, ``None`` to make it here.
    """
    if len(normal) == 2:
        first = []
    elif axis is None:
        first = [first_tangent(normal, hint)]
    else:
        first = [carried(first_tangent(axis, hint), axis, normal)]
    slip = [ufl.dot(e, way) for e in tangents_of(normal, first)]
    return [gap, *slip, *normal, *(x for e in first for x in e)]


def first_tangent(normal: Expr, hint: Expr) -> Expr:
    """Return the unit vector along the tangential part of a hint."""
    first = hint - ufl.dot(hint, normal) * normal
    return first / ufl.sqrt(ufl.dot(first, first))


def carried(tangent: Expr, axis: Expr, normal: Expr) -> Expr:
    """Return a tangent after the smallest rotation that takes its axis to a normal.

    A frame that turns about its axis turns all that is carried from it by the same angle: averages
    of slips in carried frames turn with it, whichever tangent was chosen.
    """
    both = 1.0 + ufl.dot(axis, normal)
    safe = ufl.conditional(ufl.gt(both, 1e-9), both, 1.0)  # opposite: there is no such rotation
    return tangent - ufl.dot(normal, tangent) / safe * (axis + normal)


def frames(values: Array, d: int) -> Array:
    """Return the frames ``(n, e_1[, e_2])``, (nodes, d, d), of values of the field."""
    normal, *first = (values[:, slice(*where)] for where in slices(d)[2:-1])
    if d == 2:
        return np.stack([normal, np.stack([normal[:, 1], -normal[:, 0]], axis=1)], axis=1)
    return np.stack([normal, first[0], np.cross(normal, first[0])], axis=1)


class LastFrames:
    """Gives the frames again as long as the values are the same: many ask for them in turn."""

    def __init__(self) -> None:
        self._last: tuple[Array, Array] = (np.zeros(0), np.zeros(0))

    def __call__(self, values: Array, d: int) -> Array:
        """Return what :func:`frames` returns, not to be changed."""
        if not np.array_equal(self._last[0], values):
            self._last = values.copy(), frames(values, d)
        return self._last[1]


def frame_slopes(values: Array, slopes: Array, d: int) -> Array:
    """Return the derivatives of the frames, (nodes, d, d, z), from those of the field."""
    normal, *first = (values[:, slice(*where)] for where in slices(d)[2:-1])
    dn, *de = (slopes[:, slice(*where)] for where in slices(d)[2:-1])
    if d == 2:
        return np.stack([dn, np.stack([dn[:, 1], -dn[:, 0]], axis=1)], axis=1)
    second = np.cross(dn, first[0][:, :, None], axis=1) + np.cross(
        normal[:, :, None], de[0], axis=1
    )
    return np.stack([dn, de[0], second], axis=1)
