# SPDX-License-Identifier: MIT
"""How contact enters the equations: nodal forces, rows of the laws, and their derivatives.

The bulk is assembled from forms; the forms contain no contact. This module adds it in blocks: those
of one node are its stencil with its multipliers, for any kind of obstacle. The pairing gives the
kinematics and their derivatives, UFL those of the rows. The chain rule joins them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from ufl.algorithms import extract_coefficients
from ufl.core.expr import Expr

from ..base.collective import any_rank
from ..base.errors import ContactInputError
from ..contact.contact import Contact
from ..obstacles.following import all_still
from ..obstacles.kinematics import Array
from ..obstacles.reaction import body_rows
from ..obstacles.rigid_body import RigidBody
from ..obstacles.rigid_pairing import RigidPairing
from ..surfaces.nodal_kernel import NodalKernel
from .blocks import Blocks, Places, derivatives_of
from .conditions import constrained_dofs, with_conditions
from .numbering import global_dofs, num_owned

Indices = npt.NDArray[np.int64]


@dataclass(eq=False)
class Law:
    """The rows of one kind of substep at the nodes of each contact.

    Attributes:
        kernels: One for each contact; by the kinematics, the multipliers, then ``others``.
        others: Further unknowns that the rows of each contact depend on.
    """

    kernels: list[NodalKernel]
    others: list[list[int]] = field(default_factory=list)


class ContactTerms:
    """The blocks of all contacts of a problem; methods are collective.

    Args:
        contacts: The contacts.
        unknowns: All unknowns of the problem, the displacement first, the multipliers last.
        bcs: All boundary conditions.
        rows: Rows of the local dofs of each unknown, -1 for those left out; by default those of
            the system of all unknowns.
    """

    def __init__(
        self,
        contacts: Sequence[Contact],
        unknowns: Sequence[fem.Function],
        bcs: Sequence[fem.DirichletBC],
        rows: Sequence[Indices] | None = None,
    ) -> None:
        self._contacts, self._unknowns, self._bcs = contacts, list(unknowns), bcs
        self._u, self._comm = unknowns[0], unknowns[0].function_space.mesh.comm
        spaces = [f.function_space for f in unknowns]
        owned = [num_owned(f) for f in unknowns]
        self._num_rows = sum(owned)
        self._all_rows = global_dofs(spaces) if rows is None else list(rows)
        self._rows = [numbers.copy() for numbers in self._all_rows]
        for V, free in zip(spaces, self._rows, strict=True):
            free[constrained_dofs(V, bcs)] = -1
        self._stencils: dict[tuple[object, int], tuple[int, Indices]] = {}
        self._sizes = owned

    @property
    def versions(self) -> tuple[int, ...]:
        """Numbers that change with the stencils, one a contact."""
        return tuple(k.pairing.version for k in self._contacts)

    def still(self) -> AbstractContextManager[None]:
        """Evaluate the kinematics once for all inside, where nothing may move; collective."""
        return all_still(k.pairing for k in self._contacts)

    def law(self, rows: Callable[[Contact], Expr]) -> Law:
        """Compile the rows of a kind of substep with their derivatives."""
        law = Law([])
        for k in self._contacts:
            expression = rows(k)
            found = set(extract_coefficients(expression))
            others = [i for i, f in enumerate(self._others()) if f in found]
            if self._u in found or any(
                not k.surface.has_values_of(self._others()[i].function_space) for i in others
            ):
                raise ContactInputError(
                    f"The friction law of contact '{k.surface.name}' depends on an unknown without "
                    "a dof at each contact node, or on the displacement itself; take a continuous "
                    "Lagrange space, and what Sliding has of the displacement."
                )
            by = [k.pairing.field, k.c, *(self._others()[i] for i in others)]
            law.kernels.append(NodalKernel(k.surface, expression, by))
            law.others.append(others)
        return law

    def _unknown_of(self, body: RigidBody) -> int:
        """Return which unknown is the motion of a body."""
        return next(i for i, f in enumerate(self._unknowns) if f is body.q)

    def _others(self) -> list[fem.Function]:
        """Return the unknowns beside displacement and multipliers."""
        return self._unknowns[1 : len(self._unknowns) - len(self._contacts)]

    # -- residual --------------------------------------------------------------------------------

    def momentum(self) -> Array:
        """Return the residual forces of contact (N) at the owned dofs, held ones included."""
        return self.balance()[0]

    def balance(self) -> list[Array]:
        """Return the same for each unknown of the bulk, the motions of rigid bodies, too."""
        vector = PETSc.Vec().createMPI((self._num_rows, None), comm=self._comm)
        self._add_forces(vector, "all")
        ends = np.cumsum(self._sizes[: len(self._sizes) - len(self._contacts)])
        values = np.split(vector.array[: ends[-1]].copy(), ends[:-1])
        vector.destroy()
        return values

    def residuals(self, law: Law) -> list[Array]:
        """Return the rows of the laws times the nodal areas, one array for each contact.

        They are those of the last :meth:`update`.
        """
        return [
            kernel.values() * k.nodal_area()[:, None]
            for k, kernel in zip(self._contacts, law.kernels, strict=True)
        ]

    def add_residual(self, b: PETSc.Vec, law: Law) -> None:
        """Add forces and rows to an assembled residual."""
        self._add_forces(b, "free")
        c_rows = self._rows[len(self._rows) - len(self._contacts) :]
        for k, values, rows in zip(self._contacts, self.residuals(law), c_rows, strict=True):
            add_rows(b, k.pairing.side.nodal_entries(rows), values)
        b.assemble()

    def lift(self, b: PETSc.Vec, law: Law) -> None:
        """Lift Dirichlet values that the unknowns do not have yet, as in the forms.

        Until Newton reaches a prescribed value, its missing part acts on the neighbours.
        """
        with np.errstate(invalid="ignore"):  # Newton may have gone to infinity
            missing = [with_conditions(f, self._bcs) - f.x.array for f in self._unknowns]
        if any_rank(self._comm, any(bool(np.any(m != 0.0)) for m in missing)):
            for i, (blocks, places) in enumerate(
                zip(self.matrices(law), self.places(law), strict=True)
            ):
                steps = self.at_blocks(i, law, missing, 0.0)
                for values, (rows, _), (_, step) in zip(blocks, places, steps, strict=True):
                    add_rows(b, rows, np.einsum("nij,nj->ni", values, step))
        b.assemble()

    def _add_forces(self, vector: PETSc.Vec, kind: str) -> None:
        """Subtract the nodal forces of contact from the momentum balance, of free rows or all."""
        target = self._rows if kind == "free" else self._all_rows
        for i, k in enumerate(self._contacts):
            forces = -k.pairing.forces(k.nodal_area()[:, None] * k.multipliers())
            rows = self._kept(kind, i, partial(k.pairing.gather, target[0], missing=-1))
            add_rows(vector, rows[:, : forces.shape[1]], forces)
            if isinstance(k.pairing, RigidPairing) and (body := k.pairing.body) is not None:
                shares, rows = body_rows(k.pairing, body), target[self._unknown_of(body)]
                add_rows(vector, np.tile(rows, (len(shares), 1)), shares)
        vector.assemble()

    def _kept(self, what: object, i: int, find: Callable[[], Any]) -> Any:
        """Return rows of a contact's blocks, found again only when its stencils have changed."""
        version = self._contacts[i].pairing.version
        known = self._stencils.get((what, i))
        if known is None or known[0] != version:
            known = self._stencils[what, i] = version, find()
        return known[1]

    # -- Jacobian --------------------------------------------------------------------------------

    def places(self, law: Law) -> list[Blocks[Places]]:
        """Return the numbers of the rows and columns of the blocks of each contact."""
        return [
            self._kept(law, i, partial(self.at_blocks, i, law, self._rows, -1))
            for i in range(len(self._contacts))
        ]

    def at_blocks(
        self, i: int, law: Law, values: Sequence[npt.NDArray], missing: float
    ) -> Blocks[Places]:
        """Return the entries of arrays over the dofs of all unknowns, at a contact's blocks.

        Args:
            i: The contact.
            law: Its rows name the further unknowns.
            values: One array for each unknown.
            missing: Stands for points that a stencil does not have.
        """
        k, own = self._contacts[i], len(self._unknowns) - len(self._contacts)
        n = k.surface.num_owned
        around = k.pairing.gather(values[0], missing)
        stencil, loaded = (
            a.reshape(n, int(np.prod(a.shape[1:]))) for a in (around, around[:, : k.pairing.loaded])
        )
        c, others = k.pairing.side.nodal_entries(values[own + i]), []
        for j in law.others[i]:
            V = self._others()[j].function_space
            entries = values[1 + j].reshape(-1, V.dofmap.index_map_bs)
            others.append(entries[k.surface.parent_dofs(V)[:n]])
        turned = k.pairing.turned(values[0], missing)
        of_body = []
        if k.pairing.body is not None:
            q = np.tile(values[self._unknown_of(k.pairing.body)], (n, 1))
            of_body = [(stencil, q), (q, c), (q, stencil), (q, q)]
            others.append(q)
        return Blocks((c, np.hstack([stencil, c, *others])), (loaded, c), turned, of_body)

    def softness(self) -> list[Array]:
        """Return the scale of each node's rows over that of the certificate, of each contact.

        A scale that was given counts as that of the certificate.
        """
        parts = [(k, k.surface.num_owned) for k in self._contacts]
        ratios = [k.felt.x.array[:n] / k.scale.x.array[:n] for k, n in parts]
        return [a if k.r_p is None else np.ones(n) for a, (k, n) in zip(ratios, parts, strict=True)]

    def matrices(self, law: Law) -> list[Blocks[Array]]:
        """Return the values of the blocks of each contact, as in :meth:`places`."""
        return [
            derivatives_of(k, kernel) for k, kernel in zip(self._contacts, law.kernels, strict=True)
        ]


def add_rows(vector: PETSc.Vec, rows: Indices, values: Array) -> None:
    """Add values to rows of any rank; rows ``-1`` are left out."""
    vector.setOption(PETSc.Vec.Option.IGNORE_NEGATIVE_INDICES, True)
    vector.setValues(
        rows.ravel().astype(PETSc.IntType), values.ravel(), addv=PETSc.InsertMode.ADD_VALUES
    )
