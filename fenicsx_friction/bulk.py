# SPDX-License-Identifier: MIT
"""Bulk residuals in UFL: linear elasticity and neo-Hooke, with the B-bar quadrature.

These are conveniences; any UFL residual of the displacement serves as well. 2D means plane strain.
"""

from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from .errors import ContactInputError


@dataclass(frozen=True)
class Elastic:
    """Isotropic elastic constants.

    Attributes:
        E: Young's modulus (Pa), ``> 0``; a Function for bodies of several materials.
        nu: Poisson's ratio, ``-1 < nu < 0.5``.
    """

    E: float | fem.Function
    nu: float

    def __post_init__(self) -> None:
        """Check the constants."""
        low, high = _range(self.E)
        if not 0.0 < low <= high < float("inf"):
            found = low if low == high else f"{low} ... {high}"
            raise ContactInputError(f"Young's modulus E = {found} must be positive and finite.")
        if not -1.0 < self.nu < 0.5:
            raise ContactInputError(
                f"Poisson's ratio nu = {self.nu} must lie in (-1, 0.5); for incompressible bodies "
                "use a mixed formulation."
            )

    @property
    def shear_modulus(self) -> float | Expr:
        """Shear modulus G (Pa)."""
        return self.E / (2.0 * (1.0 + self.nu))

    @property
    def bulk_modulus(self) -> float | Expr:
        """Bulk modulus K (Pa)."""
        return self.E / (3.0 * (1.0 - 2.0 * self.nu))


def small_strain_energy(u: Expr, material: Elastic) -> tuple[Expr, Expr]:
    """Return the deviatoric and the volumetric energy density (Pa) of Hooke's law."""
    strain = ufl.sym(ufl.grad(u))
    trace = ufl.tr(strain)
    # The deviator is the three-dimensional one, in plane strain too.
    deviatoric = material.shear_modulus * (ufl.inner(strain, strain) - trace**2 / 3.0)
    return deviatoric, material.bulk_modulus / 2.0 * trace**2


def neo_hooke_energy(u: Expr, material: Elastic) -> tuple[Expr, Expr]:
    """Return the isochoric and the volumetric energy density (Pa, reference volume).

    ``G/2 (J^(-2/3) tr C - 3)`` and ``K/2 (log J)^2``; plane strain in 2D.
    """
    dim = u.ufl_shape[0]
    F = ufl.Identity(dim) + ufl.grad(u)
    J = ufl.det(F)
    trace_C = ufl.inner(F, F) + (3 - dim)
    isochoric = material.shear_modulus / 2.0 * (J ** (-2.0 / 3.0) * trace_C - 3.0)
    return isochoric, material.bulk_modulus / 2.0 * ufl.ln(J) ** 2


def stored_energy(
    density: tuple[Expr, Expr], dx: ufl.Measure, *, degree: int = 2, bbar: bool = False
) -> ufl.Form:
    """Integrate an energy; its derivative is the internal residual.

    Args:
        density: Deviatoric and volumetric density of one of the functions above.
        dx: Cell measure of the mesh.
        degree: Quadrature degree; 2 gives Q1 cells the usual two Gauss points a direction.
        bbar: Integrate the volumetric part with one point a cell, which is the mean-dilatation
            (B-bar) element of Simo, Taylor and Pister (1985) on parallelogram quadrilaterals and
            parallelepiped hexahedra, and its one-point form on distorted ones.
    """
    deviatoric, volumetric = density
    volumetric_dx = dx(degree=1) if bbar else dx(degree=degree)
    return deviatoric * dx(degree=degree) + volumetric * volumetric_dx


def _range(value: float | fem.Function) -> tuple[float, float]:
    """Return the least and the greatest value; NaN if any is; collective for Functions."""
    if not isinstance(value, fem.Function):
        return float(value), float(value)
    parts = value.function_space.mesh.comm.allgather(value.x.array)
    every = np.concatenate(parts)
    return float(np.min(every)), float(np.max(every))
