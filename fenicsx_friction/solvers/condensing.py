# SPDX-License-Identifier: MIT
"""The solvers of a problem; whether it can be solved on its boundary."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, mesh
from ufl.algorithms import extract_coefficients

from ..base.collective import any_rank
from ..base.compat import jacobian_blocks
from ..base.log import tell
from ..contact.contact import Contact
from ..equations.body_equation import bodies_of
from ..equations.contact_terms import ContactTerms
from ..equations.forces import ForceScales
from .boundary import BoundaryEquations
from .boundary_newton import BoundaryNewton
from .choice import linear_solvers_of, suits_boundary
from .condensed_bulk import Array, CondensedBulk
from .linear import direct_package
from .loaded_bodies import LoadedBodies
from .newton import Newton
from .options import DEFAULT_OPTIONS, SolverOptions
from .solvers import Solvers

#: Options of a user that start so ask for another way to solve the whole system.
OTHER_SOLVERS = ("ksp_", "pc_", "snes_type", "snes_mf", "snes_lag", "npc_")


def obstacle_to_condensing(
    blocks: Sequence[ufl.Form],
    unknowns: Sequence[fem.Function],
    contacts: Sequence[Contact],
    options: Mapping[str, object],
) -> str:
    """Say why a bulk cannot be condensed; empty if it can."""
    of_contact = [f for k in contacts for f in (k.c, k.pairing.field)]
    if any(f in extract_coefficients(block) for block in blocks for f in of_contact):
        return "the bulk depends on the contact"
    rows = [e for k in contacts for e in (k.rows.nodal, k.rows.own_row) if e is not None]
    if any(f in extract_coefficients(e) for e in rows for f in unknowns):
        return "a friction law depends on an unknown of the bulk"
    if any(
        name.startswith(OTHER_SOLVERS) and options[name] != DEFAULT_OPTIONS.get(name)
        for name in options
        if name != "pc_factor_mat_solver_type"
    ):
        return "petsc_options ask for another solver"
    return ""


def solvers_of(
    blocks: Sequence[ufl.Form],
    unknowns: Sequence[fem.Function],
    contacts: Sequence[Contact],
    bcs: Sequence[fem.DirichletBC],
    entity_maps: Sequence[mesh.EntityMap],
    options: SolverOptions,
    scales: ForceScales,
    terms: ContactTerms,
    residuals: Callable[[], Sequence[Array]],
    tangent: PETSc.Mat,
) -> Solvers:
    """Return the solvers of a problem; collective.

    Args:
        blocks: Residuals of the bulk and of rigid bodies that carry loads.
        unknowns: Their unknowns, displacement first, motions of rigid bodies last.
        contacts: The contacts.
        bcs: Dirichlet conditions.
        entity_maps: Entity maps of all meshes in the residuals.
        options: Options of the solvers.
        scales: Measures residuals.
        terms: How contact enters the equations.
        residuals: Returns the rows of the residuals at the owned dofs, without contact.
        tangent: Stiffness of the displacement; is used or destroyed.
    """
    own = options_for(contacts, options.given)
    state = [*unknowns, *(k.c for k in contacts)]
    reason = obstacle_to_condensing(blocks, unknowns, contacts, own)
    boundary, bodies = None, LoadedBodies(bodies_of(contacts))
    inside = list(unknowns[: len(unknowns) - len(bodies.motions)])
    if reason or len(inside) > 1:
        tangent.destroy()
    if not reason:
        all_options = {**DEFAULT_OPTIONS, **own}
        of_bulk = {
            k: v for k, v in all_options.items() if k in options.given or not k.startswith("mat_")
        }
        settings = (f"{options.prefix}bulk_", of_bulk, tangent if len(inside) == 1 else None)
        tangents = jacobian_blocks(blocks[: len(inside)], inside)
        bulk = CondensedBulk(tangents, inside, bcs, entity_maps, contacts, residuals, *settings)
        equations = BoundaryEquations(bulk, bodies, state, contacts, bcs)
        boundary = BoundaryNewton(equations, state, all_options, scales)
    small = boundary is not None and suits_boundary(boundary.equations.bulk, unknowns[0])
    linear_solvers = linear_solvers_of(options, inside, condensed=small)
    forms = [*blocks, *(place(k) for k in contacts)]
    full = Newton(
        forms, state, bcs, options.prefix, own, entity_maps, scales, terms, linear_solvers[0]
    )
    return Solvers(full, boundary, reason, linear_solvers)


def options_for(contacts: Sequence[Contact], options: Mapping[str, object]) -> dict[str, object]:
    """Return the PETSc options, with those that the machine and the contacts need; collective.

    The multipliers of nodes in several contacts are redundant where they stick: MUMPS then finds
    pivots that vanish, and takes one of the solutions. Where PETSc has no MUMPS, another package
    factors.
    """
    comm = contacts[0].surface.mesh.comm
    if (package := direct_package(comm.size)) != "mumps":
        tell(comm, logging.WARNING, "PETSc has no MUMPS here; %s factors in its place", package)
        options = {"pc_factor_mat_solver_type": package, **options}
    nodes = np.concatenate([np.unique(k.parent_dofs) for k in contacts])
    shared = any_rank(comm, len(np.unique(nodes)) < len(nodes))
    return {**({"mat_mumps_icntl_24": 1} if shared else {}), **options}


def place(contact: Contact) -> ufl.Form:
    """Return a form that holds the place of the rows of contact, which no form assembles."""
    nothing = fem.Constant(contact.surface.mesh, default_scalar_type(0.0))
    q = ufl.TestFunction(contact.surface.Q)
    return nothing * ufl.inner(contact.c, q) * contact.surface.measure()
