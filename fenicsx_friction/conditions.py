# SPDX-License-Identifier: MIT
"""What Dirichlet conditions, on a space or on parts of it, say of its dofs."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from .compat import bc_space_contains, unrolled_bc_dofs


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
