# SPDX-License-Identifier: MIT
"""Bulk residuals in UFL: linear elasticity and neo-Hooke, with the B-bar quadrature.

These are conveniences; any UFL residual of the displacement serves as well. 2D means plane strain.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, mesh
from ufl.core.expr import Expr
from ufl.domain import extract_domains

from ..base.errors import ContactInputError
from ..base.validators import flag, instance, integer, number, shown
from .quadrature import Element, deforms_freely, exact_degree, strained_elements


@dataclass(frozen=True)
class Elastic:
    """Isotropic elastic constants.

    Attributes:
        E: Young's modulus (Pa), ``> 0``; a Function for bodies of several materials.
        nu: Poisson's ratio, ``-1 < nu < 0.5``.
    """

    E: float | fem.Constant | fem.Function
    nu: float | fem.Constant

    def __post_init__(self) -> None:
        """Check the constants; collective if ``E`` is a Function."""
        for value in _extremes(self.E):
            number(value, "Young's modulus E", above=0.0)
        nu = number(_value(self.nu), "Poisson's ratio nu")
        if not -1.0 < nu < 0.5:
            raise ContactInputError(
                f"Poisson's ratio nu = {nu} must lie in (-1, 0.5); for incompressible bodies "
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


def small_strain_energy(
    u: Expr, material: Elastic, *, axisymmetric: bool = False
) -> tuple[Expr, Expr]:
    """Return the deviatoric and the volumetric energy density (Pa) of Hooke's law.

    Args:
        u: Displacement.
        material: The constants.
        axisymmetric: A mesh in 2D is the half-plane of a body of revolution, x the radius.
    """
    strain = ufl.sym(_strain_gradient(u, material, axisymmetric))
    trace = ufl.tr(strain)
    # The deviator is the three-dimensional one, in plane strain too.
    deviatoric = material.shear_modulus * (ufl.inner(strain, strain) - trace**2 / 3.0)
    return deviatoric, material.bulk_modulus / 2.0 * trace**2


def neo_hooke_energy(
    u: Expr, material: Elastic, *, axisymmetric: bool = False
) -> tuple[Expr, Expr]:
    """Return the isochoric and the volumetric energy density (Pa, reference volume).

    ``G/2 (J^(-2/3) tr C - 3)`` and ``K/2 (log J)^2``; plane strain in 2D.

    Args:
        u: Displacement.
        material: The constants.
        axisymmetric: A mesh in 2D is the half-plane of a body of revolution, x the radius.
    """
    gradient = _strain_gradient(u, material, axisymmetric)
    dim = gradient.ufl_shape[0]
    F = ufl.Identity(dim) + gradient
    J = ufl.det(F)
    trace_C = ufl.inner(F, F) + (3 - dim)
    isochoric = material.shear_modulus / 2.0 * (J ** (-2.0 / 3.0) * trace_C - 3.0)
    return isochoric, material.bulk_modulus / 2.0 * ufl.ln(J) ** 2


def stored_energy(
    density: tuple[Expr, Expr],
    dx: ufl.Measure,
    *,
    degree: int | None = None,
    bbar: bool = False,
    axisymmetric: bool = False,
) -> ufl.Form:
    """Integrate an energy; its derivative is the internal residual.

    Args:
        density: Deviatoric and volumetric density of one of the functions above.
        dx: Cell measure of the mesh.
        degree: Quadrature degree. By default the least that leaves no deformation without energy
            and integrates Hooke's law exactly on parallelograms: twice the degree of the gradient,
            and at least 2, which gives Q1 cells the usual two Gauss points a direction.
        bbar: Integrate the volumetric part with one point a cell, which is the mean-dilatation
            (B-bar) element of Simo, Taylor and Pister (1985) on parallelogram quadrilaterals and
            parallelepiped hexahedra, and its one-point form on distorted ones. Not for rings, where
            one point does not integrate a uniform stress: take a mixed formulation.
        axisymmetric: Integrate over full rings, see :func:`circumference`.

    Raises:
        ContactInputError: If the degree is too small: cells would deform without energy; or if
            ``bbar`` and ``axisymmetric`` are both set.
    """
    if not isinstance(density, list | tuple) or len(density) != 2:
        raise ContactInputError(
            f"density = {shown(density)} must be the two densities, deviatoric and volumetric, "
            "e.g. of bulk.small_strain_energy(u, material)."
        )
    instance(dx, ufl.Measure, "dx", "a measure of the cells such as ufl.dx")
    flag(bbar, "bbar")
    deviatoric, volumetric = (_scalar_density(part) for part in density)
    degree = _stiff_degree(strained_elements(deviatoric + volumetric), degree)
    if flag(axisymmetric, "axisymmetric"):
        if bbar:
            raise ContactInputError(
                "bbar=True with axisymmetric=True: one point a cell does not integrate the nodal "
                "forces of a uniform stress in rings. Take a mixed formulation."
            )
        around = 2.0 * np.pi * _radius(_domain(deviatoric))
        deviatoric, volumetric = around * deviatoric, around * volumetric
    volumetric_dx = dx(degree=1) if bbar else dx(degree=degree)
    return deviatoric * dx(degree=degree) + volumetric * volumetric_dx


def _stiff_degree(elements: list[Element], degree: int | None) -> int:
    """Return the degree of quadrature, by default the least; raise if it is too small."""
    if degree is None:
        return max([exact_degree(element) for element in elements], default=2)
    integer(degree, "degree", at_least=0)
    for element in elements:
        if deforms_freely(element, degree):
            raise ContactInputError(
                f"degree = {degree} is too small for {element}: its cells could deform without "
                f"energy (hourglass modes). Leave it out, or give {exact_degree(element)}."
            )
    return degree


def circumference(msh: mesh.Mesh) -> Expr:
    """Return the length ``2 pi r`` of the ring through each point of a half-plane (m), in UFL.

    Multiply the measures of the loads of an axisymmetric body by it.

    Args:
        msh: Mesh in 2D, x the radius and y the axis.
    """
    instance(msh, mesh.Mesh, "msh", "the mesh of a half-plane")
    return 2.0 * np.pi * _radius(msh)


def _radius(domain: Any) -> Expr:
    """Return the radius (m) of points of a half-plane."""
    return ufl.SpatialCoordinate(domain)[0]


def _domain(expression: Expr) -> Any:
    """Return the mesh of an expression."""
    (domain,) = extract_domains(expression)
    return domain


def _scalar_density(value: object) -> Expr:
    """Return a density, or raise unless it is a UFL scalar."""
    if not isinstance(value, Expr) or value.ufl_shape != ():
        raise ContactInputError(f"An energy density must be a UFL scalar, not {shown(value)}.")
    return value


def _strain_gradient(u: object, material: object, axisymmetric: bool) -> Expr:
    """Return the gradient of a displacement, or raise unless it is one of an elastic body."""
    instance(material, Elastic, "material", "bulk.Elastic(E, nu)")
    displacement = instance(u, Expr, "u", "the displacement, a UFL vector")
    gradient = ufl.grad(displacement) if displacement.ufl_shape else None
    if gradient is None or gradient.ufl_shape not in ((2, 2), (3, 3)):
        raise ContactInputError(
            f"u has shape {displacement.ufl_shape}; a displacement has as many components as its "
            "mesh has dimensions, 2 or 3."
        )
    if not flag(axisymmetric, "axisymmetric"):
        return gradient
    if gradient.ufl_shape != (2, 2):
        raise ContactInputError("axisymmetric=True needs a displacement (u_r, u_z) in 2D.")
    hoop = displacement[0] / _radius(_domain(displacement))
    (a, b), (c, d) = ([gradient[i, j] for j in range(2)] for i in range(2))
    return ufl.as_matrix([[a, b, 0.0], [c, d, 0.0], [0.0, 0.0, hoop]])


def _value(value: object) -> object:
    """Return the value of a Constant; anything else unchanged."""
    return value.value[()] if isinstance(value, fem.Constant) else value


def _extremes(value: object) -> tuple[object, object]:
    """Return the least and the greatest value; NaN if any is; collective for Functions."""
    if not isinstance(value, fem.Function):
        return _value(value), _value(value)
    if value.ufl_shape != ():
        raise ContactInputError(
            f"Young's modulus E must be scalar, its Function has shape {value.ufl_shape}."
        )
    own = value.x.array
    ends = (np.min(own, initial=np.inf), np.max(own, initial=-np.inf))
    lowest, highest = zip(*value.function_space.mesh.comm.allgather(ends), strict=True)
    return np.min(lowest), np.max(highest)
