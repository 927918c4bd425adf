# SPDX-License-Identifier: MIT
"""Walks through UFL expressions and puts others in place of some of their parts."""

from __future__ import annotations

from abc import abstractmethod

from ufl.classes import Expr
from ufl.corealg.dag_traverser import DAGTraverser


class Replacing(DAGTraverser):
    """Rebuilds an expression from the leaves; call it with the expression."""

    @abstractmethod
    def replacement(self, o: Expr) -> Expr | None:
        """Return what stands in place of a part, ``None`` to look at what it is made of."""

    def process(self, o: Expr) -> Expr:
        """Rebuild one part."""
        found = self.replacement(o)
        return self.reuse_if_untouched(o) if found is None else found
