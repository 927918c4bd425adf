# SPDX-License-Identifier: MIT
"""One increment condensed on its contact nodes: its data, solution, units and residuals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .cone import project

Array = npt.NDArray[np.floating]
Mask = npt.NDArray[np.bool_]


class NoExactSolution(RuntimeError):
    """No certified solution was found; the increment may have none (a floating body) or several."""


@dataclass(frozen=True)
class Increment:
    """One increment condensed on ``n`` contact nodes in ``d`` dimensions, normal component first.

    Attributes:
        stiffness: Symmetric, possibly singular (floating body), ``(n*d, n*d)``, node-major, N/m.
        load: Condensed external force, ``(n*d,)``, N.
        gap: Gap at zero displacement, ``(n,)``, m; the gap is ``gap + q[:, 0]``.
        previous: Tangential displacement at the last accepted step, ``(n, d-1)``, m.
        mu: Friction coefficient, ``(n,)``.
        free: ``(n, d)``, False where the displacement is prescribed: no contact force acts there
            and the row of ``stiffness`` alone (e.g. ``k q = k value``) governs the displacement.
            False in the normal component takes the node out of contact altogether.
    """

    stiffness: Array
    load: Array
    gap: Array
    previous: Array
    mu: Array
    free: Mask

    def __post_init__(self) -> None:
        """Check shapes and ranges: NumPy would broadcast a wrong shape silently."""
        n, d = self.free.shape
        if n == 0 or d not in (2, 3):
            raise ValueError(f"free must be (n, 2) or (n, 3) with n > 0, is {self.free.shape}")
        shapes = {"stiffness": (n * d, n * d), "load": (n * d,), "gap": (n,), "mu": (n,)}
        for name, shape in (shapes | {"previous": (n, d - 1)}).items():
            value = getattr(self, name)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"{name} must be finite with shape {shape}, is {value.shape}")
        if (self.mu < 0).any():
            raise ValueError(f"mu must not be negative, the smallest is {self.mu.min()}")

    @property
    def contact(self) -> Mask:
        """Components that can carry a contact force, ``(n, d)``."""
        return np.asarray(self.free & self.free[:, :1])

    @property
    def node_stiffness(self) -> Array:
        """Mean diagonal stiffness of the contact components of each node, ``(n,)``, N/m."""
        diagonal = np.diag(self.stiffness).reshape(self.free.shape)
        total = (diagonal * self.contact).sum(axis=1)
        mean = total / np.maximum(self.contact.sum(axis=1), 1)
        # Nodes out of contact need a value too, but none that could set the scale.
        typical = np.median(mean[mean > 0]) if (mean > 0).any() else diagonal.max() or 1.0
        return np.where(mean > 0, mean, typical)


@dataclass(frozen=True)
class ExactSolution:
    """Certified solution; ``force`` acts on the body, compression and gap are positive."""

    displacement: Array
    force: Array
    gap: Array
    slip: Array
    residual: float
    iterations: int


def row_scale(inc: Increment) -> Array:
    """Return 1, and at prescribed rows, whose unit is arbitrary, what makes the diagonal ``k``."""
    diagonal, free = np.diag(inc.stiffness), inc.free.ravel()
    k = np.repeat(inc.node_stiffness, inc.free.shape[1])
    return np.where(free | (diagonal <= 0), 1.0, k / np.where(diagonal > 0, diagonal, 1.0))


def in_own_units(inc: Increment) -> tuple[Increment, float, float]:
    """Return the increment from the last accepted step in its own units, and these units (N, m).

    Counting displacements from ``previous`` keeps a long slide from setting their scale.
    """
    load = inc.load - inc.stiffness @ origin(inc).ravel()
    k = float(np.median(inc.node_stiffness))
    force = float(max(np.abs(load * inc.free.ravel()).max(), -k * inc.gap.min())) or k
    row = row_scale(inc)
    scaled = replace(
        inc,
        stiffness=inc.stiffness * row[:, None] / k,
        load=load * row / force,
        gap=inc.gap * k / force,
        previous=np.zeros_like(inc.previous),
    )
    return scaled, force, force / k


def origin(inc: Increment) -> Array:
    """Return the displacement, ``(n, d)``, from which the nondimensional one is counted."""
    return np.column_stack([np.zeros(len(inc.mu)), inc.previous])


def natural_residual(increment: Increment, displacement: Array, force: Array) -> float:
    """Certify ``(q, r)`` against the unsmoothed increment.

    The largest over the nodes of: equilibrium; ``min(r_n, k g)``; cone violation
    ``|r_t| - mu r_n``; and the natural map ``x - P_K(x - k y)`` of ``x = (mu r_n, r_t)``,
    ``y = (|s|, s)``, which tests complementarity and alignment. The diagonal stiffness ``k`` of
    the node turns displacements into forces, and all is relative to the largest nodal force (or
    1e-4 ``|A| |q|``, if larger, as after unloading: below that, rounding would decide).
    Zero if and only if ``(q, r)`` solves the increment; of first order in any error.

    Args:
        increment: The problem.
        displacement: ``(n, d)``, m.
        force: Nodal contact force on the body, ``(n, d)``, N.
    """
    return float(residuals(increment, displacement, force).max())


def residuals(inc: Increment, q: Array, r: Array) -> Array:
    """Return the relative residuals of each node: balance, normal, cone, alignment, ``(n, 4)``."""
    n, d = inc.free.shape
    k, contact = inc.node_stiffness, inc.contact
    balance = ((inc.stiffness @ q.ravel() - inc.load) * row_scale(inc)).reshape(n, d) - r
    slip = np.where(contact[:, 1:], q[:, 1:] - inc.previous, 0.0)
    x = np.column_stack([inc.mu * r[:, 0], r[:, 1:]])
    y = k[:, None] * np.column_stack([np.linalg.norm(slip, axis=1), slip])
    normal = np.where(contact[:, 0], np.minimum(r[:, 0], k * (inc.gap + q[:, 0])), 0.0)
    cone = np.maximum(np.linalg.norm(r[:, 1:], axis=1) - inc.mu * r[:, 0], 0.0)
    alignment = np.linalg.norm((x - project(x - y, 0.0)[0]) * contact[:, :1], axis=1)
    stray = np.linalg.norm(np.where(contact, 0.0, r), axis=1)  # force where there is no contact
    # Equilibrium and slip cannot be tested more closely than rounding, a few 1e-16 |A| |q|.
    sizes = np.abs(q) + np.abs(origin(inc))
    rounding = 1e-4 * (np.abs(inc.stiffness) @ sizes.ravel())
    scale = np.max(np.abs([r.ravel(), inc.load, rounding]) * inc.free.ravel()) or 1.0
    table = [np.linalg.norm(balance, axis=1), normal, cone, alignment + stray]
    return np.asarray(np.abs(np.column_stack(table)) / scale)
