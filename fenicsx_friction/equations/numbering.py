# SPDX-License-Identifier: MIT
"""Numbers of dofs in the system of all unknowns."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.la import InsertMode

from ..contact.contact import Contact
from .conditions import constrained_dofs

Indices = npt.NDArray[np.int64]


def global_dofs(spaces: Sequence[fem.FunctionSpace]) -> list[Indices]:
    """Return, for the local dofs (with ghosts) of each space, their rows in the blocked system."""
    maps = [(V.dofmap.index_map, V.dofmap.index_map_bs) for V in spaces]
    next_row = sum(m.local_range[0] * bs for m, bs in maps)
    rows = []
    for V, (m, bs) in zip(spaces, maps, strict=True):
        rows.append(spread(V, np.arange(m.size_local * bs), next_row))
        next_row += m.size_local * bs
    return rows


def spread(V: fem.FunctionSpace, owned: Indices, first: int) -> Indices:
    """Number some owned dofs; return the numbers of all local dofs, -1 without; collective."""
    numbers = fem.Function(V, dtype=np.float64)
    numbers.x.array[:] = -1.0
    numbers.x.array[owned] = first + np.arange(len(owned))
    numbers.x.scatter_forward()
    return np.rint(numbers.x.array).astype(np.int64)


def num_owned(f: fem.Function) -> int:
    """Return the number of owned dofs of a Function."""
    return int(f.function_space.dofmap.index_map.size_local * f.function_space.dofmap.index_map_bs)


def contact_dofs(contacts: Sequence[Contact], V: fem.FunctionSpace) -> Indices:
    """Return the owned dofs of the displacement at the nodes of all surfaces; collective.

    They ascend. Another rank may own the node of the surface than owns the dof.
    """
    marked = fem.Function(V, dtype=np.float64)
    values = marked.x.array.reshape(-1, V.dofmap.index_map_bs)
    for k in contacts:
        values[k.parent_dofs[: k.surface.num_owned]] = 1.0
        values[k.pairing.partners(V)] = 1.0
    marked.x.scatter_reverse(InsertMode.add)
    return np.flatnonzero(marked.x.array[: num_owned(marked)] > 0.0).astype(np.int64)


def held_rows(unknowns: Sequence[fem.Function], bcs: Sequence[fem.DirichletBC]) -> list[Indices]:
    """Return the owned rows of each unknown that are conditions, counted from this rank's first."""
    found, at = [], 0
    for f in unknowns:
        dofs = constrained_dofs(f.function_space, bcs).astype(np.int64)
        found.append(at + dofs[dofs < num_owned(f)])
        at += num_owned(f)
    return found
