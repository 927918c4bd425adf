# SPDX-License-Identifier: MIT
"""Deformable obstacles: the surface of another body."""

from dataclasses import dataclass, field

from ..base.errors import ContactInputError
from ..surfaces.elements import nodal_on_facets
from ..surfaces.surface import ContactSurface
from .mortar import Mortar
from .node_to_face import NodeToFace
from .obstacle import Obstacle
from .search import SearchPolicy, check_positive
from .side import Side
from .two_bodies import TwoBodies


@dataclass(frozen=True, eq=False)
class DeformableObstacle(Obstacle):
    """The surface of a deformable body (the primary surface) as an obstacle.

    The nodes of the contact's own surface (the secondary one, which should be the finer) meet the
    faces of this one. Each node meets one face at a time; pairs are found at the beginning of a
    step and again after it was solved, until they do not change, see ``SearchPolicy``.

    Attributes:
        primary: The primary surface, on the same mesh.
        search: How pairs are found.
        close_gaps: Gaps and overlaps of the undeformed bodies up to this (m) count as closed: what
            a node has there is subtracted from its gap for good. No node of the mesh is moved, so
            walls stay as thick as they are (see ``close_initial_gaps``). Without it, gaps are
            what they are.
    """

    primary: ContactSurface
    search: SearchPolicy | None = field(default=None, kw_only=True)
    method: str | None = field(default=None, kw_only=True)
    close_gaps: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check surface and policy."""
        if not isinstance(self.primary, ContactSurface):
            raise ContactInputError(
                f"DeformableObstacle: primary = {self.primary!r} must be a ContactSurface, the "
                "surface of the other body."
            )
        if not isinstance(self.search, SearchPolicy | None):
            raise ContactInputError(
                f"DeformableObstacle: search = {self.search!r} must be a SearchPolicy, or None."
            )
        if self.close_gaps is not None:
            meaning = "the largest gap or overlap (m) that counts as closed at the start"
            check_positive(self.close_gaps, "close_gaps", meaning)

    def meet(self, side: Side) -> TwoBodies:
        """Return the pairing of a side's nodes with the faces; collective.

        Raises:
            ContactInputError: If the displacement has dofs on edges or faces.
        """
        if self.method != "mortar" and not nodal_on_facets(side.u.function_space):
            raise ContactInputError(
                f"The displacement, of {side.u.function_space.ufl_element()}, has dofs on edges or "
                "facets; contact between deformable bodies is node to face and needs P1, Q1 or "
                "MINI. Against rigid obstacles any degree works."
            )
        kind = Mortar if self.method == "mortar" else NodeToFace
        pairing = kind(self.primary, self.search or SearchPolicy(), side)
        if self.close_gaps is not None:
            pairing.close_gaps(self.close_gaps)
        return pairing
