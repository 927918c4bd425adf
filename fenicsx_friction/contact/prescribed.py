# SPDX-License-Identifier: MIT
"""The frame of each node under boundary conditions: prescribed and free directions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import any_rank
from ..base.errors import ContactInputError
from ..certificate.nodal_state import NodalState
from ..obstacles.kinematics import Array
from ..obstacles.pairing import Pairing
from . import frame

#: A node touches at gaps below this fraction of its facets' size.
TOUCH = 1e-8
#: Largest sine of the angle between a held direction and the tangent plane: for rounding, for the
#: facets of a curved surface and averages over it, and for facets where both sides stay on a plane.
#: There nothing slips along the held direction, however the facets are inclined.
OBLIQUE, OBLIQUE_FACES, OBLIQUE_SYMMETRY = 1e-6, 0.3, 0.7


class Prescribed:
    """Knows the prescribed directions of a contact's nodes, and chooses their frames; collective.

    Args:
        pairing: What the nodes meet.
        free: 1 for the free directions of the contact frame, 0 for the prescribed ones; is set.
        held: 1 at the dofs of the displacement under a condition, else 0.
    """

    def __init__(self, pairing: Pairing, free: fem.Function, held: fem.Function) -> None:
        self._pairing, self._free, self._held = pairing, free, held
        self._side = side = pairing.side
        self._driven: Array = np.zeros(len(held.x.array))
        fixed = self._fixed_components()
        hints = side.hint.x.array.reshape(-1, side.d)
        hints[: len(fixed)] = frame.choose_hints(pairing.normals(), fixed)
        side.hint.x.scatter_forward()

    def start(self) -> None:
        """Remember how deep nodes are at the start, after pairs and frames are chosen."""
        self._overlap = np.maximum(-self._pairing.gaps(), 0.0) + touch(self._pairing)
        most = float(np.max(touch(self._pairing), initial=0.0))
        self._overlap_between = np.maximum(self._pairing.held_depths(self._held), 0.0) + most

    def choose(
        self, rough: Callable[[], npt.NDArray[np.bool_]], driven: Array | None = None
    ) -> None:
        """Choose again the prescribed directions of each frame, and its first tangent.

        A frame changes where the normal has turned or the node meets another face. Its multipliers
        turn with it.

        Args:
            rough: Tells which owned nodes may have friction; collective.
            driven: How far conditions move the dofs of the displacement in this step (m).

        Raises:
            ContactInputError: If a node is held in a direction that is neither normal nor
                tangential: friction and reaction could not be told apart.
        """
        side = self._side
        self._driven = self._driven if driven is None else driven
        fixed, normals = self._fixed_components(), self._pairing.normals().copy()
        most = OBLIQUE_FACES if self._pairing.tilted else OBLIQUE
        bad = frame.oblique(normals, fixed, most)
        if any_rank(side.surface.mesh.comm, bool(np.any(bad))):
            if self._pairing.deformable:
                resting = np.all(fixed == self._fixed_components(resting=True), axis=1)
                bad &= ~resting | frame.oblique(normals, fixed, OBLIQUE_SYMMETRY)
            self._refuse_oblique(bad & rough())
        free = np.where(frame.pinned_directions(normals, fixed), 0.0, 1.0)
        hints, kept = side.nodal(side.hint), side.nodal(self._free)
        changed = np.any(free != kept, axis=1)
        changed |= frame.steep_hints(normals, hints) & (fixed.sum(axis=1) != 1)
        if not any_rank(side.surface.mesh.comm, bool(np.any(changed))):
            return
        # A hint along the normal of another face gives no tangent: nothing is known of friction.
        c, traction = side.nodal(side.c), np.nan_to_num(self._pairing.traction())
        kept[:] = free
        hints[changed] = frame.choose_hints(normals, fixed)[changed]
        for f in (side.hint, self._free):
            f.x.scatter_forward()
        turned = np.einsum("nd,nkd->nk", traction, self._pairing.frames())
        c[changed, 1:] = turned[changed, 1:]
        c *= free
        side.c.x.scatter_forward()

    def pushed(self, state: NodalState) -> float:
        """Return how far conditions push held nodes into the obstacle (m), on this rank.

        The depth at the beginning does not count; it may come from the facets of a curved surface.
        """
        deeper = np.where(state.takes_part, 0.0, -state.gap - self._overlap)
        between = self._pairing.held_depths(self._held) - self._overlap_between
        return float(max(np.max(deeper, initial=0.0), np.max(between, initial=0.0)))

    def _refuse_oblique(self, nodes: npt.NDArray[np.bool_]) -> None:
        """Refuse nodes with friction that are held obliquely to the surface; collective."""
        surface, bad = self._side.surface, np.flatnonzero(nodes)
        where = [", ".join(f"{xi:.6g}" for xi in surface.x[i][: self._side.d]) for i in bad]
        found = [x for part in surface.mesh.comm.allgather(where) for x in part]
        if found:
            raise ContactInputError(
                f"Contact '{surface.name}': boundary conditions hold {len(found)} nodes in a "
                f"direction that is neither normal nor tangential to the obstacle, the first at "
                f"({found[0]}); their friction cannot be told from the reaction. Hold these nodes "
                "in whole, leave them out of the surface, or take Frictionless()."
            )

    def _fixed_components(self, *, resting: bool = False) -> npt.NDArray[np.bool_]:
        """Return, for each owned contact node, which Cartesian components are prescribed.

        Args:
            resting: Leave out the dofs that conditions move in this step.
        """
        still = (self._held.x.array > 0.5) & (self._driven == 0.0)
        held = self._held
        if resting:
            held = held.copy()
            held.x.array[:] = still
            held.x.scatter_forward()
        nodes = self._side.owned(held.x.array) > 0.5
        return self._pairing.prescribed(held, nodes, still)


def touch(pairing: Pairing) -> Array:
    """Return the gap (m) below which a node touches, for each owned node."""
    return TOUCH * pairing.side.facet_size()
