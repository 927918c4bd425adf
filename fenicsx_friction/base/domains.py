# SPDX-License-Identifier: MIT
"""Which meshes the parts of a UFL expression live on."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from ufl.algorithms import extract_arguments, extract_coefficients
from ufl.algorithms.analysis import extract_constants
from ufl.core.expr import Expr
from ufl.corealg.traversal import unique_pre_traversal
from ufl.domain import extract_unique_domain

from .compat import same_topology
from .errors import ContactInputError


def check_terminals(
    expression: Expr, allowed: Iterable[object], what: str, *, arguments: bool = True
) -> None:
    """Raise a ContactInputError for what has no values or lives on another mesh.

    A ``fem.Constant`` may belong to any mesh: it is a number.

    Args:
        expression: A UFL expression.
        allowed: Meshes, or topologies of meshes, that may be in it.
        what: Name of the expression in messages.
        arguments: Whether there may be test or trial functions.
    """
    allowed = list(allowed)
    if not arguments and (found := extract_arguments(expression)):
        raise ContactInputError(
            f"{what} contains {found[0]}, a test or trial function: leave it out."
        )
    for f in extract_coefficients(expression):
        if not isinstance(f, fem.Function):
            raise ContactInputError(f"{what} contains {f}, which has no values: use fem.Function.")
        if f.x.array.dtype != default_scalar_type:
            raise ContactInputError(
                f"{what} contains the Function {f.name} of type {f.x.array.dtype}; this DOLFINx "
                f"computes with {np.dtype(default_scalar_type)}: make it of that type."
            )
        _check_mesh(f.function_space.mesh, allowed, f"{what} contains the Function {f.name}")
    for c in extract_constants(expression):
        if not isinstance(c, fem.Constant):
            raise ContactInputError(f"{what} contains {c}, which has no value: use fem.Constant.")
    for part in unique_pre_traversal(expression):
        if isinstance(part, ufl.classes.GeometricQuantity):
            domain: Any = extract_unique_domain(part)
            if (cargo := domain.ufl_cargo()) is not None:
                _check_mesh(cargo, allowed, f"{what} contains {part}")


def not_finite(expression: Expr) -> str:
    """Name the first Function in an expression with an infinite value or nan; collective.

    The value at a node is a sum over nodes, in which an infinite one reads as nan.
    """
    for f in extract_coefficients(expression):
        values = f.x.array[~np.isfinite(f.x.array)].tolist()
        found = [v for part in f.function_space.mesh.comm.allgather(values) for v in part]
        if found:
            return f", where or beside which the Function {f.name} is {found[0]:g}"
    return ""


def _check_mesh(msh: object, allowed: Iterable[object], what: str) -> None:
    """Raise unless a mesh is one of those allowed."""
    if not any(same_topology(msh, other) for other in allowed):
        raise ContactInputError(
            f"{what} of another mesh; make it on the mesh of u (or on the contact's own submesh, "
            "contact.surface.submesh)."
        )
