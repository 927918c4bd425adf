# SPDX-License-Identifier: MIT
"""UFL expressions at the nodes of a contact surface, with exact derivatives.

Each node is a point of its own. Fields, Constants and numbers of an expression are copied to a mesh
of points; FFCx compiles the expression there, a few lines of code. A field without values at the
nodes, such as a gradient, counts with its mean over the facets round the node.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import singledispatchmethod
from typing import Any

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import default_scalar_type, fem, mesh
from ufl.algorithms import expand_derivatives
from ufl.classes import (
    Coefficient,
    ConstantValue,
    Derivative,
    Expr,
    GeometricQuantity,
    SpatialCoordinate,
)
from ufl.constant import Constant
from ufl.corealg.dag_traverser import DAGTraverser

from ..base.compilation import compiled
from ..base.literals import lifted
from .surface import ContactSurface, has_vertex_dofs

Array = npt.NDArray[np.floating]


class Points:
    """A mesh of points and Functions on it that hold a vector for each.

    Args:
        number: Number of points of this rank.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.mesh = mesh.create_point_mesh(MPI.COMM_SELF, np.zeros((max(number, 1), 3)))
        self.cells = np.arange(max(number, 1), dtype=np.int32)

    def function(self, shape: tuple[int, ...]) -> fem.Function:
        """Return a Function with an array of numbers for each point."""
        element = basix.ufl.element("DG", "point", 0, shape=shape)
        return fem.Function(fem.functionspace(self.mesh, element))

    def expression(self, values: Expr, comm: MPI.Intracomm) -> Callable[[], Array]:
        """Compile an expression; returns what evaluates it, one row a point."""
        made = compiled(fem.Expression, comm)(
            lifted(values, self.mesh), np.zeros((1, 0)), comm=comm
        )

        def evaluate() -> Array:
            """Evaluate at all points."""
            return np.asarray(made.eval(self.mesh, self.cells)[: self.number, 0])

        return evaluate


class NodalKernel:
    """Evaluates an expression and its derivatives at the owned nodes of a surface.

    Args:
        surface: The contact surface.
        values: UFL vector over the parent mesh and the submesh.
        by: Functions to differentiate by: nodal ones of the surface, or with a dof at each vertex.
        nodal: Nodal values of some Functions, in place of those that they hold.
    """

    def __init__(
        self,
        surface: ContactSurface,
        values: Expr,
        by: Sequence[fem.Function] = (),
        nodal: Mapping[fem.Function, Callable[[], Array]] | None = None,
    ) -> None:
        self._points, comm = Points(surface.num_owned), surface.mesh.comm
        copier = _Copier(surface, self._points, dict(nodal or {}))
        at_points = copier(expand_derivatives(values))
        self.refresh, self._sizes = copier.refresh, [(len(values), 1)]
        entries = _entries(at_points)
        for f in by:
            variable = ufl.variable(copier(f))
            derivative = ufl.diff(ufl.replace(at_points, {copier(f): variable}), variable)
            entries += _entries(derivative)
            self._sizes.append((len(values), int(np.prod(f.ufl_shape, dtype=int))))
        # All in one, for the compiler is slow, and the nodes of a surface are few.
        self._evaluate = self._points.expression(ufl.as_vector(entries), comm)
        self._parts: list[Array] | None = None

    def values(self, *, refresh: bool = True) -> Array:
        """Return the values now, one row a node; collective unless they are of the last refresh."""
        return self._now(refresh)[0][:, :, 0].copy()

    def derivatives(self, *, refresh: bool = True) -> list[Array]:
        """Return the derivatives by each Function: (nodes, values, components)."""
        return self._now(refresh)[1:]

    def _now(self, refresh: bool) -> list[Array]:
        """Evaluate values and derivatives, as far as anything has changed."""
        if (refresh and self.refresh()) or self._parts is None or not refresh:
            ends = np.cumsum([a * b for a, b in self._sizes])
            parts = np.split(self._evaluate(), ends[:-1], axis=1)
            self._parts = [
                part.reshape(len(part), *size)
                for part, size in zip(parts, self._sizes, strict=True)
            ]
        return self._parts


class _Copier(DAGTraverser):
    """Copies terminals to the mesh of points; ``refresh`` copies their values."""

    def __init__(
        self,
        surface: ContactSurface,
        points: Points,
        nodal: dict[fem.Function, Callable[[], Array]],
    ) -> None:
        super().__init__()
        self._surface, self._points, self._nodal = surface, points, nodal
        self._sources: list[tuple[Any, Callable[[], Array]]] = []
        self._first = True

    def refresh(self) -> bool:
        """Copy the values of now; tell whether any has changed on this rank; collective."""
        changed, self._first = self._first, False
        for copy, source in self._sources:
            now = np.asarray(source())
            kept = copy.value if isinstance(copy, fem.Constant) else copy.x.array
            if now.size and not np.array_equal(kept.ravel(), now.ravel()):
                kept[...] = now.reshape(kept.shape)
                changed = True
        return changed

    @singledispatchmethod
    def process(self, o: Expr) -> Expr:
        """Keep what holds no terminals."""
        return super().process(o)

    @process.register(Expr)
    def _(self, o: Expr) -> Expr:
        return self.reuse_if_untouched(o)

    @process.register(ConstantValue)
    def _(self, o: ConstantValue) -> Expr:
        return o

    @process.register(Constant)
    def _(self, o: Any) -> Expr:
        copy = fem.Constant(self._points.mesh, np.zeros(o.ufl_shape, dtype=default_scalar_type))
        self._sources.append((copy, lambda: o.value))
        return copy

    @process.register(Coefficient)
    def _(self, o: Any) -> Expr:
        return self._field(o, self._nodal.get(o) or self._vertex_values(o))

    @process.register(SpatialCoordinate)
    def _(self, o: Expr) -> Expr:
        return self._field(o, lambda: self._surface.x[:, : o.ufl_shape[0]])

    @process.register(GeometricQuantity)
    @process.register(Derivative)
    def _(self, o: Expr) -> Expr:
        return self._field(o, None)

    def _field(self, o: Expr, values: Callable[[], Array] | None) -> Expr:
        """Return a Function of the points that holds a terminal's nodal values."""
        copy = self._points.function(o.ufl_shape)
        source = values or self._surface.evaluator(ufl.as_vector(_entries(o)))
        self._sources.append((copy, source))
        return copy

    def _vertex_values(self, f: fem.Function) -> Callable[[], Array] | None:
        """Return what reads the values of a Function at the nodes, or ``None``."""
        n, V = self._surface.num_owned, f.function_space
        bs = V.dofmap.index_map_bs
        if V.mesh is self._surface.submesh and V.dofmap.index_map.size_local == n:
            return lambda: f.x.array[: n * bs]
        if V.mesh is self._surface.mesh and has_vertex_dofs(V):
            dofs = self._surface.parent_dofs(V)[:n]
            return lambda: f.x.array.reshape(-1, bs)[dofs]
        return None


def _entries(o: Expr) -> list[Expr]:
    """Return all entries of a tensor."""
    return [o[i] for i in np.ndindex(*o.ufl_shape)] if o.ufl_shape else [o]
