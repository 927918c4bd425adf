# SPDX-License-Identifier: MIT
"""Equations beside the momentum balance, and the scales of their rows."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix
from dolfinx.la import InsertMode

from ..base.collective import largest_of_ranks
from ..base.compilation import compiled
from ..certificate.groups import Array, Groups, number_bodies
from ..certificate.scales import DIGITS, Scales
from .conditions import with_conditions

#: A row is measured by forces if a strain of one changes more than this fraction of it.
LINKED = 1e-6
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
        owned, bs = V.dofmap.index_map.size_local, V.dofmap.index_map_bs
        self.body = np.repeat(body, bs)[: owned * bs]
        self._groups = Groups(self.body, self.number)
        found = [self._derivative(residual, f) for f in others]
        self._others = list(others)
        self._bodies = [_bodies(f.function_space, V, self.number) for f in others]
        self._norms = [size for _, size in found]
        diagonal, norm = found[[f is unknown for f in others].index(True)]
        self.slope: Array = np.where(diagonal > 0.0, diagonal, norm)
        msh = others[0].function_space.mesh
        size = msh.comm.allreduce(float(np.max(msh.h(msh.topology.dim, _cells(msh)))), MPI.MAX)
        strained = self._norms[0] * size
        own = float(np.max(self._hidden(), initial=0.0)) / DIGITS
        self.linked = strained > LINKED * own
        self.unit = stiffest / self._norms[0] if self.linked and stiffest > 0.0 else 1.0
        sloped = np.where(self.slope > 0.0, self.slope, 1.0)
        self.row_factors = np.full(len(self.body), self.unit) if self.linked else sloped
        self.begin()

    def begin(self) -> None:
        """Keep the flows at the start of a step, under its new loads."""
        self._before: Array = self._flows()
        self.noise: Array = np.zeros(self.number)

    def find_noise(self, errors: Array) -> None:
        """Take the rounding errors of the rows of this state, until the next step begins."""
        self.noise = largest_of_ranks(self._comm, self._groups.largest(errors))

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
        """Return the rounding error that the unknowns cause in a row of each body."""
        most = np.zeros(self.number)
        for f, norm, groups in zip(self._others, self._norms, self._bodies, strict=True):
            values = np.maximum(abs(f.x.array), abs(with_conditions(f, self._bcs)))
            if groups is None:  # of another mesh
                largest = np.full(self.number, np.max(values, initial=0.0))
            else:
                largest = groups.largest(values)
            most = np.maximum(most, norm * largest)
        return DIGITS * np.nan_to_num(largest_of_ranks(self._comm, most), posinf=0.0)

    def _flows(self) -> Array:
        """Return the largest flow of each body."""
        vector = fem.assemble_vector(self._flow_form)
        vector.scatter_reverse(InsertMode.add)
        flows = self._groups.largest(abs(vector.array[: len(self.body)]))
        return largest_of_ranks(self._comm, flows)

    def _derivative(self, residual: ufl.Form, by: fem.Function) -> tuple[Array, float]:
        """Return the diagonal of a derivative of the equation, if it is square, and its norm."""
        tangent = ufl.algorithms.expand_derivatives(ufl.derivative(residual, by))
        diagonal = np.zeros(len(self.body))
        if tangent.empty():
            return diagonal, 0.0
        matrix = assemble_matrix(self._compiled(tangent))
        matrix.assemble()
        if by is self._unknown:  # square
            diagonal = abs(matrix.getDiagonal().array)
        norm = matrix.norm(PETSc.NormType.INFINITY)
        matrix.destroy()
        return diagonal, float(norm)

    def _compiled(self, form: ufl.Form) -> fem.Form:
        """Compile a form."""
        return compiled(fem.form, self._comm)(form, entity_maps=self._maps)


def _bodies(W: fem.FunctionSpace, V: fem.FunctionSpace, number: int) -> Groups | None:
    """Group the local dofs of a space by the bodies of another one, if of one mesh."""
    if W.mesh is not V.mesh:
        return None
    return Groups(np.repeat(number_bodies(W)[1], W.dofmap.index_map_bs), number)


def _weighted(residual: ufl.Form, V: fem.FunctionSpace) -> dict[ufl.Argument, ufl.core.expr.Expr]:
    """Map the test function to itself times a number between -1 and 1 for each cell."""
    (test,) = residual.arguments()
    weights = fem.Function(fem.functionspace(V.mesh, ("DG", 0)))
    index_map = V.mesh.topology.index_map(V.mesh.topology.dim)
    local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    weights.x.array[:] = 2.0 * ((index_map.local_to_global(local) * GOLDEN) % 1.0) - 1.0
    return {test: weights * test}


def _cells(msh: mesh.Mesh) -> npt.NDArray[np.int32]:
    """Return the owned cells."""
    return np.arange(msh.topology.index_map(msh.topology.dim).size_local, dtype=np.int32)
