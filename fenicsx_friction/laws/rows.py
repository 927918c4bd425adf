# SPDX-License-Identifier: MIT
"""The equations of contact and friction at one contact node, from UFL to UFL.

Nothing here knows geometry, meshes or solvers. A row is a residual that vanishes when the
law holds. Arguments are nodal quantities:

* ``g`` gap (m), open when positive; ``c_n`` normal traction on the body (Pa), compression
  positive;
* ``s`` slip increment of the step (m) and ``c_t`` tangential traction on the body (Pa), vectors
  of ``gdim - 1`` components in the contact frame;
* ``r`` the scale ``r_p`` (Pa/m) that turns lengths into tractions.

Equation numbers are those of Areias, Queirós de Melo and Carrilho Lopes, "Combined sticking: a
new approach for finite-amplitude Coulomb frictional contact" (2019).
"""

import math

import ufl
from ufl.algebra import Abs
from ufl.core.expr import Expr


def norm(a: Expr) -> Expr:
    """Return ``|a|``, with the derivative zero where ``a`` is zero.

    UFL differentiates both branches of a conditional. Hence the root needs a positive argument
    in the branch that is not taken, too.
    """
    square = ufl.dot(a, a)
    nonzero = ufl.gt(square, 0.0)
    return ufl.conditional(nonzero, 1.0, 0.0) * ufl.sqrt(ufl.conditional(nonzero, square, 1.0))


def direction(a: Expr) -> Expr:
    """Return ``a / |a|``, zero where ``a`` is zero."""
    square = ufl.dot(a, a)
    return a / ufl.sqrt(ufl.conditional(ufl.gt(square, 0.0), square, 1.0))


def positive(x: Expr) -> Expr:
    """Return ``max(x, 0)``; at the kink the derivative is that of the zero branch."""
    return ufl.conditional(ufl.gt(x, 0.0), x, 0.0)


def ramp(x: Expr, eps: Expr) -> Expr:
    """Smoothed ramp ``<x>_eps``, eq. (13); exactly ``max(x, 0)`` at ``eps = 0``.

    Both branches of (13) in one expression whose exponential cannot overflow. ``<0>_eps = eps``.

    Args:
        x: Argument, unit of a traction.
        eps: Smoothing parameter of the same unit, ``>= 0``.
    """
    ln2 = math.log(2.0)
    safe = ufl.conditional(ufl.gt(eps, 0.0), eps, 1.0)
    return positive(x) + eps / ln2 * ufl.ln(1.0 + ufl.exp(-ln2 * Abs(x) / safe))


def normal_row(g: Expr, c_n: Expr, r: Expr, eps: Expr) -> Expr:
    """Normal complementarity ``<r g - c_n>_eps - r g = 0``, last row of (14)."""
    return ramp(r * g - c_n, eps) - r * g


def min_row(g: Expr, c_n: Expr, r: Expr, eps: Expr) -> Expr:
    """Normal complementarity ``min(r g, c_n) = 0``: the row above without smoothing."""
    return normal_row(g, c_n, r, 0.0 * eps)


def fischer_burmeister_row(g: Expr, c_n: Expr, r: Expr, eps: Expr) -> Expr:
    """Normal complementarity ``sqrt((r g)^2 + c_n^2 + 2 eps^2) - r g - c_n = 0``."""
    return norm(ufl.as_vector([r * g, c_n, math.sqrt(2.0) * eps])) - r * g - c_n


#: The normal complementarity functions by name.
NORMAL_ROWS = {
    "chen-mangasarian": normal_row,
    "fischer-burmeister": fischer_burmeister_row,
    "min": min_row,
}


def closed(g: Expr, c_n: Expr, r: Expr) -> Expr:
    """Switch H of eq. (10): 1 where the node is in contact.

    The paper's ``H(c_n)`` needs a tolerance tied to ``eps``; the argument ``c_n - r g`` has the
    same sign as ``c_n`` (closed) or ``-g`` (open) at every solution and needs none.
    """
    return ufl.conditional(ufl.ge(c_n - r * g, 0.0), 1.0, 0.0)


def stick_row(s: Expr, c_t: Expr, r: Expr, H: Expr) -> Expr:
    """Stick ``H r s = 0``, eqs. (10), (14).

    The part ``(1 - H) c_t = 0`` is added: without it the row of an open node is empty.
    """
    return H * r * s + (1.0 - H) * c_t


def blended_slip(s: Expr, c_stick: Expr, xi: Expr, scale: Expr, sign: float | Expr = -1.0) -> Expr:
    """Slip ``w`` blended with the direction of the stick force, eq. (12).

    Args:
        s: Slip increment (m).
        c_stick: Tangential traction of the stick predictor, frozen.
        xi: Blend, 1 at the start and 0 at the end of the corrector.
        scale: Length (m) that multiplies the unit vector, so that ``w`` has a unit.
        sign: ``+1`` as printed; ``-1`` makes ``xi = 1`` the radial return of the stick force.
    """
    return (1.0 - xi) * s + sign * xi * scale * direction(c_stick)


def slip_row(c_t: Expr, limit: Expr, w: Expr, scale: Expr) -> Expr:
    """Slip ``c_t |w| + limit w = 0``, eqs. (11), (15), (17), with ``limit = mu c_n``.

    Divided by the length ``scale`` of (12), it is a traction, of unit slope in ``c_t`` at
    ``xi = 1``. The row has false roots at ``w = 0``: a root must be checked against the cone.
    """
    return (c_t * norm(w) + limit * w) / scale


def projection(y: Expr, limit: Expr, eps: Expr) -> Expr:
    """Project ``y`` on the disk of radius ``limit``; the boundary counts as slip.

    With ``eps > 0`` (unit of ``y``) the kinks are rounded: ``y (1 - <|y| - limit>_eps / |y|)`` with
    ``|y|^2 = y . y + eps^2``.
    """
    square = ufl.dot(y, y)
    length = ufl.sqrt(ufl.conditional(ufl.gt(square, 0.0), square, 1.0))
    exact = ufl.conditional(ufl.lt(square, limit**2), 1.0, limit / length)
    rounded = ufl.sqrt(square + ufl.conditional(ufl.gt(eps, 0.0), eps**2, 1.0))
    smooth = 1.0 - ramp(rounded - limit, eps) / rounded
    return ufl.conditional(ufl.gt(eps, 0.0), smooth, exact) * y


def projection_row(s: Expr, c_t: Expr, limit: Expr, r: Expr, eps: Expr) -> Expr:
    """Natural map ``c_t - P(c_t - r s) = 0`` of Coulomb's law: stick, slip and open, no false root.

    Alart and Curnier (1992). ``limit`` is the friction limit at the pressure ``<c_n - r g>_eps``;
    at ``eps = 0`` the row is exact.
    """
    return c_t - projection(c_t - r * s, limit, eps)
