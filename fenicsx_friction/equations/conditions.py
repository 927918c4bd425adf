# SPDX-License-Identifier: MIT
"""Queries of Dirichlet conditions: which dofs they hold, and at which values."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import largest_of_ranks
from ..base.compat import bc_space_contains, unrolled_bc_dofs
from ..base.errors import ContactInputError


def check_conditions(unknowns: Sequence[fem.Function], bcs: Sequence[fem.DirichletBC]) -> None:
    """Raise a ContactInputError if a condition holds nothing; collective.

    A condition may have no dofs on some ranks, but not on all.
    """
    for i, bc in enumerate(bcs):
        if not any(bc_space_contains(u.function_space, bc) for u in unknowns):
            raise ContactInputError(
                f"bcs[{i}] is on a space that is none of the unknowns', nor a part of one: it "
                "would be ignored. Make it on u.function_space itself (an equal space made again "
                "or a collapsed part is another), for one component on u.function_space.sub(k)."
            )
    counts = unknowns[0].function_space.mesh.comm.allgather([len(unrolled_bc_dofs(b)) for b in bcs])
    if len({len(count) for count in counts}) > 1:
        raise ContactInputError("bcs has different lengths on the ranks; give all on each rank.")
    for i, total in enumerate(np.sum(counts, axis=0) if bcs else []):
        if total == 0:
            raise ContactInputError(
                f"bcs[{i}] has no dofs on any rank, so that it holds nothing; check where its dofs "
                "were located."
            )


def constrained_dofs(V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]) -> npt.NDArray[np.int32]:
    """Return the dofs of ``V`` (local, unrolled) under a condition."""
    dofs = [unrolled_bc_dofs(bc) for bc in bcs if bc_space_contains(V, bc)]
    return np.unique(np.concatenate(dofs)) if dofs else np.empty(0, dtype=np.int32)


def constrained(V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]) -> fem.Function:
    """Return a Function that is 1 at the dofs under a condition of any rank, else 0; collective."""
    held = fem.Function(V)
    held.x.array[constrained_dofs(V, bcs)] = 1.0
    held.x.scatter_forward()
    return held


def with_conditions(f: fem.Function, bcs: Sequence[fem.DirichletBC]) -> npt.NDArray[np.floating]:
    """Return the local values of ``f`` with the conditions' values set."""
    values = f.x.array.copy()
    for bc in bcs:
        if bc_space_contains(f.function_space, bc):
            bc.set(values)
    return values


def missed_values(unknowns: Sequence[fem.Function], bcs: Sequence[fem.DirichletBC]) -> float:
    """Return how far unknowns are from their Dirichlet values, relative; collective."""
    worst = 0.0
    for f in unknowns:
        values = with_conditions(f, bcs)
        # Not a number on one rank is infinite on all.
        local = np.array([np.max(abs(a), initial=0.0) for a in (values - f.x.array, values)])
        missed, largest = largest_of_ranks(f.function_space.mesh.comm, local)
        worst = max(worst, missed / largest if 0.0 < largest < np.inf else missed)
    return float(worst)
