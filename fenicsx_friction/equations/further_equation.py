# SPDX-License-Identifier: MIT
"""Equations beside the momentum balance, and the scales of their rows."""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix
from dolfinx.la import InsertMode

from ..base.collective import largest_of_ranks
from ..base.compilation import compiled
from ..base.groups import Array, Groups
from ..certificate.scales import DIGITS, Scales
from ..surfaces.bodies import number_bodies
from ..surfaces.cells import extreme_sizes
from .conditions import with_conditions
from .numbering import num_owned

#: A row is measured by forces if a strain of one changes more than this fraction of it.
LINKED = 1e-6
#: More than this many times the rounding of the unknowns is not rounding, but a kink, say.
MOST_NOISE = 64.0
#: Fractional parts of cell number times golden ratio differ much between neighbours.
GOLDEN = (1.0 + 5.0**0.5) / 2.0


class FurtherEquation:
    """A further equation of the user, such as that of heat; all methods are collective.

    At the solution, the flows from the cells to a node add up to zero. If the flow of each cell is
    first multiplied by a number of its own, the sum has the size of the flows. It does not change
    if a constant is added to the unknown. Residuals are compared with this sum, in each body apart.
    The rows of an equation that contains the displacement are also compared with the forces. Where
    flows are faint beside the unknowns, a residual may reach the rounding error that these cause.

    Args:
        residual: The equation.
        unknown: Its unknown.
        others: All unknowns of the bulk, displacement first.
        stiffest: The largest stiffness of the bulk (N/m), of all ranks.
        bcs: Dirichlet conditions.
        entity_maps: Entity maps of all meshes in the equation.

    Attributes:
        linked: Whether it depends on the displacement at the start.
        unit: Factor that brings a linked row to the unit of a force; else one.
        number: Number of bodies.
        body: Body of each owned dof of the unknown.
        slope: Derivative of each owned row by its own unknown.
        row_factors: Factors that bring conditions on the unknown to the unit of the rows.
    """

    #: What :meth:`begin` sets: arrays that are replaced, never changed.
    AT_START = ("_before", "noise")

    def __init__(
        self,
        residual: ufl.Form,
        unknown: fem.Function,
        others: Sequence[fem.Function],
        stiffest: float,
        bcs: Sequence[fem.DirichletBC],
        entity_maps: Sequence[mesh.EntityMap],
    ) -> None:
        self._unknown, self._bcs, V = unknown, bcs, unknown.function_space
        self._maps, self._comm = list(entity_maps), V.mesh.comm
        self._flow_form = self._compiled(ufl.replace(residual, _weighted(residual, V)))
        self.number, body = number_bodies(V)
        self.body = np.repeat(body, V.dofmap.index_map_bs)[: num_owned(unknown)]
        self._groups = Groups(self.body, self.number)
        self._others = list(others)
        self._tangents = [self._tangent(residual, f) for f in others]
        own = next(t for t, f in zip(self._tangents, others, strict=True) if f is unknown)
        diagonal, largest = 0.0 if own is None else own.getDiagonal().array, self._largest_row(own)
        slope = np.where(diagonal > 0.0, diagonal, largest)
        self.slope: Array = np.broadcast_to(slope, len(self.body))
        self._resists = largest > 0.0  # all slopes are then; the same on all ranks
        strained = self._largest_row(self._tangents[0])
        _, size = extreme_sizes(others[0].function_space.mesh)
        terms = float(np.max(self._hidden(), initial=0.0)) / DIGITS
        self.linked = bool(strained * size > LINKED * terms)
        self.unit = stiffest / strained if self.linked and stiffest > 0.0 else 1.0
        sloped = np.where(self.slope > 0.0, self.slope, 1.0)
        self.row_factors = np.full(len(self.body), self.unit) if self.linked else sloped
        self.begin()

    def begin(self) -> None:
        """Keep the flows at the start of a step, under its new loads."""
        self._before: Array = self._flows()
        self.noise: Array = np.zeros(self.number)

    def doubts(self) -> Array | None:
        """Return how exactly the unknown can be known, from the rounding of its linked rows.

        A pressure, say, is as uncertain as the change of volume times the bulk modulus. At each
        owned dof; ``None`` where this means nothing.
        """
        known = self.linked and self._resists
        return self._hidden()[self.body] / self.slope if known else None

    def find_noise(self, errors: Array) -> None:
        """Take the rounding errors of the rows of this state, until the next step begins."""
        noise = largest_of_ranks(self._comm, self._groups.largest(errors))
        self.noise = np.where(noise <= MOST_NOISE * self._hidden(), noise, 0.0)

    def scales(self, bodies: Scales) -> Scales:
        """Measure the equation in each body.

        Args:
            bodies: Scales of the forces, which measure linked equations, too.
        """
        largest, before = self.unit * self._flows(), self.unit * self._before
        if self.linked:
            largest = np.maximum(largest, np.max(bodies.largest))
            before = np.maximum(before, np.max(bodies.before))
        nothing = np.zeros(self.number)
        return Scales(
            largest,
            before,
            hidden=self.unit * self._hidden(),
            given=nothing,
            length=nothing,
            noise=self.unit * self.noise,
            lenient=np.ones(self.number, dtype=bool),
        )

    def _hidden(self) -> Array:
        """Return the largest rounding error that the unknowns cause in a row of each body."""
        terms = np.zeros(len(self.body))
        for f, tangent in zip(self._others, self._tangents, strict=True):
            x = np.maximum(abs(f.x.array), abs(with_conditions(f, self._bcs)))
            terms += self._terms(tangent, x[: num_owned(f)])
        return DIGITS * largest_of_ranks(self._comm, self._groups.largest(terms))

    def _flows(self) -> Array:
        """Return the largest flow of each body."""
        vector = fem.assemble_vector(self._flow_form)
        vector.scatter_reverse(InsertMode.add)
        flows = self._groups.largest(abs(vector.array[: len(self.body)]))
        return largest_of_ranks(self._comm, flows)

    def _tangent(self, residual: ufl.Form, by: fem.Function) -> PETSc.Mat | None:
        """Return the absolute values of the derivatives of the rows by an unknown, if any."""
        tangent = ufl.algorithms.expand_derivatives(ufl.derivative(residual, by))
        if tangent.empty():
            return None
        matrix = assemble_matrix(self._compiled(tangent))
        matrix.assemble()
        rows, columns, values = matrix.getValuesCSR()
        sizes = matrix.getSizes()
        matrix.destroy()
        values = np.nan_to_num(abs(values), posinf=0.0)
        return PETSc.Mat().createAIJ(sizes, csr=(rows, columns, values), comm=self._comm)

    def _terms(self, tangent: PETSc.Mat | None, x: Array) -> Array:
        """Return the sums of the sizes of the terms of each owned row.

        Args:
            tangent: Absolute values of derivatives.
            x: Absolute values of their unknown at its owned dofs.
        """
        if tangent is None:
            return np.zeros(len(self.body))
        there, rows = tangent.createVecs()
        there.array[:] = x
        tangent.mult(there, rows)
        found = rows.array.copy()
        there.destroy()
        rows.destroy()
        return np.asarray(found)

    def _largest_row(self, tangent: PETSc.Mat | None) -> float:
        """Return the largest sum of a row."""
        return 0.0 if tangent is None else float(tangent.norm(PETSc.NormType.INFINITY))

    def _compiled(self, form: ufl.Form) -> fem.Form:
        """Compile a form."""
        return compiled(fem.form, self._comm)(form, entity_maps=self._maps)


def _weighted(residual: ufl.Form, V: fem.FunctionSpace) -> dict[ufl.Argument, ufl.core.expr.Expr]:
    """Map the test function to itself times a number between -1 and 1 for each cell."""
    (test,) = residual.arguments()
    weights = fem.Function(fem.functionspace(V.mesh, ("DG", 0)))
    index_map = V.mesh.topology.index_map(V.mesh.topology.dim)
    local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    weights.x.array[:] = 2.0 * ((index_map.local_to_global(local) * GOLDEN) % 1.0) - 1.0
    return {test: weights * test}
