# SPDX-License-Identifier: MIT
"""Deformable obstacles: the surface of another body."""

from dataclasses import dataclass, field

from dolfinx import fem

from ..base.errors import ContactInputError
from ..base.validators import number
from ..surfaces.elements import nodal_on_facets
from ..surfaces.faces import FaceSet
from ..surfaces.surface import ContactSurface
from .matching import faces_match, shared_nodes
from .mortar import Mortar
from .node_to_face import NodeToFace
from .obstacle import Obstacle
from .search import SearchPolicy, check_positive
from .side import Side
from .two_bodies import TwoBodies

METHODS: dict[str, type[TwoBodies]] = {"mortar": Mortar, "node-to-face": NodeToFace}


@dataclass(frozen=True, eq=False)
class DeformableObstacle(Obstacle):
    """The surface of a deformable body (the primary surface) as an obstacle.

    With ``"mortar"``, the nodes of the contact's own surface (the secondary one) meet this one on
    average over the parts of both that face each other. It is exact for uniform pressures whatever
    the faces, takes displacements of any degree, and costs more. With ``"node-to-face"`` each node
    meets one face, which is as exact where the faces match and stay so. What the nodes meet is
    found at the beginning of a step and again after it was solved, until it does not change.

    Attributes:
        primary: The primary surface, on the same mesh.
        search: How far surfaces see each other, see ``SearchPolicy``.
        method: ``"mortar"``, ``"node-to-face"``, or ``None``: node to face where the faces match at
            the start and have dofs at their vertices only, or are rings, else mortar.
        close_gaps: Gaps and overlaps of the undeformed bodies up to this (m) count as closed: what
            a node has there is subtracted from its gap for good. No node of the mesh is moved, so
            walls stay as thick as they are (see ``close_initial_gaps``). Without it, gaps are
            what they are.
        clearance: What is added to all gaps (m): a number, or a Constant that changes from step to
            step. Negative, it is an interference: a shrink fit or a bolt, closed as gradually
            as its value is set.
    """

    primary: ContactSurface
    search: SearchPolicy | None = field(default=None, kw_only=True)
    method: str | None = field(default=None, kw_only=True)
    close_gaps: float | None = field(default=None, kw_only=True)
    clearance: float | fem.Constant = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        """Check surface, policy and method."""
        if not isinstance(self.primary, ContactSurface):
            raise ContactInputError(
                f"DeformableObstacle: primary = {self.primary!r} must be a ContactSurface, the "
                "surface of the other body."
            )
        if not isinstance(self.search, SearchPolicy | None):
            raise ContactInputError(
                f"DeformableObstacle: search = {self.search!r} must be a SearchPolicy, or None."
            )
        if self.method is not None and self.method not in METHODS:
            raise ContactInputError(
                f"DeformableObstacle: method = {self.method!r} must be one of "
                f"{', '.join(METHODS)}, or None."
            )
        if self.close_gaps is not None:
            meaning = "the largest gap or overlap (m) that counts as closed at the start"
            check_positive(self.close_gaps, "close_gaps", meaning)

        given = self.clearance
        value = given.value[()] if isinstance(given, fem.Constant) else given
        number(value, "clearance (m)")

    def meet(self, side: Side) -> TwoBodies:
        """Return the pairing of a side's nodes with this surface; collective.

        Raises:
            ContactInputError: If node to face is wanted of a displacement with dofs on edges or
                faces.
        """
        self._check_rings(side.surface)
        policy, nodal = self.search or SearchPolicy(), nodal_on_facets(side.u.function_space)
        if self.method == "node-to-face" and not nodal:
            raise ContactInputError(
                f"The displacement, of {side.u.function_space.ufl_element()}, has dofs on edges or "
                'facets; method="node-to-face" needs P1, Q1 or MINI. Take method="mortar".'
            )
        method = "node-to-face" if side.surface.axisymmetric else self.method
        if method is None:
            method = "node-to-face" if nodal and self._matches(side, policy) else "mortar"
        pairing = METHODS[method](self.primary, policy, side)
        pairing.clearance = self.clearance
        if self.close_gaps is not None:
            pairing.close_gaps(self.close_gaps)
        return pairing

    def _check_rings(self, secondary: ContactSurface) -> None:
        """Raise unless both surfaces are axisymmetric, or none, and node to face is possible."""
        names = f"'{secondary.name}' and '{self.primary.name}'"
        if secondary.axisymmetric != self.primary.axisymmetric:
            raise ContactInputError(f"Of the surfaces {names} only one is axisymmetric.")
        if secondary.axisymmetric and self.method == "mortar":
            raise ContactInputError(
                f"The surfaces {names} are axisymmetric: mortar does not weigh with the radius; "
                'take method="node-to-face".'
            )

    def _matches(self, side: Side, policy: SearchPolicy) -> bool:
        """Tell whether the faces of both surfaces match; collective."""
        if shared_nodes(side.surface, self.primary, side.u.function_space):
            return False  # a node has no gap to itself
        ours, theirs = FaceSet(side.surface, side.u), FaceSet(self.primary, side.u)
        return faces_match(ours, theirs, policy.distance(theirs))
