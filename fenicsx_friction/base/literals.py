# SPDX-License-Identifier: MIT
"""Numbers in UFL become Constants, so that other numbers need no other compiled form.

A number that stands in an expression is part of the code that FFCx makes: another modulus or
coefficient of friction would compile everything again. Exponents stay, because derivatives of
powers depend on them.
"""

import ufl
from dolfinx import default_scalar_type, fem, mesh
from ufl.algorithms import expand_derivatives
from ufl.classes import Expr, FloatValue, Power, Variable

from .replacing import Replacing

Domain = mesh.Mesh | ufl.Mesh


class Lifter(Replacing):
    """Puts a Constant in place of each number of an expression without derivatives.

    No variable is left, either: their labels would be part of what tells compiled forms apart.

    Args:
        domain: What the Constants belong to.
    """

    def __init__(self, domain: Domain) -> None:
        super().__init__()
        self._domain = domain

    def replacement(self, o: Expr) -> Expr | None:
        """Return the Constant of a number, what a variable stands for, a power of a new base."""
        if isinstance(o, FloatValue):
            return as_constant(float(o), self._domain)
        if isinstance(o, Variable):
            return self(o.ufl_operands[0])
        if isinstance(o, Power):
            base, exponent = o.ufl_operands
            return self(base) ** (exponent if isinstance(exponent, FloatValue) else self(exponent))
        return None


def lifted_form(form: ufl.Form) -> ufl.Form:
    """Return a form with Constants in place of numbers, and derivatives expanded.

    The Constants of an integral belong to its own mesh.
    """
    parts = []
    for part in expand_derivatives(form).integrals():
        parts.append(part.reconstruct(integrand=Lifter(part.ufl_domain())(part.integrand())))
    return ufl.Form(parts)


def as_constant(value: float, domain: Domain) -> fem.Constant:
    """Return a number as a Constant of a mesh."""
    return fem.Constant(domain, default_scalar_type(value))
