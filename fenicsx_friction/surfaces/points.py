# SPDX-License-Identifier: MIT
"""Meshes of points, on which FFCx compiles an expression into a few lines of code."""

from __future__ import annotations

from collections.abc import Callable
from weakref import WeakKeyDictionary

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem, mesh
from ufl.algorithms import extract_coefficients
from ufl.algorithms.analysis import extract_constants
from ufl.core.expr import Expr

from ..base.compilation import compiled

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
        self._spaces: dict[tuple[int, ...], fem.FunctionSpace] = {}

    def function(self, shape: tuple[int, ...]) -> fem.Function:
        """Return a Function with an array of numbers for each point."""
        if shape not in self._spaces:
            element = basix.ufl.element("DG", "point", 0, shape=shape)
            self._spaces[shape] = fem.functionspace(self.mesh, element)
        return fem.Function(self._spaces[shape])

    def expression(self, values: Expr, comm: MPI.Intracomm) -> Callable[[], Array]:
        """Compile an expression; returns what evaluates it, one row a point.

        Derivatives by what :func:`~fenicsx_friction.surfaces.nodal_kernel.variable` returns may
        be left in it: FFCx expands them where it has no compiled form.
        """
        if not extract_coefficients(values) and not extract_constants(values):  # of no mesh
            values = values + fem.Constant(self.mesh, np.zeros(values.ufl_shape))
        made = compiled(fem.Expression, comm)(values, np.zeros((1, 0)), comm=comm)

        def evaluate() -> Array:
            """Evaluate at all points."""
            return np.asarray(made.eval(self.mesh, self.cells)[: self.number, 0])

        return evaluate


_KNOWN: WeakKeyDictionary[object, Points] = WeakKeyDictionary()


def points_of(sites: object, number: int) -> Points:
    """Return the points of a surface, or of other sites; to make them anew takes longer.

    Args:
        sites: Whose points they are.
        number: Number of points of this rank.
    """
    if sites not in _KNOWN:
        _KNOWN[sites] = Points(number)
    return _KNOWN[sites]
