# SPDX-License-Identifier: MIT
"""Raous' rectangle: the exact discrete solution beside a history."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenicsx_friction.verification.exact import ExactReference
from fenicsx_friction.verification.soclcp import NoExactSolution
from raous_options import Options
from raous_results import ContactLine, exact_line

if TYPE_CHECKING:
    from demo_raous_rectangle import Block


class Exact:
    """The exact solution beside a history, until an increment has none."""

    def __init__(self, block: Block) -> None:
        self.block = block
        self.reference: ExactReference | None = ExactReference(block.problem)
        self.scales = (0.0, 0.0)

    def advance(self, options: Options, factors: tuple[float, float]) -> ContactLine | None:
        """Return the exact contact line of the next increment."""
        if self.reference is None:
            return None
        self.block.load(options, factors)
        try:
            solution = self.reference.advance()
        except NoExactSolution:
            self.reference = None
            return None
        largest = (float(np.max(abs(solution.c))), float(np.max(abs(solution.u))))
        self.scales = (max(self.scales[0], largest[0]), max(self.scales[1], largest[1]))
        return exact_line(self.block.problem.contacts[0], solution)
