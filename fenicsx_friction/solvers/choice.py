# SPDX-License-Identifier: MIT
"""Which linear solver a problem takes for its whole system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from dolfinx import fem

from ..base.errors import ContactInputError
from ..surfaces.nodal_dofs import is_nodal
from .condensed_bulk import CondensedBulk
from .options import SolverOptions

LinearSolver = Literal["auto", "direct", "multigrid"]

#: Displacements in 3D above which multigrid is the cheaper way.
MULTIGRID_FROM = 10_000
#: Up to so many displacements in contact, solving on the boundary is the cheaper way, and in 3D up
#: to so many displacements in all: the memory of a factor grows with their power 4/3.
MOST_DOFS, MOST_IN_3D = 4000, 100_000
#: Up to so many displacements in 3D, a factor follows where multigrid failed (some 6 GiB).
FACTORED_UP_TO = 150_000


def linear_solvers_of(
    options: SolverOptions, unknowns: Sequence[fem.Function], *, condensed: bool
) -> list[str]:
    """Return ``direct``, ``multigrid``, or both: what is to be tried, in this order.

    Args:
        options: Options of the solvers.
        unknowns: Those of the bulk, displacement first, without motions of rigid bodies.
        condensed: Whether steps are solved on the boundary if nothing else is asked for.

    Raises:
        ContactInputError: If multigrid is asked for and not possible.
    """
    asked = options.linear_solver
    reason = _obstacle_to_multigrid(asked, unknowns, options.given)
    if asked == "multigrid" and reason:
        raise ContactInputError(f"linear_solver = 'multigrid': {reason}; take 'direct'.")
    if asked != "auto":
        return [asked]
    size, solid = _size(unknowns[0])
    if size <= MULTIGRID_FROM or not solid or reason or condensed:
        return ["direct"]
    return ["multigrid", "direct"] if size <= FACTORED_UP_TO else ["multigrid"]


def suits_boundary(bulk: CondensedBulk, u: fem.Function) -> bool:
    """Tell whether a bulk is to be factored once, and its steps solved on the boundary."""
    size, solid = _size(u)
    most = MOST_IN_3D if solid else np.inf
    return bulk.linear and bulk.size <= MOST_DOFS and size <= most


def _size(u: fem.Function) -> tuple[int, bool]:
    """Return the number of displacements, and whether they are those of a model in 3D."""
    V = u.function_space
    return V.dofmap.index_map.size_global * V.dofmap.index_map_bs, V.mesh.geometry.dim == 3


def _obstacle_to_multigrid(
    asked: str, unknowns: Sequence[fem.Function], options: Mapping[str, object]
) -> str:
    """Say why there can be no multigrid; empty if there can."""
    if len(unknowns) > 1:
        return "it solves for displacements and contact tractions only, and there are more unknowns"
    if not is_nodal(unknowns[0].function_space):
        return (
            f"it knows displacements with values at the vertices only, not "
            f"{unknowns[0].function_space.ufl_element()}"
        )
    others = ("pc_",) if asked == "multigrid" else ("pc_", "ksp_type")
    if found := [name for name in options if name.startswith(others)]:
        return (
            f"petsc_options has '{found[0]}', which asks for another solver (options of the "
            "V-cycle begin with 'multigrid_', such as 'multigrid_pc_gamg_threshold')"
        )
    return ""
