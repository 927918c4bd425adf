# SPDX-License-Identifier: MIT
"""What a contact needs to know of the other side: gap, slip increment and frame of each node."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from ..surfaces.faces import surface_normals
from .motion import RigidMotion
from .side import Side


@dataclass(frozen=True)
class Kinematics:
    """Gap, slip increment and frame of a contact point, in UFL.

    Attributes:
        gap: Signed gap (m).
        slip: Slip increment (m) in the frame, ``gdim - 1`` components.
        normal: Unit normal towards the body.
        tangents: Unit tangents.
    """

    gap: Expr
    slip: Expr
    normal: Expr
    tangents: tuple[Expr, ...]

    @classmethod
    def of(cls, gap: Expr, way: Expr, normal: Expr, first: Expr) -> Kinematics:
        """Complete a frame and take the slip in it.

        Args:
            gap: Signed gap (m).
            way: How far the node has moved (m) from where the obstacle's point once under it is.
            normal: Unit normal towards the body.
            first: First tangent (3D only).
        """
        if len(normal) == 2:
            tangents: tuple[Expr, ...] = (ufl.as_vector([normal[1], -normal[0]]),)
        else:
            tangents = (first, ufl.cross(normal, first))
        slip = ufl.as_vector([ufl.dot(e, way) for e in tangents])
        return cls(gap, slip, normal, tangents)

    def traction(self, c: Expr) -> Expr:
        """Return the traction vector of the multipliers ``c = (c_n, c_1[, c_2])``."""
        return sum((c[k + 1] * e for k, e in enumerate(self.tangents)), c[0] * self.normal)


def first_tangent(normal: Expr, hint: Expr) -> Expr:
    """Return the unit vector along the tangential part of a hint."""
    first = hint - ufl.dot(hint, normal) * normal
    return first / ufl.sqrt(ufl.dot(first, first))


@dataclass(frozen=True)
class View:
    """How an obstacle looks at a surface, one entry an owned node.

    Attributes:
        cosine: Of the obstacle's normal and the surface's averaged outward normal, -1 where they
            oppose each other.
        gap: Distance in front of the obstacle (m); infinite beyond the edge of a surface.
        lost: How deep (m) the node is behind what it should meet and is too deep to; else 0.
    """

    cosine: npt.NDArray[np.floating]
    gap: npt.NDArray[np.floating]
    lost: npt.NDArray[np.floating]


class Obstacle(ABC):
    """What a body meets: a rigid obstacle, or the surface of a deformable body.

    The laws see an obstacle's :class:`Kinematics` only. The other methods are for obstacles whose
    kinematics UFL cannot express in the node's own displacement; by default they do nothing.

    Attributes:
        motion: A rigid motion that the user sets, if any.
        deformable: Whether the kinematics depend on the displacement of other nodes.
        lost: Owned nodes whose gap is not known at the present displacement, if any.
    """

    motion: RigidMotion | None = None
    deformable = False
    lost: npt.NDArray[np.bool_] | None = None

    def view(self, contact: Side, u: fem.Function) -> View:
        """Return how the obstacle looks at the surface; collective.

        Args:
            contact: The contact.
            u: Displacement.
        """
        cosine = np.sum(contact.nodal_normal() * surface_normals(contact.surface, u), axis=1)
        gap = contact.gap_and_friction()[0]
        return View(cosine, gap, np.zeros_like(gap))

    def stiffness(self, diagonal: npt.NDArray[np.floating], V: fem.FunctionSpace) -> float:
        """Return the smallest stiffness over area (Pa/m) of the obstacle's nodes; collective.

        Args:
            diagonal: Mean diagonal of the bulk stiffness (N/m) at the local (blocked) dofs.
            V: Space of the displacement.
        """
        return float("inf")

    def rounding(self, contact: Side) -> npt.NDArray[np.floating]:
        """Return the lengths (m), beside displacements, whose last digits gaps and slips round to.

        They are those of the coordinates and the obstacle's motion; one an owned node; collective.
        """
        return np.zeros(contact.surface.num_owned)

    def crossed(
        self,
        contact: Side,
        u: fem.Function,
        u_old: fem.Function,
        closed: npt.NDArray[np.bool_],
    ) -> npt.NDArray[np.bool_]:
        """Tell which nodes have gone through the obstacle since the last step; collective.

        Args:
            contact: The contact.
            u: Displacement, of a step that is about to be accepted.
            u_old: Displacement of the last accepted step.
            closed: Owned nodes that are held by a closed contact: they are not asked for.

        Returns:
            One flag an owned node.
        """
        return np.zeros(len(closed), dtype=bool)

    def save(self) -> object:
        """Return what a step changes in the obstacle, its ``motion`` aside; not collective."""
        return None

    def restore(self, saved: Any) -> None:  # noqa: B027 - rigid obstacles need none
        """Put back what :meth:`save` returned, bit for bit; not collective."""

    @abstractmethod
    def kinematics(self, contact: Side, u: fem.Function, u_old: fem.Function) -> Kinematics:
        """Derive the kinematics of the nodes of the contact's surface.

        Args:
            contact: The contact. The first tangent (3D) is the tangential part of its ``hint``.
            u: Displacement.
            u_old: Displacement of the last accepted step.
        """

    def update(self) -> None:  # noqa: B027 - rigid obstacles need none
        """Follow the displacement; collective."""

    def search(self) -> bool:
        """Look again for what each node meets, after a solve; collective.

        Returns:
            Whether it has changed for any node of any rank.
        """
        return False

    def anchor(self) -> None:  # noqa: B027 - rigid obstacles need none
        """Begin an increment at ``u_old``; collective."""

    def prescribed(
        self, fixed: fem.Function, nodes: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        """Return which directions are prescribed to both sides; collective.

        Args:
            fixed: 1 at the prescribed dofs of the displacement, else 0.
            nodes: The same for the owned nodes of the surface, one row a node.
        """
        return nodes
