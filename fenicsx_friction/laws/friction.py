# SPDX-License-Identifier: MIT
"""Friction laws in UFL. A new law is a class with a ``limit``."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import ufl
from dolfinx import fem, mesh
from ufl.algorithms.analysis import extract_type
from ufl.constantvalue import ComplexValue
from ufl.core.expr import Expr

from ..base.errors import ContactInputError
from ..base.literals import as_constant
from ..base.validators import call, kind, number, shown, vector
from . import rows

#: The limit of permanent stick (Pa): beyond any traction, and a number that UFL can multiply.
UNLIMITED = 1e300
#: Smallest ratio of orthotropic coefficients: a metric has both in one number.
RATIO = 1e-12


class Sliding(NamedTuple):
    """What a law may depend on beside the pressure, in UFL.

    Attributes:
        slip: Slip increment of the step (m) in the contact frame.
        path: Length slid in contact (m), this step included.
        rate: Slip rate ``|slip| / dt`` (m/s).
        tangents: Unit tangents of the frame, global vectors.
        x: Current position (m).
    """

    slip: Expr
    path: Expr
    rate: Expr
    tangents: tuple[Expr, ...]
    x: Expr


class FrictionLaw(ABC):
    """Base class: the traction stays in the disk of radius ``limit``; on its rim, slip opposes it.

    A law overrides :meth:`limit`; an anisotropic one :meth:`metric`, too. Their steps are
    certified. A law of another kind overrides :meth:`row`; its steps are solved, not certified.
    """

    @abstractmethod
    def limit(self, pressure: Expr, sliding: Sliding) -> Expr:
        """Return the largest tangential traction (Pa) at ``pressure >= 0`` (Pa) in contact."""

    def metric(self, sliding: Sliding) -> Expr | None:
        """Return a symmetric positive tensor ``M`` in the frame, or ``None`` for the identity.

        The cone is ``|M^-1 c_t| <= limit``, and slip dissipates most: it is along
        ``-M^-1 M^-1 c_t``.
        """
        return None

    def row(self, s: Expr, c_t: Expr, limit: Expr, r: Expr, eps: Expr) -> Expr:
        """Return the tangential residual (Pa) of a node, zero where the law holds."""
        return rows.projection_row(s, c_t, limit, r, eps)

    def on(self, msh: mesh.Mesh) -> "FrictionLaw":
        """Return the law with Constants of a mesh in place of numbers, to compile it once.

        Numbers in expressions become Constants anyway. Override this only where UFL folds some
        numbers to another expression, such as ``0 * pressure``.
        """
        return self

    @property
    def certifiable(self) -> bool:
        """Whether the natural map of limit and metric states the law."""
        return type(self).row is FrictionLaw.row


def limit_at(law: FrictionLaw, pressure: float, sliding: Sliding, msh: mesh.Mesh) -> Expr:
    """Return the limit (Pa) of a law at a given pressure (Pa).

    UFL works out numbers, also those of a branch that is not taken at this pressure, such as the
    root of ``pressure - 5``; where it cannot, the pressure is a Constant of the mesh.
    """
    try:
        limit = ufl.as_ufl(law.limit(ufl.as_ufl(pressure), sliding))
        if not extract_type(limit, ComplexValue):
            return limit
    except Exception:
        pass  # if it is no fault of the number, it is raised again
    return ufl.as_ufl(law.limit(as_constant(pressure, msh), sliding))


class Frictionless(FrictionLaw):
    """No tangential traction."""

    def limit(self, pressure: Expr, sliding: Sliding) -> Expr:
        """Return zero."""
        return 0.0 * pressure


class PermanentStick(FrictionLaw):
    """No slip while in contact, whatever the traction."""

    def limit(self, pressure: Expr, sliding: Sliding) -> Expr:
        """Return more than any traction."""
        return ufl.as_ufl(UNLIMITED)


Mu = float | Expr | Callable[[Expr, Sliding], Expr]


@dataclass(frozen=True)
class Coulomb(FrictionLaw):
    """Coulomb's law, ``limit = mu * pressure``, eq. (2), with optional adhesion and cap.

    ``limit = min(adhesion + mu * pressure, cap)``. Tresca's law is ``mu = 0`` with an adhesion; a
    cap alone would leave the limit at zero.

    Attributes:
        mu: Friction coefficient: a number, ``fem.Constant``, ``fem.Function`` on the mesh or on
            the contact surface, a scalar UFL expression of such, or a function of the pressure
            and of :class:`Sliding` that returns one. Values are checked to be ``>= 0``: here
            where they are known, at the contact nodes in every step.
        adhesion: Limit at zero pressure (Pa), while in contact.
        cap: Largest limit (Pa), or ``None``.
    """

    mu: Mu
    adhesion: float | Expr = 0.0
    cap: float | Expr | None = None

    def __post_init__(self) -> None:
        """Check the coefficients as far as their values are known."""
        if not _is_function(self.mu):
            _check(self.mu, "The friction coefficient mu", " or a function mu(pressure, sliding)")
        _check(self.adhesion, "The adhesion")
        if self.cap is not None:
            _check(self.cap, "The cap")

    def on(self, msh: mesh.Mesh) -> "Coulomb":
        """Return the law with a Constant in place of a number ``mu``."""
        if isinstance(self.mu, Expr) or callable(self.mu):
            return self
        law = copy.copy(self)  # whatever constructor a class of the user has
        object.__setattr__(law, "mu", as_constant(self.mu, msh))
        return law

    def limit(self, pressure: Expr, sliding: Sliding) -> Expr:
        """Return ``min(adhesion + mu * pressure, cap)``."""
        mu: Any = self.mu
        if _is_function(mu):
            mu = call(mu, "The friction coefficient mu(pressure, sliding)", pressure, sliding)
        limit = ufl.as_ufl(self.adhesion) + ufl.as_ufl(mu) * pressure
        return limit if self.cap is None else ufl.min_value(limit, ufl.as_ufl(self.cap))


@dataclass(frozen=True)
class OrthotropicCoulomb(FrictionLaw):
    """Coulomb friction with an elliptical cone in 3D.

    Attributes:
        mu: Friction coefficients along the axis and across it, ``> 0``.
        axis: Direction whose projection on the surface is the first axis of the ellipse.
    """

    mu: tuple[float, float]
    axis: Sequence[float]

    def __post_init__(self) -> None:
        """Check the coefficients."""
        coefficients = vector(self.mu, "The orthotropic friction coefficients mu", dimension=2)
        for value in coefficients:
            number(value, "The orthotropic friction coefficient mu", above=0.0)
        if not min(coefficients) >= RATIO * max(coefficients):
            raise ContactInputError(
                f"The orthotropic friction coefficients mu = {shown(self.mu)} differ by more than "
                f"1 : {RATIO:g}; rounding would hide the smaller one in the metric, their sum."
            )
        if not vector(self.axis, "The axis of orthotropic friction", dimension=3).any():
            raise ContactInputError(
                f"The axis of orthotropic friction {self.axis} has no direction; give a vector "
                "that is not zero."
            )

    def limit(self, pressure: Expr, sliding: Sliding) -> Expr:
        """Return the pressure; the coefficients are in the metric."""
        return pressure

    def metric(self, sliding: Sliding) -> Expr:
        """Return ``mu_1 d d + mu_2 (1 - d d)`` with the axis ``d`` in the frame."""
        if len(sliding.tangents) != 2:
            raise ContactInputError(
                "OrthotropicCoulomb is friction in 3D; in 2D there is one direction: use Coulomb."
            )
        axis = ufl.as_vector([float(value) for value in self.axis])
        d = rows.direction(ufl.as_vector([ufl.dot(axis, e) for e in sliding.tangents]))
        along = ufl.outer(d, d)
        return float(self.mu[0]) * along + float(self.mu[1]) * (ufl.Identity(2) - along)


def _is_function(value: object) -> bool:
    """Tell whether a coefficient is a function of pressure and sliding."""
    return callable(value) and not isinstance(value, Expr | type)


def _check(value: object, what: str, or_else: str = "") -> None:
    """Raise unless a coefficient is scalar and, where its value is known, finite and ``>= 0``."""
    if isinstance(value, Expr):
        if value.ufl_shape != ():
            raise ContactInputError(
                f"{what} must be scalar, its shape is {value.ufl_shape}; give one component."
            )
        if not isinstance(value, fem.Constant):
            return
        value = value.value[()]
    elif isinstance(value, str | type | list | tuple | dict | None):
        raise ContactInputError(
            f"{what} = {shown(value)} is {kind(value)}; give a number, fem.Constant, fem.Function, "
            f"scalar UFL expression{or_else}."
        )
    number(value, what, at_least=0.0)
