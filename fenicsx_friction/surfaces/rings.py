# SPDX-License-Identifier: MIT
"""Axisymmetric surfaces: curves in a half-plane, x the radius and y the axis, that stand for rings.

Forces and areas are those of the full ring, tractions those of a point.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import mesh

from ..base.errors import ContactInputError

Array = npt.NDArray[np.floating]
#: Radii may be negative by this fraction of the largest: rounding.
ROUNDING = 1e-12


def circumferences(x: Array) -> Array:
    """Return the lengths of the rings through points (..., 2) (m)."""
    return 2.0 * np.pi * x[..., 0]


def check_rings(msh: mesh.Mesh, name: str) -> None:
    """Raise unless a mesh may be the half-plane of an axisymmetric body; collective."""
    if msh.geometry.dim != 2:
        raise ContactInputError(
            f"Contact surface '{name}': axisymmetric=True needs a mesh in 2D, of the half-plane "
            f"r >= 0 with x the radius and y the axis; this one is in {msh.geometry.dim}D."
        )
    radius = msh.geometry.x[:, 0]
    ends = [np.min(radius, initial=np.inf), -np.max(abs(radius), initial=0.0)]
    least, largest = (msh.comm.allreduce(float(end), MPI.MIN) for end in ends)
    if least < ROUNDING * largest:
        raise ContactInputError(
            f"Contact surface '{name}': axisymmetric=True, but the mesh has nodes at the radius "
            f"x = {least:.6g}; it must be in the half-plane x >= 0, the axis at x = 0."
        )
