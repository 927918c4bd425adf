# SPDX-License-Identifier: MIT
"""UFL expressions at the nodes of a contact surface, with exact derivatives.

Each node is a point of its own. Fields, Constants and numbers of an expression are copied to a mesh
of points; FFCx compiles the expression there, a few lines of code. A field without values at the
nodes, such as a gradient, counts with its mean over the facets round the node.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import Mesh
from ufl.algorithms import expand_derivatives
from ufl.classes import (
    Derivative,
    Expr,
    GeometricQuantity,
    Label,
    SpatialCoordinate,
    Variable,
)
from ufl.corealg.traversal import unique_pre_traversal
from ufl.domain import extract_domains

from ..base.errors import ContactInputError
from ..base.literals import Lifter
from .points import Points, points_of

Array = npt.NDArray[np.floating]


class Sites(Protocol):
    """Points of a contact surface: its nodes, or those of a quadrature rule on its faces.

    Attributes:
        name: Name of the surface.
        mesh, submesh: The mesh of the body, and that of the contact facets.
    """

    name: str
    mesh: Mesh
    submesh: Mesh

    @property
    def num_owned(self) -> int:
        """Number of points of this rank."""

    @property
    def x(self) -> Array:
        """Reference coordinates (m), one row a point."""

    def reader(self, f: fem.Function) -> Callable[[], Array] | None:
        """Return what reads a Function at the points, ``None`` if it must be evaluated."""

    def evaluator(self, expression: Expr) -> Callable[[], Array]:
        """Return what evaluates an expression at the points, one row a point; collective."""


def variable(f: Expr, number: int) -> Expr:
    """Return a variable to differentiate by, whose label is the same in each run.

    FFCx would compile an expression with a label of UFL's own count again and again.

    Args:
        f: What it stands for.
        number: Its own number in an expression, which must have no other variables.
    """
    return Variable(f, Label(number))


class NodalKernel:
    """Evaluates an expression and its derivatives at the owned nodes of a surface.

    Args:
        sites: The contact surface, for its nodes, or other points of it.
        values: UFL vector over the parent mesh and the submesh.
        by: Functions to differentiate by: those that the sites can read.
    """

    def __init__(self, sites: Sites, values: Expr, by: Sequence[fem.Function] = ()) -> None:
        self._points, comm = points_of(sites, sites.num_owned), sites.mesh.comm
        self._copies = copies = _Copies(sites, self._points, by)
        at_points = copies(_without_derivatives(values))
        self._sizes = [(len(values), 1)]
        entries = _entries(at_points)
        for f in by:
            entries += _entries(ufl.diff(at_points, copies(f)))
            self._sizes.append((len(values), int(np.prod(f.ufl_shape, dtype=int))))
        # All in one, for the compiler is slow, and the nodes of a surface are few.
        self._evaluate = self._points.expression(ufl.as_vector(entries), comm)
        self._kept: tuple[int, list[Array]] = (0, [])

    def version(self) -> int:
        """Return a number that changes with what the values depend on; collective."""
        return self._copies.refresh()

    def values(self) -> Array:
        """Return the values now, one row a node; collective."""
        return self._now()[0][:, :, 0].copy()

    def derivatives(self) -> list[Array]:
        """Return the derivatives by each Function: (nodes, values, components); collective."""
        return self._now()[1:]

    def _now(self) -> list[Array]:
        """Evaluate values and derivatives, as far as anything has changed."""
        version = self._copies.refresh()
        if version != self._kept[0]:
            ends = np.cumsum([a * b for a, b in self._sizes])
            parts = np.split(self._evaluate(), ends[:-1], axis=1)
            self._kept = (
                version,
                [a.reshape(len(a), *size) for a, size in zip(parts, self._sizes, strict=True)],
            )
        return self._kept[1]


class _Copies(Lifter):
    """Copies terminals and numbers to the mesh of points; ``refresh`` copies their values.

    The copies of the Functions to differentiate by are variables.
    """

    def __init__(self, sites: Sites, points: Points, by: Sequence[fem.Function]) -> None:
        super().__init__(points.mesh)
        self._numbers = {f: i for i, f in enumerate(by)}
        self._sites, self._points, self._version = sites, points, 1
        self._sources: list[tuple[Array, Callable[[], Array]]] = []

    def refresh(self) -> int:
        """Copy the values of now; return a number that changes with them; collective."""
        for kept, source in self._sources:
            now = source().ravel()
            if now.size and np.count_nonzero(kept != now):  # faster than any
                self._version += 1  # first, for an interrupt may come
                kept[:] = now
        return self._version

    def replacement(self, o: Any) -> Expr | None:
        """Return the copy of a terminal, or of a derivative."""
        if isinstance(o, fem.Constant):
            copy = fem.Constant(self._points.mesh, np.zeros(o.ufl_shape, dtype=default_scalar_type))
            self._sources.append((copy.value.reshape(-1), lambda: o.value))
            return copy
        if isinstance(o, fem.Function):
            field = self._field(o, self._sites.reader(o))
            return variable(field, self._numbers[o]) if o in self._numbers else field
        if isinstance(o, SpatialCoordinate):
            return self._field(o, lambda: self._sites.x[:, : o.ufl_shape[0]])
        if isinstance(o, (GeometricQuantity, Derivative)):
            self._refuse_surface(o)
            return self._field(o, None)
        return super().replacement(o)

    def _refuse_surface(self, o: Expr) -> None:
        """Refuse what lives on facets: FFCx would give other values, without a word."""
        if self._sites.submesh.ufl_domain() in extract_domains(o):
            raise ContactInputError(
                f"Contact surface '{self._sites.name}': a law or a gap contains {o}, on the "
                "contact's submesh; normals and derivatives there are not known at its nodes. "
                "Take those of a Function on the mesh of u, or a Function with their values."
            )

    def _field(self, o: Expr, values: Callable[[], Array] | None) -> Expr:
        """Return a Function of the points that holds a terminal's nodal values."""
        copy = self._points.function(o.ufl_shape)
        source = values or self._sites.evaluator(ufl.as_vector(_entries(o)))
        self._sources.append((copy.x.array, source))
        return copy


def _without_derivatives(o: Expr) -> Expr:
    """Return an expression with derivatives carried out, as far as there are any."""
    found = any(isinstance(part, Derivative) for part in unique_pre_traversal(o))
    return expand_derivatives(o) if found else o


def _entries(o: Expr) -> list[Expr]:
    """Return all entries of a tensor."""
    return [o[i] for i in np.ndindex(*o.ufl_shape)] if o.ufl_shape else [o]
