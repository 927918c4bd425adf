# SPDX-License-Identifier: MIT
"""What forms depend on, so that matrices need not be made again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem
from ufl.algorithms import extract_coefficients
from ufl.algorithms.analysis import extract_constants

from ..obstacles.kinematics import Array


class Dependencies:
    """Fields, Constants and meshes of some forms.

    Args:
        forms: The forms, expanded; ``None`` where there is none.
    """

    def __init__(self, forms: Sequence[Sequence[ufl.Form | None]]) -> None:
        parts = [form for row in forms for form in row if form is not None]
        fields = {f for form in parts for f in extract_coefficients(form)}
        numbers = {c for form in parts for c in extract_constants(form)}
        domains = {d for form in parts for d in form.ufl_domains()}
        self._fields = sorted(fields, key=lambda f: f.count())
        self._numbers = sorted(numbers, key=lambda c: c.count())
        self._meshes = [d.ufl_cargo() for d in sorted(domains, key=lambda d: d.ufl_id())]

    def include(self, functions: Sequence[fem.Function]) -> bool:
        """Tell whether the forms depend on one of some Functions."""
        return any(f in self._fields for f in functions)

    def values(self) -> list[Array]:
        """Return all values that the forms depend on; they may change in place."""
        return [
            *(f.x.array for f in self._fields),
            *(np.asarray(c.value) for c in self._numbers),
            *(m.geometry.x for m in self._meshes),
        ]
