# SPDX-License-Identifier: MIT
"""Projection on the second-order cone, exact and smoothed."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]


def project(v: Array, eps: float) -> tuple[Array, Array]:
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
    (p_low, dp_low), (p_high, dp_high) = plus(v[:, 0] - norm, eps), plus(v[:, 0] + norm, eps)
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


def plus(t: Array, eps: float) -> tuple[Array, Array]:
    """Return the CHKS plus function and its derivative, without cancellation for ``t << -eps``."""
    if eps == 0.0:
        return np.maximum(t, 0.0), (t > 0).astype(np.float64)
    root = np.hypot(t, 2 * eps)
    tail = (root + np.abs(t)) / 2
    value = np.where(t > 0, tail, eps**2 / tail)
    return value, value / root
