# SPDX-License-Identifier: MIT
"""Equations beside the momentum balance: what their rows are measured by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix
from dolfinx.la import InsertMode

from ..base.compilation import compiled
from ..certificate.groups import Array, Groups, number_bodies
from ..certificate.scales import Scales
from .conditions import with_conditions

#: An unknown that is right to this part of its largest value may stand for flows that are not
#: right to the tolerance; they are faint where it hides more than a part of them.
EXACT, HIDES = 1e-12, 1e-6
#: Numbers of cells times the golden ratio: neighbours get fractions far from each other.
GOLDEN = (1.0 + 5.0**0.5) / 2.0


class FurtherEquation:
    """A further equation of the user, such as that of heat; all methods are collective.

    At the solution, what flows from the cells through each node has the sum zero. Multiplied by a
    number for each cell, the sum is of the size of the flows instead, whatever constant is added
    to the unknown: this is what residuals are compared with, in each body apart. The rows of an
    equation that contains the displacement are also compared with the forces. Where flows are too
    faint for that, beside the unknown, the unknown itself is right to ``EXACT``.

    Args:
        residual: The equation.
        unknown: Its unknown.
        u: The displacement.
        stiffest: The largest stiffness of the bulk (N/m), of all ranks.
        bcs: Dirichlet conditions.
        entity_maps: Entity maps of all meshes in the equation.

    Attributes:
        linked: Whether it depends on the displacement, now.
        unit: What brings a row to the unit of a force, if it is linked; else one.
        number: Number of bodies.
        body: Body of each owned dof of the unknown.
        slope: Derivative of each owned row by its own unknown.
        row_factors: What makes the conditions on the unknown commensurate with the rows.
    """

    #: What :meth:`begin` sets: arrays that are replaced, never changed.
    AT_START = ("_before", "_there")

    def __init__(
        self,
        residual: ufl.Form,
        unknown: fem.Function,
        u: fem.Function,
        stiffest: float,
        bcs: Sequence[fem.DirichletBC],
        entity_maps: Sequence[mesh.EntityMap],
    ) -> None:
        self._unknown, self._bcs, V = unknown, bcs, unknown.function_space
        self._maps, self._comm = list(entity_maps), V.mesh.comm
        self._flow_form = self._compiled(ufl.replace(residual, _weighted(residual, V)))
        self.number, body = number_bodies(V)
        owned, bs = V.dofmap.index_map.size_local, V.dofmap.index_map_bs
        self.body = np.repeat(body, bs)[: owned * bs]
        self._groups = Groups(self.body, self.number)
        _, coupling = self._derivative(residual, u)
        self.linked = coupling > 0.0
        self.unit = stiffest / coupling if self.linked and stiffest > 0.0 else 1.0
        diagonal, norm = self._derivative(residual, unknown)
        self.slope = np.where(diagonal > 0.0, diagonal, norm)
        sloped = np.where(self.slope > 0.0, self.slope, 1.0)
        self.row_factors = np.full(len(self.body), self.unit) if self.linked else sloped
        self.begin()

    def begin(self) -> None:
        """Keep the flows at the start of a step, under its new loads, and what is prescribed."""
        self._before = self._flows()
        there = np.maximum(
            abs(self._unknown.x.array), abs(with_conditions(self._unknown, self._bcs))
        )
        there = there[: len(self.body)]
        given = [self._groups.largest(values) for values in (self.slope * there, there)]
        self._there = self._over_ranks(np.stack(given))

    def scales(self, bodies: Scales) -> Scales:
        """Measure the equation in each body.

        Args:
            bodies: Scales of the forces, which measure linked equations, too.
        """
        flows = self.unit * self._flows()
        if self.linked:
            own = [flows, self.unit * self._before]
            forces = [np.full(self.number, np.max(getattr(bodies, f.name))) for f in fields(Scales)]
            return Scales(*map(np.maximum, own, forces[:2]), *forces[2:])
        x = abs(self._unknown.x.array[: len(self.body)])
        now = self._over_ranks(np.stack([self._groups.largest(v) for v in (self.slope * x, x)]))
        hidden, length = EXACT * np.maximum(now, self._there)
        return Scales(flows, self._before, hidden, hidden / HIDES, length)

    def _flows(self) -> Array:
        """Return the largest flow of each body."""
        vector = fem.assemble_vector(self._flow_form)
        vector.scatter_reverse(InsertMode.add)
        return self._over_ranks(self._groups.largest(abs(vector.array[: len(self.body)])))

    def _derivative(self, residual: ufl.Form, by: fem.Function) -> tuple[Array, float]:
        """Return the diagonal of a derivative of the equation, if it is square, and its norm."""
        tangent = ufl.algorithms.expand_derivatives(ufl.derivative(residual, by))
        diagonal = np.zeros(len(self.body))
        if tangent.empty():
            return diagonal, 0.0
        matrix = assemble_matrix(self._compiled(tangent))
        matrix.assemble()
        if by is self._unknown:
            diagonal = abs(matrix.getDiagonal().array)
        norm = matrix.norm(PETSc.NormType.INFINITY)
        matrix.destroy()
        return diagonal, float(norm)

    def _compiled(self, form: ufl.Form) -> fem.Form:
        """Compile a form."""
        return compiled(fem.form, self._comm)(form, entity_maps=self._maps)

    def _over_ranks(self, values: Array) -> Array:
        """Return the largest values of all ranks; what is not a number counts as infinite."""
        values = np.nan_to_num(values, nan=np.inf, posinf=np.inf)
        self._comm.Allreduce(MPI.IN_PLACE, values, op=MPI.MAX)
        return values


def _weighted(residual: ufl.Form, V: fem.FunctionSpace) -> dict[ufl.Argument, ufl.core.expr.Expr]:
    """Map the test function to itself times a number between -1 and 1 for each cell."""
    (test,) = residual.arguments()
    weights = fem.Function(fem.functionspace(V.mesh, ("DG", 0)))
    cells = V.mesh.topology.original_cell_index
    weights.x.array[: len(cells)] = 2.0 * ((cells * GOLDEN) % 1.0) - 1.0
    return {test: weights * test}
