# SPDX-License-Identifier: MIT
"""The tractions of the contacts, body by body, and their scales."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from ..base.collective import largest_of_ranks
from ..base.groups import Array, Groups, Labels
from ..certificate.scales import DIGITS, FAINT, Scales
from ..contact.bonds import at_bonds
from ..contact.contact import Contact
from .body_equation import loads_of


class Tractions:
    """Measures the tractions of contacts (Pa), one group for each contact and body.

    Args:
        comm: All ranks.
        contacts: The contacts.
        bodies: The body of each owned node of each contact.
        number: Number of bodies.
        extent: Size of the mesh (m): what moves a node by more would hide errors.

    Attributes:
        groups: Groups the owned nodes of each contact, by body.
    """

    #: What :meth:`begin` sets: arrays that are replaced, never changed.
    AT_START = ("_before", "_coordinates", "_resting")

    def __init__(
        self,
        comm: MPI.Intracomm,
        contacts: Sequence[Contact],
        bodies: Sequence[Labels],
        number: int,
        extent: float,
    ) -> None:
        self._comm, self._contacts, self._number = comm, contacts, number
        self.groups = [Groups(body, number) for body in bodies]
        self._per_area = self._by_contact([1.0 / k.nodal_area() for k in contacts])
        self._most = self._by_contact([extent * k.nodal_scale() for k in contacts])

    def begin(self) -> None:
        """Keep the tractions at the start of a step; collective."""
        self._before = self._by_contact(self._lengths())
        self._coordinates = [k.pairing.rounding() for k in self._contacts]
        bonds = map(at_bonds, self._contacts, self._coordinates)
        self._resting = DIGITS * self._by_contact(list(bonds))

    def forces(self) -> Array:
        """Return the largest contact force on a node of each body (N), of this rank."""
        largest = np.zeros(self._number)
        for k, group, lengths in zip(self._contacts, self.groups, self._lengths(), strict=True):
            largest = np.maximum(largest, group.largest(k.nodal_area() * lengths))
        return largest

    def scales(self, forces: Array, given: Array, length: Array, noise: Array) -> Scales:
        """Measure all groups; collective.

        Args:
            forces: Forces of each body, now and at the start (N).
            given: Forces of each body that its given displacements leave unresolved (N).
            length: These displacements times the digits (m).
            noise: Measured rounding errors of the forces of each body (N). They excuse no
                traction that is larger.
        """
        each = len(self._contacts)
        rounded = [
            k.nodal_scale() * (k.distance() + lengths)
            for k, lengths in zip(self._contacts, self._coordinates, strict=True)
        ]
        unresolved = DIGITS * self._by_contact(rounded)
        bonded = np.where(self._resting > 0.0, unresolved, 0.0)  # slips of bonds are rounding
        largest = self._by_contact(self._lengths())
        noise = np.tile(noise, each) * self._per_area
        noise = np.where(largest <= noise, noise, 0.0)
        loads = np.maximum(np.tile(forces, each), np.repeat(loads_of(self._contacts), self._number))
        return Scales(
            np.minimum(largest, self._most),
            np.maximum(self._before, FAINT * loads * self._per_area),
            unresolved,
            np.maximum(np.tile(given, each) * self._per_area, bonded),
            np.maximum(np.tile(length, each), self._resting),
            noise,
            np.zeros(each * self._number, dtype=bool),
        )

    def _lengths(self) -> list[Array]:
        """Return the length of each node's traction, one array a contact."""
        return [np.linalg.norm(k.multipliers(), axis=1) for k in self._contacts]

    def _by_contact(self, values: Sequence[Array]) -> Array:
        """Return the largest values of each contact, body by body, of all ranks."""
        largest = [g.largest(v) for g, v in zip(self.groups, values, strict=True)]
        return largest_of_ranks(self._comm, np.concatenate(largest))
