# SPDX-License-Identifier: MIT
"""Exact reference for one condensed Signorini-Coulomb increment: a second-order-cone LCP.

Formulation of Kanno, Martins and Pinto da Costa (IJNME 65:62-83, 2006). With ``lam`` an extra
unknown per node, equal to the norm of the slip ``s`` in the solution, the increment is *linear*
apart from the cones ``K = {(x0, x_t): |x_t| <= x0}``::

    stiffness q = load + r,    0 <= r_n  _|_  g >= 0,    K ni (mu r_n, r_t)  _|_  (lam, s) in K

It is solved by the smoothing and regularisation Newton method of Hayashi, Yamashita and Fukushima
(SIAM J. Optim. 15:593-615, 2005). Dense, pure NumPy, shares nothing with the package's own solver.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

__all__ = ["ExactSolution", "Increment", "NoExactSolution", "natural_residual", "solve_increment"]

Array = npt.NDArray[np.float64]

# Smoothing parameters relative to the force scale. A single fast decade sequence is right for most
# increments; the slow one follows the smoothed path where high friction folds it.
_FAST = tuple(10.0 ** -np.arange(0.0, 9.0))
_SLOW = tuple(10.0 ** -np.arange(-1.0, 9.0, 1 / 3))


class NoExactSolution(RuntimeError):
    """No certified solution was found: for large friction there may be none, or several."""


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
    free: npt.NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Check the shapes and ranges, which NumPy broadcasting would hide."""
        n, d = self.free.shape
        shapes = {"stiffness": (n * d, n * d), "load": (n * d,), "gap": (n,), "mu": (n,)}
        for name, shape in (shapes | {"previous": (n, d - 1)}).items():
            value = getattr(self, name)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"{name} must be finite with shape {shape}, is {value.shape}")
        if n == 0 or d not in (2, 3):
            raise ValueError(f"free must be (n, 2) or (n, 3) with n > 0, is {self.free.shape}")
        if (self.mu < 0).any():
            raise ValueError(f"mu must not be negative, min is {self.mu.min()}")

    @property
    def contact(self) -> npt.NDArray[np.bool_]:
        """Components that can carry a contact force, ``(n, d)``."""
        return self.free & self.free[:, :1]

    @property
    def node_stiffness(self) -> Array:
        """Mean diagonal stiffness of the contact components of each node, ``(n,)``, N/m."""
        diagonal = np.diag(self.stiffness).reshape(self.free.shape)
        count = self.contact.sum(axis=1)
        mean = (diagonal * self.contact).sum(axis=1) / np.maximum(count, 1)
        fallback = mean[mean > 0].mean() if (mean > 0).any() else max(diagonal.max(), 1.0)
        return np.where(mean > 0, mean, fallback)


@dataclass(frozen=True)
class ExactSolution:
    """Certified solution; ``force`` acts on the body, compression and gap are positive."""

    displacement: Array
    force: Array
    gap: Array
    slip: Array
    residual: float
    iterations: int


def _project(v: Array, eps: float) -> tuple[Array, Array]:
    """Project each row of ``v`` on the second-order cone, smoothed, and differentiate.

    CHKS function ``p(t) = (t + sqrt(t^2 + 4 eps^2))/2`` of the spectral values ``v0 -/+ |v_t|``
    (Fukushima, Luo and Tseng, SIAM J. Optim. 12:436-460, 2001, Section 5). ``eps = 0`` is exact.

    Args:
        v: ``(n, m)``, scalar part first. ``m = 1`` is the half-line.
        eps: Smoothing parameter, in the unit of ``v``.

    Returns:
        Projection ``(n, m)`` and its derivative ``(n, m, m)``.
    """
    norm = np.linalg.norm(v[:, 1:], axis=1)
    unit = v[:, 1:] / np.where(norm > 0, norm, 1.0)[:, None]
    low, high = v[:, 0] - norm, v[:, 0] + norm
    (p_low, dp_low), (p_high, dp_high) = _plus(low, eps), _plus(high, eps)
    mean, half = (dp_high + dp_low) / 2, (dp_high - dp_low) / 2
    # The divided difference of p between the spectral values tends to p' where they coincide.
    tiny = norm <= 1e-14 * (np.abs(v[:, 0]) + eps)
    secant = np.where(tiny, mean, (p_high - p_low) / np.where(tiny, 1.0, 2 * norm))
    outer = unit[:, :, None] * unit[:, None, :]
    value = np.column_stack([(p_high + p_low) / 2, ((p_high - p_low) / 2)[:, None] * unit])
    slope = np.empty((*v.shape, v.shape[1]))
    slope[:, 0, 0] = mean
    slope[:, 0, 1:] = slope[:, 1:, 0] = half[:, None] * unit
    slope[:, 1:, 1:] = secant[:, None, None] * np.eye(v.shape[1] - 1)
    slope[:, 1:, 1:] += (mean - secant)[:, None, None] * outer
    return value, slope


def _plus(t: Array, eps: float) -> tuple[Array, Array]:
    """Return the CHKS plus function and its derivative, without cancellation for ``t << -eps``."""
    if eps == 0.0:
        return np.maximum(t, 0.0), (t > 0).astype(float)
    root = np.hypot(t, 2 * eps)
    tail = (root + np.abs(t)) / 2
    value = np.where(t > 0, tail, eps**2 / tail)
    return value, value / root


def _residuals(inc: Increment, q: Array, r: Array) -> Array:
    """Return the relative natural residuals of each node, ``(n, 4)``, see `natural_residual`."""
    n, d = inc.free.shape
    k, contact = inc.node_stiffness, inc.contact
    internal = (inc.stiffness @ q.ravel()).reshape(n, d)
    balance = internal - inc.load.reshape(n, d) - r
    # A prescribed row may have any scale (1 in place of N/m); bring it to that of the node.
    diagonal = np.maximum(np.diag(inc.stiffness).reshape(n, d), np.finfo(float).tiny)
    balance = np.where(inc.free, balance, balance * np.minimum(k[:, None] / diagonal, 1e300))
    slip = np.where(contact[:, 1:], q[:, 1:] - inc.previous, 0.0)
    kg = k * (inc.gap + q[:, 0])
    x = np.column_stack([inc.mu * r[:, 0], r[:, 1:]])
    y = k[:, None] * np.column_stack([np.linalg.norm(slip, axis=1), slip])
    normal = np.where(contact[:, 0], np.minimum(r[:, 0], kg), 0.0)
    cone = np.maximum(np.linalg.norm(x[:, 1:], axis=1) - x[:, 0], 0.0)
    alignment = np.linalg.norm(x - _project(x - y, 0.0)[0], axis=1)
    stray = np.linalg.norm(np.where(contact, 0.0, r), axis=1)
    # Third: A q cannot be evaluated more closely than its rounding, 1e-16 |A| |q|.
    rounding = 1e-5 * (np.abs(inc.stiffness) @ np.abs(q.ravel()))
    forces = np.abs([r.ravel(), inc.load, rounding])
    scale = np.max(forces * inc.free.ravel()) or 1.0
    table = [np.linalg.norm(balance, axis=1), normal, cone, alignment * contact[:, 0] + stray]
    return np.abs(np.column_stack(table)) / scale


def natural_residual(increment: Increment, displacement: Array, force: Array) -> float:
    """Certify ``(q, r)`` against the unsmoothed increment.

    The largest over the nodes of: equilibrium; ``min(r_n, k g)``; cone violation
    ``|r_t| - mu r_n``; and the natural map ``x - P_K(x - k y)`` of ``x = (mu r_n, r_t)``,
    ``y = (|s|, s)``, which holds complementarity and alignment. Displacements are turned into
    forces by the diagonal stiffness ``k`` of the node, and all is relative to the largest nodal
    force. Zero if and only if ``(q, r)`` solves the increment; first order in any error.

    Args:
        increment: The problem.
        displacement: ``(n, d)``, m.
        force: Nodal contact force on the body, ``(n, d)``, N.
    """
    return float(_residuals(increment, displacement, force).max())


def _nondimensional(inc: Increment) -> tuple[Increment, float, float]:
    """Return the increment in units of its own force and stiffness, from the last accepted step.

    Starting from ``previous`` keeps a long slide from setting the scale of displacements.

    Returns:
        Scaled increment with ``previous = 0``, force unit, length unit.
    """
    shift = np.column_stack([np.zeros(len(inc.mu)), inc.previous]).ravel()
    load = inc.load - inc.stiffness @ shift
    k = float(np.median(inc.node_stiffness))
    free = inc.free.ravel()
    force = max(np.abs(load * free).max(), k * max(-inc.gap.min(), 0.0)) or k
    # Prescribed rows may have any scale (1 in place of N/m): divide them by their own diagonal.
    diagonal = np.diag(inc.stiffness)
    row = np.where(free | (diagonal <= 0), k, diagonal)
    scaled = Increment(
        stiffness=inc.stiffness / row[:, None],
        load=load * k / row / force,
        gap=inc.gap * k / force,
        previous=np.zeros_like(inc.previous),
        mu=inc.mu,
        free=inc.free,
    )
    return scaled, force, force / k


class _System:
    """Smoothed equations of a nondimensional increment in the unknowns ``z = (q, lam)``."""

    def __init__(self, inc: Increment) -> None:
        """Prepare the constant parts of the Jacobian."""
        self.inc, self.contact, self.weight = inc, inc.contact, inc.node_stiffness
        self.n, self.d = inc.free.shape
        # Without friction or a free tangent, lam is undetermined: the node keeps the rows lam = 0,
        # r_t = 0.
        self.friction = (inc.mu > 0) & self.contact[:, 1:].any(axis=1)
        self.size = self.n * (self.d + 1)
        nodes = np.arange(self.n)
        self.pick = np.zeros((self.n, self.d, self.size))  # derivative of y = weight (lam, s)
        self.pick[nodes, 0, self.n * self.d + nodes] = self.weight
        for k in range(1, self.d):
            self.pick[nodes, k, nodes * self.d + k] = self.weight * self.contact[:, k]

    def split(self, z: Array, eps: float = 0.0) -> tuple[Array, Array, Array]:
        """Return ``q``, ``r`` and ``lam``; ``eps`` is the Tikhonov term, for floating bodies."""
        q, lam = z[: self.n * self.d], z[self.n * self.d :]
        r = self.inc.stiffness @ q - self.inc.load + eps * q
        return q.reshape(self.n, self.d), r.reshape(self.n, self.d), lam

    def linearise(self, z: Array, eps: float) -> tuple[Array, Array]:
        """Return the residual and its Jacobian; ``eps = 0`` gives the exact, nonsmooth equations.

        ``lam`` of an open node is undetermined. Smoothing fixes it only to order ``eps^2``, hence
        the regularisation ``mu r_n + eps lam`` of the cone, and at ``eps = 0`` the rows ``lam = 0``.
        """
        n, d = self.n, self.d
        q, r, lam = self.split(z, eps)
        a = np.zeros((n, d, self.size))
        a[:, :, : n * d] = (self.inc.stiffness + eps * np.eye(n * d)).reshape(n, d, -1)
        normal, slope = _project(r[:, :1] - (self.weight * (self.inc.gap + q[:, 0]))[:, None], eps)
        slope = np.where(self.contact[:, 0], slope[:, 0, 0], 0.0)
        f_normal = r[:, 0] - np.where(self.contact[:, 0], normal[:, 0], 0.0)
        j_normal = (1 - slope)[:, None] * a[:, 0]
        j_normal[np.arange(n), np.arange(n) * d] += slope * self.weight

        x = np.column_stack([self.inc.mu * r[:, 0] + eps * lam, r[:, 1:] * self.contact[:, 1:]])
        y = self.weight[:, None] * np.column_stack([lam, q[:, 1:] * self.contact[:, 1:]])
        a[:, 0] = self.inc.mu[:, None] * a[:, 0] + eps * self.pick[:, 0] / self.weight[:, None]
        value, dp = _project(x - y, eps)
        f = x - value
        # Rows outside the law: r_t = 0 where prescribed, lam = 0 and r_t = 0 without friction.
        lawful = self.friction if eps > 0 else self.friction & (slope > 0)
        off = ~(self.contact & lawful[:, None])
        off[:, 0] = ~lawful
        f[off] = np.column_stack([self.weight * lam, r[:, 1:]])[off]
        dp = np.where(off[:, :, None], 0.0, dp)
        dp[off[:, 0], 0, 0] = 1.0
        j = np.einsum("nij,njm->nim", np.eye(d) - dp, a) + np.einsum("nij,njm->nim", dp, self.pick)
        residual = np.column_stack([f_normal[:, None], f]).ravel()
        return residual, np.concatenate([j_normal[:, None], j], axis=1).reshape(self.size, -1)


def _newton(system: _System, z: Array, eps: float, limit: int) -> tuple[Array, int]:
    """Damped Newton at fixed ``eps``; returns the last iterate and the number of factorisations."""
    f, jacobian = system.linearise(z, eps)
    for iteration in range(limit):
        merit = np.linalg.norm(f)
        # Hayashi et al.: solve each smoothed problem to the order of eps only.
        if merit <= 0.1 * eps:
            return z, iteration
        step = _solve(jacobian, -f)
        for halving in range(8):
            trial = z + 0.5**halving * step
            f, jacobian = system.linearise(trial, eps)
            if np.linalg.norm(f) <= (1 - 1e-4 * 0.5**halving) * merit:
                break
        z = trial
    return z, limit


def _solve(matrix: Array, rhs: Array) -> Array:
    """Solve, in the least-squares sense where rigid motion or grazing contact is undetermined."""
    try:
        x = np.linalg.solve(matrix, rhs)
        if np.linalg.norm(matrix @ x - rhs) <= 1e-6 * np.linalg.norm(rhs):
            return np.asarray(x)
    except np.linalg.LinAlgError:
        pass
    return np.asarray(np.linalg.lstsq(matrix, rhs, rcond=1e-13)[0])


def _polish(system: _System, z: Array, tolerance: float, limit: int = 12) -> tuple[Array, int]:
    """Full Newton steps at ``eps = 0``, where the spectral values pick open, slip or stick."""
    for iteration in range(limit):
        q, r, _ = system.split(z)
        if natural_residual(system.inc, q, r * system.contact) <= tolerance:
            return z, iteration
        f, jacobian = system.linearise(z, 0.0)
        z = z + _solve(jacobian, -f)
    return z, limit
