# SPDX-License-Identifier: MIT
"""Numbers in UFL become Constants, so that other numbers need no other compiled form.

A number that stands in an expression is part of the code that FFCx makes: another modulus or
coefficient of friction would compile everything again. Exponents stay, because derivatives of
powers depend on them.
"""

from typing import TypeVar

import ufl
from dolfinx import default_scalar_type, fem, mesh
from ufl.algorithms import expand_derivatives
from ufl.algorithms.map_integrands import map_integrands
from ufl.classes import Expr, FloatValue, Power, Variable

from .replacing import Replacing

T = TypeVar("T", ufl.Form, Expr)


class _Lifter(Replacing):
    """Puts a Constant in place of each number."""

    def __init__(self, msh: mesh.Mesh) -> None:
        super().__init__()
        self._mesh = msh

    def replacement(self, o: Expr) -> Expr | None:
        """Return the Constant of a number, what a variable stands for, a power of a new base."""
        if isinstance(o, FloatValue):
            return as_constant(float(o), self._mesh)
        if isinstance(o, Variable):
            return self(o.ufl_operands[0])
        if isinstance(o, Power):
            base, exponent = o.ufl_operands
            return self(base) ** (exponent if isinstance(exponent, FloatValue) else self(exponent))
        return None


def lifted(part: T, msh: mesh.Mesh) -> T:
    """Return a form or expression with Constants in place of numbers, and derivatives expanded.

    No variable is left, either: their labels would be part of what tells compiled forms apart.

    Args:
        part: The form or expression.
        msh: The mesh that the Constants belong to.
    """
    lifter, part = _Lifter(msh), expand_derivatives(part)
    return lifter(part) if isinstance(part, Expr) else map_integrands(lifter, part)


def as_constant(value: float, msh: mesh.Mesh) -> fem.Constant:
    """Return a number as a Constant of a mesh."""
    return fem.Constant(msh, default_scalar_type(value))
