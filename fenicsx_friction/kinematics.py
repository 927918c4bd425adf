# SPDX-License-Identifier: MIT
"""What a contact needs to know of the other side: gap, slip increment and frame of each node."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from ufl.core.expr import Expr

if TYPE_CHECKING:
    from .contact import Contact
    from .motion import RigidMotion


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

    def traction(self, c: Expr) -> Expr:
        """Return the traction vector of the multipliers ``c = (c_n, c_1[, c_2])``."""
        return sum((c[k + 1] * e for k, e in enumerate(self.tangents)), c[0] * self.normal)


class Obstacle(ABC):
    """What a body meets: a rigid obstacle, or the surface of a deformable body.

    The laws see an obstacle's :class:`Kinematics` only. The other methods are for obstacles whose
    kinematics UFL cannot express in the node's own displacement; by default they do nothing.

    Attributes:
        motion: A rigid motion that the user sets, if any.
        deformable: Whether the kinematics depend on the displacement of other nodes.
    """

    motion: RigidMotion | None = None
    deformable = False

    @abstractmethod
    def kinematics(self, contact: Contact, u: fem.Function, u_old: fem.Function) -> Kinematics:
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
