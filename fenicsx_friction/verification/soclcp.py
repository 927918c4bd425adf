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
    return float(_residuals(increment, displacement, force).max())


def _residuals(inc: Increment, q: Array, r: Array) -> Array:
    """Return the relative residuals of each node: balance, normal, cone, alignment, ``(n, 4)``."""
    n, d = inc.free.shape
    k, contact = inc.node_stiffness, inc.contact
    balance = ((inc.stiffness @ q.ravel() - inc.load) * _row_scale(inc)).reshape(n, d) - r
    slip = np.where(contact[:, 1:], q[:, 1:] - inc.previous, 0.0)
    x = np.column_stack([inc.mu * r[:, 0], r[:, 1:]])
    y = k[:, None] * np.column_stack([np.linalg.norm(slip, axis=1), slip])
    normal = np.where(contact[:, 0], np.minimum(r[:, 0], k * (inc.gap + q[:, 0])), 0.0)
    cone = np.maximum(np.linalg.norm(r[:, 1:], axis=1) - inc.mu * r[:, 0], 0.0)
    alignment = np.linalg.norm((x - _project(x - y, 0.0)[0]) * contact[:, :1], axis=1)
    stray = np.linalg.norm(np.where(contact, 0.0, r), axis=1)  # force where there is no contact
    # Equilibrium and slip cannot be tested more closely than rounding, a few 1e-16 |A| |q|.
    sizes = np.abs(q) + np.abs(_origin(inc))
    rounding = 1e-4 * (np.abs(inc.stiffness) @ sizes.ravel())
    scale = np.max(np.abs([r.ravel(), inc.load, rounding]) * inc.free.ravel()) or 1.0
    table = [np.linalg.norm(balance, axis=1), normal, cone, alignment + stray]
    return np.asarray(np.abs(np.column_stack(table)) / scale)


def _row_scale(inc: Increment) -> Array:
    """Return 1, and at prescribed rows, whose unit is arbitrary, what makes the diagonal ``k``."""
    diagonal, free = np.diag(inc.stiffness), inc.free.ravel()
    k = np.repeat(inc.node_stiffness, inc.free.shape[1])
    return np.where(free | (diagonal <= 0), 1.0, k / np.where(diagonal > 0, diagonal, 1.0))


def _project(v: Array, eps: float) -> tuple[Array, Array]:
    """Project each row of ``v`` on the second-order cone, smoothed, and differentiate.

    CHKS function ``p(t) = (t + sqrt(t^2 + 4 eps^2))/2`` of the spectral values ``v0 -/+ |v_t|``
    (Fukushima, Luo and Tseng, SIAM J. Optim. 12:436-460, 2001). ``eps = 0`` is exact.

    Args:
        v: ``(n, m)``, scalar part first; the half-line for ``m = 1``.
        eps: Smoothing parameter, in the unit of ``v``.

    Returns:
        Projection ``(n, m)`` and its derivative ``(n, m, m)``.
    """
    norm = np.linalg.norm(v[:, 1:], axis=1)
    unit = v[:, 1:] / np.where(norm > 0, norm, 1.0)[:, None]
    (p_low, dp_low), (p_high, dp_high) = _plus(v[:, 0] - norm, eps), _plus(v[:, 0] + norm, eps)
    value = np.column_stack([(p_high + p_low) / 2, ((p_high - p_low) / 2)[:, None] * unit])
    mean, half = (dp_high + dp_low) / 2, (dp_high - dp_low) / 2
    # The divided difference of p tends to p' where the spectral values coincide.
    equal = norm <= 1e-14 * (np.abs(v[:, 0]) + eps)
    secant = np.where(equal, mean, (p_high - p_low) / np.where(equal, 1.0, 2 * norm))
    slope = np.empty((*v.shape, v.shape[1]))
    slope[:, 0, 0] = mean
    slope[:, 0, 1:] = slope[:, 1:, 0] = half[:, None] * unit
    slope[:, 1:, 1:] = secant[:, None, None] * np.eye(v.shape[1] - 1)
    slope[:, 1:, 1:] += (mean - secant)[:, None, None] * unit[:, :, None] * unit[:, None, :]
    return value, slope


def _plus(t: Array, eps: float) -> tuple[Array, Array]:
    """Return the CHKS plus function and its derivative, without cancellation for ``t << -eps``."""
    if eps == 0.0:
        return np.maximum(t, 0.0), (t > 0).astype(np.float64)
    root = np.hypot(t, 2 * eps)
    tail = (root + np.abs(t)) / 2
    value = np.where(t > 0, tail, eps**2 / tail)
    return value, value / root


def _nondimensional(inc: Increment) -> tuple[Increment, float, float]:
    """Return the increment from the last accepted step in its own units, and these units (N, m).

    Counting displacements from ``previous`` keeps a long slide from setting their scale.
    """
    load = inc.load - inc.stiffness @ _origin(inc).ravel()
    k = float(np.median(inc.node_stiffness))
    force = float(max(np.abs(load * inc.free.ravel()).max(), -k * inc.gap.min())) or k
    row = _row_scale(inc)
    scaled = replace(
        inc,
        stiffness=inc.stiffness * row[:, None] / k,
        load=load * row / force,
        gap=inc.gap * k / force,
        previous=np.zeros_like(inc.previous),
    )
    return scaled, force, force / k


def _origin(inc: Increment) -> Array:
    """Return the displacement, ``(n, d)``, from which the nondimensional one is counted."""
    return np.column_stack([np.zeros(len(inc.mu)), inc.previous])


class _System:
    """Smoothed equations of a nondimensional increment in the unknowns ``z = (q, lam)``."""

    def __init__(self, inc: Increment) -> None:
        """Prepare the constant parts of the Jacobian."""
        self.inc, self.contact, self.weight = inc, inc.contact, inc.node_stiffness
        (self.n, self.d), self.nodes = inc.free.shape, np.arange(len(inc.mu))
        self.size = self.n * (self.d + 1)
        self.dy = np.zeros((self.n, self.d, self.size))  # of y = weight (lam, s)
        self.dy[self.nodes, 0, self.n * self.d + self.nodes] = self.weight
        for k in range(1, self.d):
            self.dy[self.nodes, k, self.nodes * self.d + k] = self.weight * self.contact[:, k]

    def split(self, z: Array, eps: float = 0.0) -> tuple[Array, Array, Array]:
        """Return ``q``, ``r``, ``lam``; the Tikhonov term ``eps q`` holds a floating body."""
        q, lam = z[: self.n * self.d], z[self.n * self.d :]
        r = self.inc.stiffness @ q - self.inc.load + eps * q
        return q.reshape(self.n, self.d), r.reshape(self.n, self.d), lam

    def solution(self, z: Array) -> tuple[Array, Array]:
        """Return ``q`` and ``r``, with exact zeros in ``r`` at open nodes and outside contact."""
        q, r, _ = self.split(z)
        closed = r[:, 0] > self.weight * (self.inc.gap + q[:, 0])
        return q, np.where(self.contact & closed[:, None], r, 0.0)

    def linearise(self, z: Array, eps: float) -> tuple[Array, Array]:
        """Return the residual and its Jacobian; ``eps = 0`` gives the exact, nonsmooth equations.

        At an open node smoothing determines ``lam`` only to order ``eps^2``. Hence the regularised
        cone ``mu r_n + eps lam``, and at ``eps = 0`` the rows ``lam = 0, r_t = 0``.
        """
        q, r, lam = self.split(z, eps)
        dr = np.zeros((self.n, self.d, self.size))
        stiffness = self.inc.stiffness + eps * np.eye(self.n * self.d)
        dr[:, :, : self.n * self.d] = stiffness.reshape(self.n, self.d, -1)
        f_normal, j_normal, closed = self._normal(q, r, dr, eps)

        x = np.column_stack([self.inc.mu * r[:, 0] + eps * lam, r[:, 1:] * self.contact[:, 1:]])
        y = self.weight[:, None] * np.column_stack([lam, q[:, 1:] * self.contact[:, 1:]])
        value, slope = _project(x - y, eps)
        dx = dr.copy()
        dx[:, 0] = self.inc.mu[:, None] * dr[:, 0] + eps * self.dy[:, 0] / self.weight[:, None]
        # Rows outside the law: lam = 0 without friction, r_t = 0 there and where prescribed.
        friction = (self.inc.mu > 0) & self.contact[:, 1:].any(axis=1) & closed
        off = ~(self.contact & friction[:, None])
        f = np.where(off, np.column_stack([self.weight * lam, r[:, 1:]]), x - value)
        slope[off] = 0.0
        slope[off[:, 0], 0, 0] = 1.0  # turns the row dx0 - slope (dx - dy) into dlam
        j = dx - np.einsum("nij,njm->nim", slope, dx - self.dy)
        j_all = np.concatenate([j_normal[:, None], j], axis=1).reshape(self.size, -1)
        return np.column_stack([f_normal, f]).ravel(), j_all

    def _normal(self, q: Array, r: Array, dr: Array, eps: float) -> tuple[Array, Array, Mask]:
        """Return residual and Jacobian of ``0 <= r_n _|_ g >= 0`` and the nodes in contact."""
        gap = self.weight * (self.inc.gap + q[:, 0])
        value, slope = _plus(r[:, 0] - gap, eps)
        value, slope = value * self.contact[:, 0], slope * self.contact[:, 0]
        jacobian = (1 - slope)[:, None] * dr[:, 0]
        jacobian[self.nodes, self.nodes * self.d] += slope * self.weight
        return r[:, 0] - value, jacobian, slope > 0


def _newton(system: _System, z: Array, eps: float, limit: int = 30) -> tuple[Array, int]:
    """Damped Newton at fixed ``eps``; returns the last iterate and the number of factorisations."""
    f, jacobian = system.linearise(z, eps)
    for iteration in range(limit):
        merit = np.linalg.norm(f)
        if merit <= 0.1 * eps:  # Hayashi et al.: each smoothed problem only to the order of eps
            return z, iteration
        step, length = _solve(jacobian, -f), 1.0
        while True:
            f, jacobian = system.linearise(z + length * step, eps)
            if np.linalg.norm(f) <= (1 - 1e-4 * length) * merit or length < 0.01:
                break  # the shortest step is taken even if uphill, to leave a bad point
            length /= 2
        z = z + length * step
    return z, limit


def _solve(matrix: Array, rhs: Array) -> Array:
    """Solve, by least squares where a rigid motion or a grazing contact is undetermined."""
    try:
        x = np.linalg.solve(matrix, rhs)
        if np.linalg.norm(matrix @ x - rhs) <= 1e-6 * np.linalg.norm(rhs):
            return np.asarray(x)
    except np.linalg.LinAlgError:
        pass
    return np.asarray(np.linalg.lstsq(matrix, rhs, rcond=1e-13)[0])


def _polish(system: _System, z: Array, limit: int = 12) -> tuple[Array, int]:
    """Full Newton steps at ``eps = 0``, until rounding; spectral values pick open, slip or stick.

    Returns:
        Best iterate and the number of factorisations.
    """
    best, lowest = z, np.inf
    for iteration in range(limit):
        residual = natural_residual(system.inc, *system.solution(z))
        if lowest < 1e-9 and residual > 0.5 * lowest:
            return best, iteration
        if residual < lowest:
            best, lowest = z, residual
        f, jacobian = system.linearise(z, 0.0)
        z = z + _solve(jacobian, -f)
    return best, limit


def _attempts(z: Array, warm: bool) -> Iterator[tuple[Array, list[tuple[float, float]]]]:
    """Yield starting points with paths of (factor on mu, eps), the cheapest first.

    The first path is right for nearly all increments. High friction can fold it: then friction is
    raised in steps, each solved exactly, and in the end points are tried at random.
    """
    yield z, [(1.0, 10.0**-k) for k in range(4 if warm else 0, 9)] + [(1.0, 0.0)]
    for steps in (10, 40):
        factors = np.arange(steps + 1) / steps
        yield 0 * z, [(float(m), eps) for m in factors for eps in (1e-2, 1e-4, 1e-6, 0.0)]
    rng = np.random.default_rng(0)
    for spread in 4 * (1.0, 3.0, 10.0):
        yield spread * rng.normal(size=z.size), [(1.0, eps) for eps in (1e-3, 1e-6, 0.0)]


def _follow(scaled: Increment, z: Array, path: list[tuple[float, float]]) -> tuple[Array, int]:
    """Follow a path from ``z``; returns its end and the number of factorisations."""
    total = 0
    for factor, eps in path:
        system = _System(replace(scaled, mu=factor * scaled.mu))
        z, count = _newton(system, z, eps) if eps > 0 else _polish(system, z)
        total += count
    return z, total


def solve_increment(
    increment: Increment, *, tolerance: float = 1e-10, start: Array | None = None
) -> ExactSolution:
    """Solve one Signorini-Coulomb increment exactly.

    Args:
        increment: The condensed problem.
        tolerance: Bound on `natural_residual`.
        start: Displacement ``(n, d)`` to start from, to select a solution where there are several.

    Returns:
        A solution that passes the certificate, never another.

    Raises:
        NoExactSolution: If no attempt ends in a certified solution.
    """
    scaled, force_unit, length_unit = _nondimensional(increment)
    system = _System(scaled)
    z0 = np.zeros(system.size)
    if start is not None:
        guess = (start - _origin(increment)) / length_unit
        z0 = np.concatenate([guess.ravel(), np.linalg.norm(guess[:, 1:], axis=1)])
    iterations = 0
    best: Array = np.full((system.n, 4), np.inf)
    for z, path in _attempts(z0, start is not None):
        end, count = _follow(scaled, z, path)
        iterations += count
        nondimensional = system.solution(end)
        q: Array = nondimensional[0] * length_unit + _origin(increment)
        r: Array = nondimensional[1] * force_unit
        table = _residuals(increment, q, r)
        if table.max() <= tolerance:
            gap, slip = increment.gap + q[:, 0], q[:, 1:] - increment.previous
            return ExactSolution(q, r, gap, slip, float(table.max()), iterations)
        best = table if table.max() < best.max() else best
    raise NoExactSolution(_explain(increment, best, tolerance))


def _explain(inc: Increment, table: Array, tolerance: float) -> str:
    """Say how close the best attempt came, where it failed and what to try."""
    worst = np.argsort(-table.max(axis=1))[:5]
    balance, normal, cone, alignment = table.max(axis=0)
    return (
        f"no certified solution: relative residual {table.max():.2e} > {tolerance:.1e} "
        f"(equilibrium {balance:.1e}, normal {normal:.1e}, cone {cone:.1e}, alignment "
        f"{alignment:.1e}), worst at nodes {worst.tolist()} with mu = {inc.mu[worst].tolist()}. "
        "Check that contact can hold a floating body under this load; with high friction take "
        "smaller load steps or pass start."
    )
