# SPDX-License-Identifier: MIT
"""Checks of a problem's arguments, before anything is compiled."""

from collections.abc import Sequence

import ufl
from dolfinx import fem

from .contact import Contact
from .errors import ContactInputError


def check_problem(
    blocks: Sequence[ufl.Form],
    unknowns: Sequence[fem.Function],
    contacts: Sequence[Contact],
    prefix: str,
) -> None:
    """Raise a ContactInputError for what can be seen from the arguments."""
    if not prefix:
        raise ContactInputError("petsc_options_prefix must not be empty; take e.g. 'block_'.")
    if not contacts:
        raise ContactInputError("There is no contact: give at least one Contact.")
    if len(blocks) != len(unknowns):
        raise ContactInputError(f"{len(blocks)} residuals F for {len(unknowns)} unknowns u.")
    V, gdim = unknowns[0].function_space, unknowns[0].function_space.mesh.geometry.dim
    if V.dofmap.index_map_bs != gdim:
        raise ContactInputError(
            f"The displacement has {V.dofmap.index_map_bs} components in {gdim} dimensions."
        )
    for block, unknown in zip(blocks, unknowns, strict=True):
        if len(block.arguments()) != 1:
            raise ContactInputError(
                f"A residual must be linear in one test function; this one has "
                f"{len(block.arguments())} arguments. Replace the trial function by u."
            )
        if block.arguments()[0].ufl_function_space() != unknown.function_space:
            raise ContactInputError("A residual's test function is not in its unknown's space.")
    for contact in contacts:
        if contact.surface.mesh is not V.mesh:
            raise ContactInputError(
                f"Contact surface '{contact.surface.name}' lies on another mesh than u."
            )
