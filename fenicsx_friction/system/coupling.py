# SPDX-License-Identifier: MIT
"""What deformable obstacles add to residual and Jacobian beside the UFL forms.

The forms see the kinematics of such a contact as fields. Missing there are the forces on the
primary nodes, ``-N_i`` times those on the secondary ones (action and reaction), and all
derivatives by way of the kinematics. The contact element supplies these, the laws' rows are
differentiated in UFL.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from ..obstacles.deformable import DeformableObstacle
from ..surfaces.face_cells import Array
from .conditions import constrained_dofs, with_conditions

if TYPE_CHECKING:
    from ..contact.contact import Contact

Indices = npt.NDArray[np.int64]


def global_dofs(spaces: Sequence[fem.FunctionSpace]) -> list[Indices]:
    """Return, for the local dofs (with ghosts) of each space, their rows in the blocked system."""
    maps = [(V.dofmap.index_map, V.dofmap.index_map_bs) for V in spaces]
    next_row = sum(m.local_range[0] * bs for m, bs in maps)
    rows = []
    for V, (m, bs) in zip(spaces, maps, strict=True):
        numbers = fem.Function(V, dtype=np.float64)
        owned = m.size_local * bs
        numbers.x.array[:owned] = next_row + np.arange(owned)
        numbers.x.scatter_forward()
        rows.append(np.rint(numbers.x.array).astype(np.int64))
        next_row += owned
    return rows


@dataclass
class _Pair:
    """One contact with a deformable obstacle and the rows of its dofs, -1 where prescribed.

    Attributes:
        contact: The contact.
        obstacle: Its obstacle.
        secondary: Rows of the displacement of the own nodes.
        primary: Rows of the displacement of all nodes of the primary surface.
        multipliers: Rows of the multipliers.
        reactions: Rows of ``primary``, prescribed ones too.
    """

    contact: Contact
    obstacle: DeformableObstacle
    secondary: Indices
    primary: Indices
    multipliers: Indices
    reactions: Indices

    def columns(self) -> Indices:
        """Return the rows of the dofs of each element: its positions, then its multipliers."""
        columns = np.hstack([self.around(self.secondary, self.primary), self.multipliers])
        columns[~self.obstacle.pairs.paired] = -1
        return columns

    def around(self, secondary: npt.NDArray, primary: npt.NDArray) -> npt.NDArray:
        """Return what belongs to the positions of each element, one row an element.

        Args:
            secondary: Rows for the own nodes.
            primary: Rows for all nodes of the primary surface.
        """
        around = primary[self.obstacle.nodes()]
        n, number, d = around.shape  # n may be 0
        return np.hstack([secondary, around.reshape(n, number * d)])


class Coupling:
    """The pairs of all contacts with deformable obstacles of a problem.

    Args:
        contacts: All contacts of the problem.
        unknowns: All unknowns of the problem, the displacement first, the multipliers last.
        bcs: All boundary conditions.
    """

    def __init__(
        self,
        contacts: Sequence[Contact],
        unknowns: Sequence[fem.Function],
        bcs: Sequence[fem.DirichletBC],
    ) -> None:
        self._u, self._bcs = unknowns[0], bcs
        spaces = [f.function_space for f in unknowns]
        owned = [V.dofmap.index_map.size_local * V.dofmap.index_map_bs for V in spaces]
        self.num_rows, self._num_owned = sum(owned), owned[0]
        plain = global_dofs(spaces)
        rows = [r.copy() for r in plain]
        for V, free in zip(spaces, rows, strict=True):
            free[constrained_dofs(V, bcs)] = -1
        d = spaces[0].mesh.geometry.dim
        self.pairs: list[_Pair] = []
        for k, c_rows in zip(contacts, rows[len(rows) - len(contacts) :], strict=True):
            if isinstance(k.obstacle, DeformableObstacle):
                n, gather = k.surface.num_owned, k.obstacle.faces.gather_dofs
                secondary = rows[0].reshape(-1, d)[k.parent_dofs[:n]]
                multipliers = c_rows.reshape(-1, d)[:n]
                primary, reactions = gather(rows[0]), gather(plain[0])
                self.pairs.append(_Pair(k, k.obstacle, secondary, primary, multipliers, reactions))

    @property
    def versions(self) -> tuple[int, ...]:
        """What changes with the pairs."""
        return tuple(p.obstacle.version for p in self.pairs)

    def update(self) -> None:
        """Follow the displacement; collective."""
        for p in self.pairs:
            p.obstacle.update()

    # -- residual ----------------------------------------------------------------------------

    def momentum(self) -> Array:
        """Return the residual forces (N) on the primary nodes, for the owned displacement dofs."""
        vector = PETSc.Vec().createMPI((self.num_rows, None), comm=self._u.function_space.mesh.comm)
        self._add_forces(vector, [p.reactions for p in self.pairs])
        values = vector.array[: self._num_owned].copy()
        vector.destroy()
        return np.asarray(values)

    def add_residual(self, b: PETSc.Vec, matrices: Callable[[], list[Array]]) -> None:
        """Add to an assembled residual, with Dirichlet values lifted as in the forms; collective.

        Args:
            b: The residual.
            matrices: Returns the element matrices, where they are needed.
        """
        self._add_forces(b, [p.primary for p in self.pairs])
        missing = with_conditions(self._u, self._bcs) - self._u.x.array
        # A prescribed value that Newton has yet to reach moves what is near with it.
        comm = self._u.function_space.mesh.comm
        if comm.allreduce(float(np.max(abs(missing), initial=0.0)), MPI.MAX) > 0.0:
            d = self._u.function_space.mesh.geometry.dim
            for p, matrix in zip(self.pairs, matrices(), strict=True):
                own = missing.reshape(-1, d)[p.contact.parent_dofs[: len(p.secondary)]]
                step = p.around(own, p.obstacle.faces.gather_dofs(missing))
                _add(b, p.columns(), np.einsum("nij,nj->ni", matrix[:, :, : step.shape[1]], step))
            b.assemble()

    def _add_forces(self, vector: PETSc.Vec, targets: Sequence[Indices]) -> None:
        """Add the forces of action and reaction on the primary nodes; collective."""
        for p, rows in zip(self.pairs, targets, strict=True):
            obstacle, k = p.obstacle, p.contact
            traction = k.nodal_traction()  # updates the pairs
            face = obstacle.faces.faces[obstacle.pairs.face]
            weighted = obstacle.weights * k.surface.area.x.array[: len(face), None]
            values = np.einsum("ni,nd->nid", weighted, traction)
            _add(vector, rows[face][obstacle.pairs.paired], values[obstacle.pairs.paired])
        vector.assemble()

    # -- Jacobian --------------------------------------------------------------------------------

    def matrices(self, rows: Sequence[Callable[[], Array]]) -> list[Array]:
        """Return the element matrices of each contact; collective.

        Args:
            rows: For each pair, evaluates the derivative of the law's rows by the fields.
        """
        return [_element_matrices(p, r) for p, r in zip(self.pairs, rows, strict=True)]

    def law_derivatives(self, rows: Callable[[Contact], Expr]) -> list[Callable[[], Array]]:
        """Return evaluators of the derivatives of the laws' rows by the kinematic fields."""
        return [p.contact.evaluator(ufl.diff(rows(p.contact), p.obstacle.q)) for p in self.pairs]


def _element_matrices(pair: _Pair, law: Callable[[], Array]) -> Array:
    """Return the matrices of the elements: (n, dofs, dofs), rows as in ``columns()``."""
    k, obstacle = pair.contact, pair.obstacle
    n, d, nodes = *pair.secondary.shape, obstacle.faces.cell.nodes
    derivative = law().reshape(n, d, 1 + d * d)
    field, shapes = obstacle.derivatives()
    frames, frame_slopes = _frames(obstacle, field, n, d)
    c, area = k.c.x.array.reshape(-1, d)[:n], k.surface.area.x.array[:n]
    traction = np.einsum("nk,nkd->nd", c, frames)
    slope = np.einsum("nk,nkdz->ndz", c, frame_slopes)
    num_z = field.shape[2]
    matrix = np.zeros((n, num_z + d, num_z + d))
    matrix[:, :d, :num_z] = -slope
    for i in range(nodes):
        row, weight = slice(d * (1 + i), d * (2 + i)), obstacle.weights[:, i, None, None]
        matrix[:, row, :num_z] = weight * slope + traction[:, :, None] * shapes[:, i, None, :]
        matrix[:, row, num_z:] = weight * frames.transpose(0, 2, 1)
    matrix[:, num_z:, :num_z] = derivative @ field
    matrix *= area[:, None, None]
    matrix[~obstacle.pairs.paired] = 0.0
    return matrix


def _frames(obstacle: DeformableObstacle, slopes: Array, n: int, d: int) -> tuple[Array, Array]:
    """Return ``(n, e_1[, e_2])`` of each node and their derivatives by the positions."""
    start = 1 + d
    q = obstacle.field.x.array.reshape(-1, 1 + d * d)[:n]
    normal, dn = q[:, start : start + d], slopes[:, start : start + d]
    if d == 2:
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
        return np.stack([normal, normal @ turn.T], axis=1), np.stack([dn, turn @ dn], axis=1)
    first, de = q[:, 2 * d + 1 :], slopes[:, 2 * d + 1 :]
    second = np.cross(normal, first)
    d2 = np.cross(dn, first[:, :, None], axis=1) + np.cross(normal[:, :, None], de, axis=1)
    return np.stack([normal, first, second], axis=1), np.stack([dn, de, d2], axis=1)


def _add(vector: PETSc.Vec, rows: Indices, values: Array) -> None:
    """Add values to rows of any rank, but to rows ``-1``."""
    vector.setOption(PETSc.Vec.Option.IGNORE_NEGATIVE_INDICES, True)
    vector.setValues(
        rows.ravel().astype(PETSc.IntType), values.ravel(), addv=PETSc.InsertMode.ADD_VALUES
    )
