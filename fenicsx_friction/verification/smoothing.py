# SPDX-License-Identifier: MIT
"""Smoothed equations of a condensed increment, and Newton's method for them (see ``soclcp``)."""

import numpy as np
import numpy.typing as npt

from .condensed import Increment, natural_residual
from .cone import plus, project

Array = npt.NDArray[np.floating]
Mask = npt.NDArray[np.bool_]


class SmoothedSystem:
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
        value, slope = project(x - y, eps)
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
        value, slope = plus(r[:, 0] - gap, eps)
        value, slope = value * self.contact[:, 0], slope * self.contact[:, 0]
        jacobian = (1 - slope)[:, None] * dr[:, 0]
        jacobian[self.nodes, self.nodes * self.d] += slope * self.weight
        return r[:, 0] - value, jacobian, slope > 0


def newton(system: SmoothedSystem, z: Array, eps: float, limit: int = 30) -> tuple[Array, int]:
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


def polish(system: SmoothedSystem, z: Array, limit: int = 12) -> tuple[Array, int]:
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
