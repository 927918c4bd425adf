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
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from .condensed import (
    ExactSolution,
    Increment,
    NoExactSolution,
    in_own_units,
    natural_residual,
    origin,
    residuals,
)
from .smoothing import SmoothedSystem, newton, polish

__all__ = ["ExactSolution", "Increment", "NoExactSolution", "natural_residual", "solve_increment"]

Array = npt.NDArray[np.floating]


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
        system = SmoothedSystem(replace(scaled, mu=factor * scaled.mu))
        z, count = newton(system, z, eps) if eps > 0 else polish(system, z)
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
    scaled, force_unit, length_unit = in_own_units(increment)
    system = SmoothedSystem(scaled)
    z0 = np.zeros(system.size)
    if start is not None:
        guess = (start - origin(increment)) / length_unit
        z0 = np.concatenate([guess.ravel(), np.linalg.norm(guess[:, 1:], axis=1)])
    iterations = 0
    best: Array = np.full((system.n, 4), np.inf)
    for z, path in _attempts(z0, start is not None):
        end, count = _follow(scaled, z, path)
        iterations += count
        nondimensional = system.solution(end)
        q: Array = nondimensional[0] * length_unit + origin(increment)
        r: Array = nondimensional[1] * force_unit
        table = residuals(increment, q, r)
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
