# SPDX-License-Identifier: MIT
"""Whether contact or springs hold the free components of a rigid body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..base.collective import any_rank
from ..base.errors import ContactInputError
from ..certificate.nodal_state import OPEN, NodalState
from ..contact.contact import Contact
from ..obstacles.reaction import body_blocks
from ..obstacles.rigid_body import RigidBody
from ..obstacles.rigid_pairing import RigidPairing

Array = npt.NDArray[np.floating]

#: A node within this fraction of the size of its facets touches.
NEAR = 1e-6
#: Relative singular values below this are rounding: what holds a body does not resist there.
NOTHING = 1e-9
#: Motions (relative to the length of the body's mesh; rad) that are not rounding.
MOVED = 1e-6


def check_held(body: RigidBody, contacts: Sequence[Contact]) -> None:
    """Raise if a body is free, without springs, and touches nothing; collective.

    Args:
        body: The body.
        contacts: All contacts.

    Raises:
        ContactInputError: Names the components that nothing holds.
    """
    every = np.array(body.mesh.comm.allgather(body.settings()))
    if not np.all(np.isfinite(every)):
        raise ContactInputError(
            f"Rigid body '{body.name}': a force, moment, given value or spring is not finite."
        )
    if np.any(every != every[0]):
        raise ContactInputError(
            f"Rigid body '{body.name}': loads, given values, springs or free components differ "
            "between ranks; set the same on all."
        )
    if not np.all(body.spring.value >= 0.0):
        raise ContactInputError(f"Rigid body '{body.name}': a spring is negative.")
    for k in contacts:
        if k.pairing.body is body and k.surface.axisymmetric and set(body.free) - {"y"}:
            raise ContactInputError(
                f"Rigid body '{body.name}' is free in {', '.join(body.free)}, but the surface "
                f"'{k.surface.name}' is axisymmetric: it can only move along the axis, in y."
            )
    loose, touching = _without_springs(body), False
    for k in contacts:
        if k.pairing.body is body:
            near = k.pairing.gaps() <= NEAR * k.pairing.side.facet_size()
            touching |= bool(np.any(near | (k.multipliers()[:, 0] > 0.0)))
    if not any_rank(body.mesh.comm, touching) and np.any(loose):
        names = [name for name, free in zip(body.names, loose, strict=True) if free]
        raise ContactInputError(
            f"Rigid body '{body.name}' touches nothing, so that nothing holds its free components "
            f"{', '.join(names)}. Bring it into contact first, with given values (body.free = (), "
            "body.given), or give it springs."
        )


def adrift(
    body: RigidBody, contacts: Sequence[Contact], states: Sequence[NodalState], start: Array
) -> list[str]:
    """Return the free components that have moved although nothing holds them; collective.

    Where neither contact nor springs resist a motion, each position is as good as another, and what
    a singular matrix gives is arbitrary. A body that has stayed there is as it should be.

    Args:
        body: The body.
        contacts: All contacts.
        states: Their nodal values on this rank.
        start: Motion of the body at the start of the step.
    """
    loose = np.flatnonzero(_without_springs(body))
    if not len(loose):
        return []
    resistance = _resistance(body, contacts, states)[:, loose]
    arms = np.max(abs(resistance), axis=0)  # long ones, if the center is far away
    resists = arms > NOTHING * np.max(arms)
    arms[~resists] = 1.0
    _, sizes, directions = np.linalg.svd(resistance * resists / arms)
    nothing = directions[sizes <= NOTHING * np.max(sizes)]
    moved = ((body.q.x.array - start) / (body.length * body.unit))[loose]
    drift = abs(nothing.T @ (nothing @ (arms * moved))) / arms
    least = MOVED * max(1.0, float(np.max(drift)))  # beside a huge one all are rounding
    return [body.names[i] for i, way in zip(loose, drift, strict=True) if not way <= least]


def _without_springs(body: RigidBody) -> npt.NDArray[np.bool_]:
    """Tell which components are free and have no spring."""
    return np.asarray(body.released & (body.spring.value == 0.0))


def _resistance(
    body: RigidBody, contacts: Sequence[Contact], states: Sequence[NodalState]
) -> Array:
    """Return what resists motions of a body, relative, one column a component; collective.

    Motions are those of points in the distance of the body's length. They meet the pressures and
    friction of closed nodes, and forces that turn with the body or move on it.
    """
    n, comm = len(body.names), body.mesh.comm
    directions: list[Array] = [np.zeros((1, n))]
    turned, force = np.zeros((n, n)), 0.0
    for k, state in zip(contacts, states, strict=True):
        if k.pairing.body is body and isinstance(k.pairing, RigidPairing):
            _, by_c, _, by_q = body_blocks(k.pairing, body)
            closed = state.states() != OPEN  # what others carry is rounding
            directions += _of_nodes(by_c[closed], _rough(state)[closed])
            turned += np.sum(by_q[closed], axis=0) * body.length * body.unit
            force += float(np.linalg.norm(state.c, axis=1)[closed] @ k.nodal_area()[closed])
    triangle = np.linalg.qr(np.concatenate(directions), mode="r")  # small, and resists the same
    parts = [np.concatenate(comm.allgather(triangle)), comm.allreduce(turned)]
    sizes = [float(np.max(abs(parts[0]))), comm.allreduce(force)]
    # Infinite motions may leave no numbers, which resist nothing.
    whole = [s > 0.0 and np.all(np.isfinite(p / s)) for p, s in zip(parts, sizes, strict=True)]
    return np.concatenate(
        [p / s if w else np.zeros_like(p) for p, s, w in zip(parts, sizes, whole, strict=True)]
    )


def _rough(state: NodalState) -> npt.NDArray[np.bool_]:
    """Tell which nodes may have friction."""
    return (state.limit > 0.0) | state.ties | (state.own_map is not None)


def _of_nodes(by_c: Array, rough: npt.NDArray[np.bool_]) -> list[Array]:
    """Return the forces of unit multipliers: pressures, then friction if there is any."""
    rubbing = by_c[rough, :, 1:].transpose(0, 2, 1)
    return [by_c[:, :, 0], rubbing.reshape(len(rubbing) * rubbing.shape[1], by_c.shape[1])]
