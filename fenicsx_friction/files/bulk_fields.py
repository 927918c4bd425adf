# SPDX-License-Identifier: MIT
"""Fields of the bulk that files can hold: the displacement, and what the user asks for."""

from collections.abc import Mapping

import basix.ufl
import numpy as np
from dolfinx import fem
from ufl.core.expr import Expr

from ..base.compilation import compiled
from ..base.domains import check_terminals
from ..base.errors import ContactInputError
from ..base.validators import instance, shown
from ..problem import FrictionalContactProblem

#: Name of the displacement.
DISPLACEMENT = "displacement"


class BulkFields:
    """The displacement at the nodes, further fields there or one value a cell.

    Files of ParaView hold Lagrange fields of one degree, and constants of the cells. The degree is
    that of displacement or cells, the larger. A bubble is left out. Other fields than Lagrange ones
    of this degree are evaluated at the midpoints of the cells.

    Args:
        problem: The problem.
        fields: Functions and UFL expressions on the mesh of ``u``, by name.
    """

    def __init__(self, problem: FrictionalContactProblem, fields: Mapping[str, Expr]) -> None:
        self._u, msh = problem.u, problem.u.function_space.mesh
        instance(fields, Mapping, "fields", "a dictionary of UFL expressions by name")
        for name, expression in fields.items():
            where = f"fields[{name!r}]"
            instance(name, str, "a name in fields", "a string")
            instance(expression, Expr, where, "a fem.Function or UFL expression")
            check_terminals(expression, [msh], where)
            if name == DISPLACEMENT or len(expression.ufl_shape) > 2:
                raise ContactInputError(
                    f"{where} = {shown(expression)} must have another name than the displacement, "
                    "and be a scalar, vector or matrix."
                )
        own = problem.u.function_space.ufl_element().basix_element
        kind = own.family.name if hasattr(own, "family") else ""
        degree = own.degree if kind == "P" else 1
        degree = max(degree, msh.geometry.cmaps[0].degree)
        element = basix.ufl.element("Lagrange", msh.basix_cell(), degree)
        self._element, shape = element, (msh.geometry.dim,)
        W = fem.functionspace(msh, basix.ufl.blocked_element(element, shape=shape))
        self.displacement = fem.Function(W, name=DISPLACEMENT)
        self._made = [self._field(problem, name, fields[name]) for name in sorted(fields)]

    @property
    def functions(self) -> list[fem.Function]:
        """All fields."""
        return [self.displacement, *(function for function, _ in self._made)]

    def update(self) -> None:
        """Take the present values; collective."""
        self.displacement.interpolate(self._u)
        for function, source in self._made:
            if isinstance(source, fem.Function):
                function.x.array[:] = source.x.array
            else:
                function.interpolate(source)
            function.x.scatter_forward()

    def _field(
        self, problem: FrictionalContactProblem, name: str, expression: Expr
    ) -> tuple[fem.Function, fem.Function | fem.Expression]:
        """Return a Function for a field, and what it is filled from."""
        msh = self._u.function_space.mesh
        if isinstance(expression, fem.Function):
            V = expression.function_space
            if V.element.basix_element == self.displacement.function_space.element.basix_element:
                return fem.Function(V, name=name), expression
        V = fem.functionspace(msh, ("DG", 0, expression.ufl_shape))
        function = fem.Function(V, name=name)
        points = V.element.interpolation_points
        return function, compiled(fem.Expression, problem.comm)(expression, np.asarray(points))
