# SPDX-License-Identifier: MIT
"""Checks of a problem's arguments, before anything is compiled."""

import re
from collections.abc import Mapping, Sequence

import ufl
from dolfinx import fem, mesh
from ufl.algorithms import expand_derivatives
from ufl.algorithms.check_arities import ArityMismatch, check_form_arity
from ufl.algorithms.remove_complex_nodes import remove_complex_nodes

from ..base.domains import check_terminals
from ..base.errors import ContactInputError
from ..base.validators import instances, kind, shown
from ..contact.checks import check_contact
from ..contact.contact import Contact
from ..surfaces.cells import check_cells
from ..surfaces.elements import check_displacement
from .conditions import check_conditions

#: Names that PETSc accepts for options.
PREFIX = re.compile(r"[A-Za-z][!-~]*")


def residuals(F: object) -> list[ufl.Form]:
    """Return the residuals as a list, or raise a ContactInputError."""
    return instances(F, ufl.Form, "F", "a residual in UFL that is linear in a test function")


def functions(u: object) -> list[fem.Function]:
    """Return the unknowns as a list, or raise a ContactInputError."""
    return instances(u, fem.Function, "u", "a dolfinx.fem.Function")


def contacts_of(contact: object) -> list[Contact]:
    """Return the contacts as a list, or raise a ContactInputError."""
    return instances(contact, Contact, "contact", "a Contact(surface, obstacle, friction)")


def conditions(bcs: object) -> list[fem.DirichletBC]:
    """Return the Dirichlet conditions as a list, or raise a ContactInputError."""
    bcs = [] if bcs is None else bcs
    return instances(bcs, fem.DirichletBC, "bcs", "a condition made with fem.dirichletbc")


def check_problem(
    blocks: Sequence[ufl.Form],
    unknowns: Sequence[fem.Function],
    contacts: Sequence[Contact],
    bcs: Sequence[fem.DirichletBC],
    prefix: object,
    petsc_options: object,
    entity_maps: object,
) -> None:
    """Raise a ContactInputError for arguments that cannot make a problem; collective."""
    _check_options(prefix, petsc_options)
    maps = [] if entity_maps is None else entity_maps
    maps = instances(maps, mesh.EntityMap, "entity_maps", "a dolfinx.mesh.EntityMap")
    if not contacts:
        raise ContactInputError("There is no contact: give at least one Contact.")
    if len(blocks) != len(unknowns) or not blocks:
        raise ContactInputError(
            f"{len(blocks)} residuals F for {len(unknowns)} unknowns u; give one for each."
        )
    if len({id(u) for u in unknowns}) != len(unknowns):
        raise ContactInputError("An unknown is given twice in u.")
    check_displacement(unknowns[0])
    maps += [k.surface.entity_map for k in contacts]
    for block, unknown in zip(blocks, unknowns, strict=True):
        _check_residual(block, unknown, maps)
    if unknowns[0] not in blocks[0].coefficients():
        raise ContactInputError(
            "F does not contain the displacement u: give the Function of which F is the residual."
        )
    if len({id(k) for k in contacts}) != len(contacts):
        raise ContactInputError("A Contact is given twice; make one for each obstacle.")
    for contact in contacts:
        check_contact(contact, unknowns[0])
    check_conditions(unknowns, bcs)
    check_cells(unknowns[0].function_space.mesh)


def _check_options(prefix: object, options: object) -> None:
    """Check the prefix of PETSc options, and the options."""
    if not isinstance(prefix, str) or not PREFIX.fullmatch(prefix):
        raise ContactInputError(
            f"petsc_options_prefix = {shown(prefix)} must be a string that begins with a letter "
            "and has no spaces; take e.g. 'block_'."
        )
    if options is None:
        return
    if not isinstance(options, Mapping):
        raise ContactInputError(
            f"petsc_options = {shown(options)} is {kind(options)}; give a dict such as "
            "{'pc_type': 'lu'}."
        )
    for key in options:
        if not isinstance(key, str) or not PREFIX.fullmatch(key):
            raise ContactInputError(
                f"petsc_options has the key {shown(key)}; keys are names of options without the "
                "leading '-', such as 'pc_type'."
            )


def _check_residual(block: ufl.Form, unknown: fem.Function, maps: Sequence[mesh.EntityMap]) -> None:
    """Check that a residual is a linear form of its unknown's test function, on its mesh."""
    arguments = block.arguments()
    if len(arguments) != 1:
        raise ContactInputError(
            f"A residual must be linear in one test function; this one has "
            f"{len(arguments)} arguments. Replace the trial function by u."
        )
    if arguments[0].ufl_function_space() != unknown.function_space:
        raise ContactInputError(
            "A residual's test function is not in its unknown's space; make it with "
            "ufl.TestFunction(u.function_space)."
        )
    msh = unknown.function_space.mesh
    related = [t for m in maps for t in (m.topology, m.sub_topology)]
    for integral in block.integrals():
        check_terminals(integral.integrand(), [msh, *related], "F")
    try:
        check_form_arity(remove_complex_nodes(expand_derivatives(block)), arguments)
    except (Exception, ArityMismatch) as error:
        message = f"F is not linear in its test function, or cannot be differentiated: {error}"
        raise ContactInputError(message) from error
