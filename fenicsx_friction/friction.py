# SPDX-License-Identifier: MIT
"""Friction laws: the limit of the tangential traction as a function of the pressure."""

from dataclasses import dataclass
from typing import Protocol

import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from .errors import ContactInputError


class FrictionLaw(Protocol):
    """What the rows and the certificate need to know of a law.

    The tangential traction stays in the disk of radius ``limit``, and slip occurs on its
    boundary, opposite to the traction.
    """

    def limit(self, pressure: Expr) -> Expr:
        """Return the largest tangential traction (Pa) at ``pressure >= 0`` (Pa)."""
        ...


@dataclass(frozen=True)
class Coulomb:
    """Coulomb's law, ``limit = mu * pressure``, eq. (2).

    Attributes:
        mu: Friction coefficient: a number, ``fem.Constant``, ``fem.Function`` on the mesh or on
            the contact surface, or any scalar UFL expression of such. Values are checked to be
            ``>= 0`` (here where they are known, at the contact nodes in every step).
    """

    mu: float | Expr

    def __post_init__(self) -> None:
        """Check the coefficient as far as its value is known."""
        if isinstance(self.mu, fem.Constant):
            value = float(self.mu.value)
        elif isinstance(self.mu, Expr):
            if self.mu.ufl_shape != ():
                raise ContactInputError(f"mu must be scalar, its shape is {self.mu.ufl_shape}.")
            return
        else:
            value = float(self.mu)
        if not 0.0 <= value < float("inf"):
            raise ContactInputError(f"The friction coefficient mu = {value} must be >= 0, finite.")

    def limit(self, pressure: Expr) -> Expr:
        """Return ``mu * pressure``."""
        return ufl.as_ufl(self.mu) * pressure
