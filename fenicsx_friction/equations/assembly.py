# SPDX-License-Identifier: MIT
"""Linear forms assembled to the values of the owned dofs."""

import weakref
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from dolfinx import fem
from dolfinx.la import InsertMode

S = TypeVar("S")
T = TypeVar("T")


def weakly(owner: S, work: Callable[[S], T]) -> Callable[[], T]:
    """Return work on an object, without a reference cycle, see ``Callbacks``."""
    there = weakref.ref(owner)
    return lambda: work(there())  # type: ignore[arg-type]


def assemble_owned(form: fem.Form) -> np.ndarray:
    """Assemble a linear form and return the values of the owned dofs."""
    vector = fem.assemble_vector(form)
    vector.scatter_reverse(InsertMode.add)
    return np.asarray(vector.array[: vector.index_map.size_local * vector.block_size])
