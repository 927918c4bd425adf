# SPDX-License-Identifier: MIT
"""The stiffness of the displacement, without contact and conditions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from petsc4py import PETSc

import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix
from ufl.algorithms import expand_derivatives, extract_coefficients

from ..base.compilation import compiled


class Stiffness:
    """Assembles it at the present state.

    Args:
        bulk: The momentum balance without contact.
        u: The displacement.
        entity_maps: Entity maps of all meshes in the balance.
    """

    def __init__(
        self, bulk: ufl.Form, u: fem.Function, entity_maps: Sequence[mesh.EntityMap]
    ) -> None:
        self._u, self._form, comm = u, ufl.derivative(bulk, u), u.function_space.mesh.comm
        self._compiled = compiled(fem.form, comm)(self._form, entity_maps=list(entity_maps))

    def assemble(self) -> PETSc.Mat:
        """Return the matrix (N/m), to be destroyed by the caller; collective."""
        matrix = assemble_matrix(self._compiled)
        matrix.assemble()
        return matrix

    @cached_property
    def linear(self) -> bool:
        """Whether it does not depend on the displacement."""
        return self._u not in extract_coefficients(expand_derivatives(self._form))
