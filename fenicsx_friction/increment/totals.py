# SPDX-License-Identifier: MIT
"""Totals of one contact: states, force, moment and dissipation."""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from ..certificate.nodal_state import OPEN, SLIP, STICK, NodalState
from ..contact.contact import Contact
from ..obstacles.kinematics import Array
from ..obstacles.rigid_body import RigidBody
from .report import BodyReport, ContactReport


def total(contact: Contact, state: NodalState) -> ContactReport:
    """Total the nodal values of a contact over all ranks; collective."""
    counts = np.bincount(state.states()[state.takes_part], minlength=3)
    x, forces = contact.pairing.acting()
    force, moment = forces.sum(axis=0), _moment(x, forces)
    if contact.surface.axisymmetric:
        moment *= 0.0
    work = -np.einsum("i,ij,ij->", state.area, state.c[:, 1:], state.slip)
    sums = np.array([*counts, *force, *moment, state.area @ state.c[:, 0], work])
    sums = contact.surface.mesh.comm.allreduce(sums, MPI.SUM)
    return ContactReport(
        name=contact.surface.name,
        open=int(sums[OPEN]),
        stick=int(sums[STICK]),
        slip=int(sums[SLIP]),
        force=tuple(sums[3 : 3 + len(force)].tolist()),
        normal_force=float(sums[-2]),
        moment=tuple(sums[3 + len(force) : -2].tolist()),
        dissipation=float(sums[-1]),
        penetration=contact.surface.mesh.comm.allreduce(contact.pairing.penetration(), MPI.MAX),
    )


def totals_of_bodies(
    bodies: Sequence[RigidBody], contacts: Sequence[Contact], reports: Sequence[ContactReport]
) -> tuple[BodyReport, ...]:
    """Total the forces on rigid bodies that carry loads, from those of the contacts."""
    found = []
    for body in bodies:
        pairs = zip(contacts, reports, strict=True)
        own = [report for k, report in pairs if k.pairing.body is body]
        force = -np.sum([report.force for report in own], axis=0)
        about_origin = -np.sum([report.moment for report in own], axis=0)
        if any(k.surface.axisymmetric for k in contacts if k.pairing.body is body):
            force[0] = 0.0  # radial tractions of a ring have no resultant
        center = body.center + body.translated()
        moment = about_origin - _moment(center[None], force[None])
        parts = (body.translated(), body.rotation(), force, moment)
        found.append(BodyReport(body.name, *(tuple(part.tolist()) for part in parts)))
    return tuple(found)


def _moment(x: Array, forces: Array) -> Array:
    """Return the moment of nodal forces about the origin; about ``z`` alone in 2D."""
    if x.shape[1] == 2:
        return np.array([np.sum(x[:, 0] * forces[:, 1] - x[:, 1] * forces[:, 0])])
    return np.asarray(np.cross(x, forces).sum(axis=0))
