# SPDX-License-Identifier: MIT
"""The balance of forces and moments of a rigid body that carries loads, and its scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.groups import Array
from ..certificate.scales import DIGITS, Scales
from ..contact.contact import Contact
from ..obstacles.rigid_body import RigidBody
from .numbering import num_owned


class BodyEquation:
    """Measures the rows of a body; what it has in common with a further equation of the user.

    All rows are forces (moments over a length). Residuals are compared with the forces of contact
    and the loads.

    Args:
        body: The body.
        contacts: Its contacts.

    Attributes:
        linked: It depends on the displacement.
        unit: The rows are forces.
        number, body: One group; that of each owned row.
        slope: Not needed where rows are linked.
        row_factors: The rows need none.
    """

    AT_START = ("_before", "_moved")
    linked, unit, number = True, 1.0, 1

    def __init__(self, body: RigidBody, contacts: Sequence[Contact]) -> None:
        self._body, self._contacts, self._comm = body, contacts, body.mesh.comm
        self.body = np.zeros(num_owned(body.q), dtype=np.int64)
        self.slope = self.row_factors = np.ones(len(self.body))
        self._before: Array = np.zeros(1)
        self._moved = 0.0

    def begin(self) -> None:
        """Begin a step under new loads."""
        self._body.begin()
        self._before, self._moved = self._forces(), self._motion()

    def doubts(self) -> None:
        """Return nothing: forces of contact do not follow from the motion."""

    def find_noise(self, errors: Array) -> None:
        """Nothing to do: forces of contact carry little rounding."""

    def scales(self, bodies: Scales) -> Scales:
        """Measure the body.

        Args:
            bodies: Scales of the forces of the deformable bodies.
        """
        nothing, forces = np.zeros(1), self._forces()
        hidden = DIGITS * np.maximum(forces, self._before)
        length = np.array([DIGITS * max(self._moved, self._motion())])
        strict = np.zeros(1, dtype=bool)
        return Scales(forces, self._before, hidden, nothing, length, nothing, strict)

    def _motion(self) -> float:
        """Return the largest component of the motion (m), rotations times the length."""
        return float(np.max(abs(self._body.q.x.array / self._body.unit)))

    def _forces(self) -> Array:
        """Return the largest of the loads and the sums of the sizes of nodal forces (N)."""
        sums = np.array(
            [
                np.sum(np.linalg.norm(k.multipliers(), axis=1) * k.nodal_area())
                for k in self._contacts
            ]
        )
        total = float(np.sum(self._comm.allreduce(sums)))
        return np.array([max(total, self._body.loads())])


def loads_of(contacts: Sequence[Contact]) -> Array:
    """Return the largest load of the rigid body that each contact meets (N), zero without one."""
    bodies = [k.pairing.body for k in contacts]
    return np.array([0.0 if body is None else body.loads() for body in bodies])


def bodies_of(contacts: Sequence[Contact]) -> list[RigidBody]:
    """Return the rigid bodies that carry loads, each once."""
    motions = [k.obstacle.motion for k in contacts]
    return list({id(m): m for m in motions if isinstance(m, RigidBody)}.values())
