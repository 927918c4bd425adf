# SPDX-License-Identifier: MIT
"""Fields of the bulk that files can hold: the displacement, and what the user asks for."""

from collections.abc import Callable, Mapping

import basix.ufl
import numpy as np
from dolfinx import fem
from ufl.algorithms import extract_coefficients
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
    of this degree are evaluated at the midpoints of the cells. What contains Functions that have
    values at quadrature points only, such as a plastic strain, is averaged over these in each cell.

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
        for function, fill in self._made:
            fill()
            function.x.scatter_forward()

    def _field(
        self, problem: FrictionalContactProblem, name: str, expression: Expr
    ) -> tuple[fem.Function, Callable[[], None]]:
        """Return a Function for a field, and what fills it."""
        msh, rule = self._u.function_space.mesh, _quadrature(expression)
        if isinstance(expression, fem.Function) and rule is None:
            V = expression.function_space
            if V.element.basix_element == self.displacement.function_space.element.basix_element:
                function, values = fem.Function(V, name=name), expression.x
                return function, lambda: np.copyto(function.x.array, values.array)
        V = fem.functionspace(msh, ("DG", 0, expression.ufl_shape))
        function = fem.Function(V, name=name)
        points = V.element.interpolation_points if rule is None else rule[0]
        made = compiled(fem.Expression, problem.comm)(expression, np.asarray(points))
        if rule is None:
            return function, lambda: function.interpolate(made)
        cells, weights = np.arange(len(V.dofmap.list), dtype=np.int32), rule[1] / np.sum(rule[1])

        def average() -> None:
            values = made.eval(msh, cells).reshape(len(cells), len(weights), V.dofmap.bs)
            function.x.array.reshape(-1, V.dofmap.bs)[V.dofmap.list[:, 0]] = np.einsum(
                "cqi,q->ci", values, weights
            )

        return function, average


def _quadrature(expression: Expr) -> tuple[np.ndarray, np.ndarray] | None:
    """Return points and weights of the quadrature elements in an expression, if there are any."""
    elements = [f.ufl_element() for f in extract_coefficients(expression)]
    rules = [e.custom_quadrature() for e in elements if e.has_custom_quadrature]
    return rules[0] if rules else None
