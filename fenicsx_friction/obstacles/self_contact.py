# SPDX-License-Identifier: MIT
"""Self-contact: a surface that may meet itself."""

from __future__ import annotations

from dataclasses import dataclass, field

from mpi4py import MPI

import numpy as np
from dolfinx import fem

from ..base.errors import ContactInputError
from ..surfaces.elements import nodal_on_facets
from ..surfaces.naming import named
from .against_faces import beside
from .averaged import DEEP
from .crossing import DEPTH, find_crossed
from .node_to_face import NodeToFace
from .obstacle import Obstacle
from .pairing import Mask
from .search import SearchPolicy
from .self_pairs import OVERLAP, SelfPairs
from .side import Side
from .two_bodies import Indices
from .view import View


@dataclass(frozen=True, eq=False)
class SelfContact(Obstacle):
    """The contact's own surface as its obstacle: folds that close, or many bodies of one surface.

    Each node may meet the faces of its own surface, node to face, but those round it and those on
    the far side of a body. Of two places that face each other one is secondary and meets the other:
    of two bodies the one with the finer faces there; on one body it is found anew in each step,
    closed nodes first, and follows a moving fold. All nodes carry multipliers; those that are not
    secondary are open. Faces of two places should match or be as fine as each other. Bodies must
    not overlap at the start.

    The displacement needs dofs at the vertices only: P1, Q1 or MINI. Edges that meet edges in 3D
    are out of scope.

    Attributes:
        search: How far the surface sees itself, see ``SearchPolicy``.
    """

    search: SearchPolicy | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check the policy."""
        if not isinstance(self.search, SearchPolicy | None):
            raise ContactInputError(
                f"SelfContact: search = {self.search!r} must be a SearchPolicy, or None."
            )

    def meet(self, side: Side) -> OneSurface:
        """Return the pairing of a side's nodes with its own faces; collective.

        Raises:
            ContactInputError: If the displacement has dofs on edges or faces, or the surface has
                nodes there, or nodes are inside another body.
        """
        if not nodal_on_facets(side.u.function_space) or side.surface.degree > 1:
            raise ContactInputError(
                f"Contact '{side.surface.name}': SelfContact is node to face and needs a "
                "displacement with dofs at the vertices only (P1, Q1 or MINI); it has "
                f"{side.u.function_space.ufl_element()}. Between two surfaces, DeformableObstacle "
                "takes any degree."
            )
        pairing = OneSurface(side.surface, self.search or SearchPolicy(), side)
        inside = pairing.inside_others()
        if number := side.surface.mesh.comm.allreduce(int(np.sum(inside)), MPI.SUM):
            raise ContactInputError(
                f"Contact '{side.surface.name}': {number} nodes are inside another body in the "
                f"undeformed mesh, by more than {OVERLAP:.0%} of a face"
                f"{named(side.surface, np.flatnonzero(inside))}. SelfContact "
                "needs bodies that touch or are apart: move them, call close_initial_gaps, or "
                "take two surfaces and DeformableObstacle(close_gaps=...)."
            )
        return pairing


class OneSurface(NodeToFace):
    """Nodes that meet faces of their own surface."""

    bondable = False
    _met = SelfPairs
    _history: SelfPairs

    def inside_others(self) -> Mask:
        """Tell which owned nodes are inside another body in the undeformed mesh; collective."""
        return self._history.inside_others()

    def started(self) -> Indices:
        """Return the face that each node had before it at the start of the step, or -1."""
        return self._history.before

    def view(self, u: fem.Function) -> View:
        """Return how the surface looks at itself; collective."""
        paired = self.pairs.paired
        gap = np.where(paired, self.gaps(), np.inf)
        return View(np.full(len(gap), -1.0), gap, np.zeros_like(gap))

    def crossed(self, closed: Mask) -> Mask:
        """Tell which nodes have gone through faces since the last step; collective.

        Nodes that meet nothing, as the other place meets them, are tested as roughly as the nodes
        of a primary surface are; those that have nothing before them, as sharply as others.
        """
        own, pairs = self._secondary.own, self._held_couples(closed)
        i, j = np.concatenate([pairs, pairs[:, ::-1]]).T
        mine = (i >= own.start) & (i < own.stop)
        met = beside(self.faces, i[mine] - own.start, j[mine], len(closed))
        primary = self._history.faces_something & ~self.pairs.paired
        part = np.where(primary, DEEP, DEPTH)
        nodes, faces = self._trails()
        pressed = self._pressed(closed)
        np.maximum.at(pressed, pairs[:, 1], pressed[pairs[:, 0]])  # what is met is pressed in, too
        of_face = self._deepest(pressed, self.faces.faces, self.faces.sizes)
        deep = of_face, self._deepest_nodes(pressed)
        motion = faces.seen_by(nodes, own, part, self._doubt, deep)
        return np.asarray(find_crossed(self.faces, motion, self.started(), met) >= 0)

    def pierced(self, closed: Mask) -> Mask:
        """Tell nothing: all nodes of the surface are tested by :meth:`crossed`."""
        return np.zeros(len(closed), dtype=bool)
