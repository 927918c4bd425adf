# SPDX-License-Identifier: MIT
"""Which linear solver a problem takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import ufl
from dolfinx import fem

from ..base.validators import choice

LinearSolver = Literal["auto", "direct", "multigrid"]


def linear_solver_of(
    asked: LinearSolver,
    blocks: Sequence[ufl.Form],
    unknowns: Sequence[fem.Function],
    options: Mapping[str, object],
) -> str:
    """Return ``direct`` or ``multigrid``."""
    choice(asked, "linear_solver", ("auto", "direct", "multigrid"))
    return "direct" if asked == "auto" else asked
