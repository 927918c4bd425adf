# SPDX-License-Identifier: MIT
"""Forces of contact on a rigid body that carries loads, and how they follow its motion.

A row of them is a force, and the moment about the body's center where this is now, over a length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .kinematics import frame_slopes, frames, slices
from .rigid_body import RigidBody
from .rigid_pairing import RigidPairing

Array = npt.NDArray[np.floating]


@dataclass(frozen=True)
class Reactions:
    """Tractions of contact at points, as rows of forces and moments, with their derivatives.

    They are those on the deformable body; the rigid one has the opposite ones.

    Attributes:
        values: The rows over the area, (points, rows).
        by_c: Their derivatives by the multipliers, (points, rows, d).
        by_x: By the point's displacement, (points, rows, d).
        by_q: By the motion of the body, (points, rows, components).
        force_by_q: Derivatives of the tractions in global axes by this motion.
    """

    values: Array
    by_c: Array
    by_x: Array
    by_q: Array
    force_by_q: Array


@np.errstate(over="ignore", invalid="ignore")  # Newton may have gone to infinity
def reactions(
    values: Array, slopes: tuple[Array, Array], c: Array, center: Array, length: float
) -> Reactions:
    """Return the reactions at points.

    Args:
        values: The kinematics at the points, one row each.
        slopes: Their derivatives by the point's displacement, and by the motion of the body.
        c: Multipliers of the points.
        center: Where the body's center is now (m).
        length: By which moments are divided (m).
    """
    d = c.shape[1]
    arm = values[:, slice(*slices(d)[-1])] - center
    axes = frames(values, d)
    force = np.einsum("nk,nkd->nd", c, axes)
    by_x, by_q = (np.einsum("nk,nkdz->ndz", c, frame_slopes(values, s, d)) for s in slopes)
    unit = np.broadcast_to(np.eye(d), (len(c), d, d))
    moved = np.zeros((len(c), d, by_q.shape[2]))
    moved[:, :, :d] = -np.eye(d)  # of the arm, by the motion of the center

    def rows(force: Array, arm: Array, force_slopes: Array, arm_slopes: Array) -> Array:
        """Return derivatives of rows from those of forces and arms, (points, d, z)."""
        moments = _cross(arm[:, :, None], force_slopes) + _cross(arm_slopes, force[:, :, None])
        return np.concatenate([force_slopes, moments / length], axis=1)

    moment = _cross(arm[:, :, None], force[:, :, None])[:, :, 0] / length
    return Reactions(
        np.concatenate([force, moment], axis=1),
        rows(force, arm, axes.transpose(0, 2, 1), np.zeros((len(c), d, d))),
        rows(force, arm, by_x, unit),
        rows(force, arm, by_q, moved),
        by_q,
    )


def body_slopes(pairing: RigidPairing) -> Array:
    """Return the derivatives of the kinematic field by the motion: (nodes, entries, components)."""
    return _average_matrices(pairing, pairing.kernel.derivatives()[1])


def body_rows(pairing: RigidPairing, body: RigidBody) -> Array:
    """Return each node's share of the balance of the body (N): forces and moments; collective."""
    rows = pairing.averages(_at_sites(pairing, body).values)
    return np.asarray(rows * body.released * pairing.acting_area()[:, None])


def body_blocks(pairing: RigidPairing, body: RigidBody) -> list[Array]:
    """Return how forces follow the motion, and the rows of the body everything; collective.

    Blocks (nodes, rows, columns): the balance of forces of the stencil by the motion; the rows of
    the body (N) by the multipliers, by the stencil, and by the motion.
    """
    at, free = _at_sites(pairing, body), body.released[:, None]
    area = pairing.acting_area()[:, None, None]
    sites, size, d = at.by_x.shape
    forces = pairing.spread(at.force_by_q.reshape(sites, d * size))
    by_x = pairing.spread(at.by_x.reshape(sites, size * d))
    n, points = forces.shape[:2]
    by_stencil = by_x.reshape(n, points, size, d).transpose(0, 2, 1, 3)
    return [
        -area * forces.reshape(n, points * d, size),
        area * free * _average_matrices(pairing, at.by_c),
        area * free * by_stencil.reshape(n, size, points * d),
        area * free * _average_matrices(pairing, at.by_q),
    ]


def _at_sites(pairing: RigidPairing, body: RigidBody) -> Reactions:
    """Return the reactions where the obstacle is met; collective."""
    pairing.update()
    by_u, by_q = pairing.kernel.derivatives()
    c = pairing.side.nodal(pairing.side.c)[pairing.node_of_site()]
    center = body.center + body.translated()
    return reactions(pairing.kernel.values(), (by_u, by_q), c, center, body.length)


def _average_matrices(pairing: RigidPairing, matrices: Array) -> Array:
    """Return the values of the nodes from matrices where the obstacle is met."""
    sites, rows, columns = matrices.shape
    found = pairing.averages(matrices.reshape(sites, rows * columns))
    return np.asarray(found.reshape(len(found), rows, columns))


def _cross(a: Array, b: Array) -> Array:
    """Return cross products along the second axis: one component in 2D."""
    if a.shape[1] == 2:
        return np.asarray(a[:, :1] * b[:, 1:] - a[:, 1:] * b[:, :1])
    return np.stack([a[:, i - 2] * b[:, i - 1] - a[:, i - 1] * b[:, i - 2] for i in range(3)], 1)
