# SPDX-License-Identifier: MIT
"""The rows of the equations at the present state, at the owned dofs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.la import InsertMode

from ..base.compilation import compiled
from ..base.groups import Array
from .contact_terms import ContactTerms


class Balance:
    """Assembles them; methods are collective.

    Args:
        blocks: The residuals without contact, the momentum balance first, rigid bodies last.
        unknowns: Their unknowns.
        terms: How contact enters the equations.
        bodies: Number of the rigid bodies.
        entity_maps: Entity maps of all meshes in the residuals.
    """

    def __init__(
        self,
        blocks: Sequence[ufl.Form],
        unknowns: Sequence[fem.Function],
        terms: ContactTerms,
        bodies: int,
        entity_maps: Sequence[mesh.EntityMap],
    ) -> None:
        make = compiled(fem.form, unknowns[0].function_space.mesh.comm)
        self._forms = [make(f, entity_maps=list(entity_maps)) for f in blocks]
        self._fields = list(unknowns[: len(unknowns) - bodies])
        self._terms = terms

    def momentum(self) -> Array:
        """Return the unbalanced nodal forces (N), reactions at prescribed dofs."""
        return assemble_owned(self._forms[0]) + self._terms.momentum()

    def rows(self) -> list[Array]:
        """Return all rows."""
        parts = zip(self.without_contact(), self._terms.balance(), strict=True)
        return [bulk + contact for bulk, contact in parts]

    def without_contact(self) -> list[Array]:
        """Return all rows but for the forces of contact."""
        return [assemble_owned(f) for f in self._forms]

    def loads(self) -> Array:
        """Return the forces (N) on the bulk where all its unknowns are zero."""
        kept = [f.x.array.copy() for f in self._fields]
        try:
            for f in self._fields:
                f.x.array[:] = 0.0
            return assemble_owned(self._forms[0])
        finally:
            for f, values in zip(self._fields, kept, strict=True):
                f.x.array[:] = values


def assemble_owned(form: fem.Form) -> Array:
    """Assemble a linear form and return the values of the owned dofs."""
    vector = fem.assemble_vector(form)
    vector.scatter_reverse(InsertMode.add)
    return np.asarray(vector.array[: vector.index_map.size_local * vector.block_size])
