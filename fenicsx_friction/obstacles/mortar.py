# SPDX-License-Identifier: MIT
"""Mortar: nodes meet another body on average over the parts of the surfaces that face each other.

The parts are found anew after each solve, as the faces of node-to-face contact are; within a solve
they do not change.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from ..base.collective import on_all_ranks
from ..surfaces.surface import ContactSurface
from .averaged import DEEP, Averaged
from .dual_hats import weights_of
from .edges import Edges
from .facing import Facing, Positions
from .kinematics import Array
from .mortar_element import MortarElement
from .pairing import Mask
from .search import SearchPolicy
from .segments import Segments, find_segments
from .shares import find_shares
from .side import Side
from .two_bodies import Indices, TwoBodies

#: The surfaces see the same as long as no node moves by more than this fraction of a face. By less,
#: points on warped faces go to and fro: where edges fall on each other, they depend on rounding.
STILL = 1e-6


class Mortar(Averaged, TwoBodies):
    """Nodes that meet another body on average.

    A stencil are the displacement's dofs of the faces round the node, of the faces that they see,
    and of those that they saw at the start of the step.

    Args:
        primary: The primary surface.
        policy: How far the surfaces see each other: its ``reach``.
        side: The secondary side.
    """

    behind, early = DEEP, True
    #: What :meth:`save` keeps: objects that are replaced, never changed.
    _STATE = ("_element", "_seen_at", "_start", "_axis", "version")

    def __init__(self, primary: ContactSurface, policy: SearchPolicy, side: Side) -> None:
        super().__init__(primary, policy, side)
        self._facing = Facing((side.surface, primary), side.u.function_space)
        n = side.surface.num_owned
        self._own = self._facing.secondary.rows.places_of_local(side.parent_dofs[:n])
        # Where hats are given away, the faces round the nodes that take them count, too.
        self._wanted = self._facing.patches_near(self._secondary.own, rings=3)
        self._full = self._secondary.gather(side.surface.area.x.array[:n])
        # A node of both surfaces, as at the tip of a crack, has no gap: its hat goes to others.
        both = self._facing.primary.rows.contains_local(side.parent_dofs[:n])
        self._full[self._secondary.gather(both)] = np.inf
        self._edges = Edges(primary.mesh.comm, self._facing.secondary, self._secondary.own)
        self._last_version = 0
        self.anchor()

    def _fill(self, rows: Array) -> None:
        """Average over the points."""
        element, width, d = self._element, rows.shape[1], self.side.d
        x = self._facing.positions(self.side.u.x.array)
        element.evaluate(x, self._axis, self.side.nodal(self.side.hint))
        rows[:] = element.values()
        rows[:, 0] -= self.offset
        rows[:, width - d :] += self._facing.origin(self.side.u.x.array)
        alone = ~self.meeting()
        if np.any(alone):
            rows[alone, : width - d] = self.alone(alone)
            rows[alone, width - d :] = self._places()[alone]
        self.lost = np.zeros(len(rows), dtype=bool)
        self.lost[element.shares.node[element.failed[element.shares.point]]] = True

    def derivatives(self) -> tuple[Array, None]:
        """Return the derivatives of the field by the positions of the stencil."""
        slopes = self._element.slopes()
        alone, d = ~self.meeting(), self.side.d
        slopes[alone] = 0.0
        slopes[alone, -d:, 0] = np.eye(d)
        n, entries, points, _ = slopes.shape
        return slopes.reshape(n, entries, points * d), None

    def weights(self) -> Array:
        """Return the shares of the force where all normals are the same."""
        self.update()
        return self._element.weights()

    def levers(self) -> Array:
        """Return the forces of unit multipliers over the area."""
        self.update()
        return self._element.levers() * self._cover()[:, None, None, None]

    def forces(self, c: Array) -> Array:
        """Return the forces of multipliers over the area."""
        self.update()
        return self._element.forces(c * self._cover()[:, None])

    def body_forces(self, c: Array) -> Array:
        """Return those on the secondary surface."""
        own = self._element.stencil < self._facing.num_secondary
        return self.forces(c) * own[:, :, None]

    def turning(self, slopes: Array, weight_slopes: Array | None) -> list[Array]:
        """Return how displacements turn the forces (N/m): by patches, and by what these see."""
        return self._element.turning(self.side.nodal(self.side.c))

    def gather(self, values: npt.NDArray, missing: float = 0.0) -> npt.NDArray:
        """Return the entries at the stencils."""
        stencil = self._element.stencil
        around = np.concatenate(self._facing.rows(values))[stencil]
        around[stencil < 0] = missing
        return around

    def turned(self, values: npt.NDArray, missing: float) -> list[tuple[npt.NDArray, npt.NDArray]]:
        """Return the entries at the rows and columns of the blocks of :meth:`turning`."""
        every, d = np.concatenate(self._facing.rows(values)), self.side.d
        entries = lambda dofs: every[dofs].reshape(len(dofs), dofs.shape[1] * d)  # noqa: E731
        return [(entries(rows), entries(columns)) for rows, columns in self._element.turned()]

    def _inputs(self) -> tuple[Array, ...]:
        """Return all of this rank that the kinematics depend on."""
        u, hint = self.side.u.x.array.reshape(-1, self.side.d), self.side.nodal(self.side.hint)
        first, second = self._facing.owned
        return u[first], u[second], hint.copy()

    def meeting(self) -> Mask:
        """Tell which owned nodes see something."""
        return np.asarray(self._element.shares.covered > 0.0)

    def acting_area(self) -> Array:
        """Return what is covered of the test functions of nodes that meet something."""
        return np.where(self.meeting(), self._element.shares.covered, self.area())

    def _cover(self) -> Array:
        """Return what is covered of the owned nodes' areas."""
        return self._element.shares.covered / self.area()

    # -- from step to step -----------------------------------------------------------------------

    def anchor(self) -> None:
        """Find what the surfaces see of each other at ``u_old``; collective."""
        u_old = self.side.u_old.x.array
        x = self._facing.positions(u_old)
        normals = self._secondary.node_normals(self._secondary.positions(self.side.u_old))
        self._axis = -normals[self._secondary.own]
        held = self._secondary.gather(self.side.nodal(self.side.c)[:, 0] != 0.0)
        self._start = (x, self._see(x))
        self._take(self._start[1], x, held)

    def search(self) -> bool:
        """Find again what the surfaces see of each other; collective."""
        x = self._facing.positions(self.side.u.x.array)
        moved = max(np.max(abs(now - then)) for now, then in zip(x, self._seen_at, strict=True))
        if moved <= STILL * self.faces.size:
            return False
        self._take(self._see(x), x, self._secondary.gather(self.meeting()))
        return True

    def _see(self, x: Positions) -> Segments:
        """Return what the patches of this rank's nodes see; collective."""
        see = partial(find_segments, self._facing, x, self.policy.distance(self.faces))
        return on_all_ranks(self.primary.mesh.comm, partial(see, self._wanted))

    def _take(self, points: Segments, x: Positions, kept: Mask) -> None:
        """Average over these points, found at these positions, from now on; collective."""
        comm = self.primary.mesh.comm
        element = on_all_ranks(comm, partial(self._averaged, points, kept))
        element.widen(comm.allreduce(element.stencil.shape[1], MPI.MAX))
        self._element, self._seen_at, self._inputs_before = element, x, None
        self.version = self._last_version = self._last_version + 1

    def _averaged(self, points: Segments, kept: Mask) -> MortarElement:
        """Return the averages of this rank's nodes over points."""
        secondary, own = self._facing.secondary, self._secondary.own
        face, weights = secondary.face_of(points.patch), weights_of(secondary, points)
        every = find_shares(secondary.nodes, face, weights, self._full, kept)
        return MortarElement.over(self._facing, points, self._start, every.of_nodes(own), self._own)

    def save(self) -> object:
        """Return what a step changes here."""
        return {name: getattr(self, name) for name in self._STATE}

    def restore(self, saved: Any) -> None:
        """Put it back, with its version, which nothing else ever has."""
        vars(self).update(saved)
        self._inputs_before = None

    # -- what else is asked of an obstacle -------------------------------------------------------

    def acting(self) -> tuple[Array, Array]:
        """Return all points (m) and the forces on the body there (N); collective."""
        self.update()
        forces = self._element.point_forces(self.side.nodal(self.side.c))
        return self._element.x + self._facing.origin(self.side.u.x.array), forces

    def penetration(self) -> float:
        """Return the largest penetration of a point (m), on this rank; collective."""
        return float(np.max(self._depths(), initial=0.0))

    def _depths(self) -> Array:
        """Return how deep the points are in the other body (m); collective."""
        self.update()
        secondary, points = self._facing.secondary, self._element.points
        nodes = secondary.nodes[secondary.face_of(points.patch)]
        offset = self._secondary.gather(self.offset)[nodes]
        return np.asarray(np.sum(secondary.hats(points.xi) * offset, axis=1) - self._element.gap)

    def missed(self, closed: Mask) -> Mask:
        """Tell which open nodes have points deep in the other body; collective."""
        depths, shares, deepest = self._depths(), self._element.shares, np.zeros(len(closed))
        np.maximum.at(deepest, shares.node, depths[shares.point])
        most = DEEP * np.minimum(self.side.facet_size(), self.faces.size)
        return np.asarray(~closed & (deepest > most))

    def couples(self) -> tuple[Indices, Indices]:
        """Return nodes and the nodes of the faces that they see."""
        return self._element.couples()

    def askew(self, closed: Mask, held: Mask) -> Mask:
        """Tell which nodes at edges press along their own faces; collective."""
        self.update()
        force = self.side.nodal(self.side.c)[:, 0] * self.acting_area() * closed
        return self._edges.askew(self._element, force, held)

    def on_plane(self, still: Mask) -> Mask:
        """Tell in which directions a node of the other surface round each node is held, too."""
        others = self._element.stencil >= self._facing.num_secondary
        held = self.gather(still.astype(float)) > 0.5
        return np.asarray(np.any(held & others[:, :, None], axis=1) | ~self.meeting()[:, None])

    def partners(self, V: Any) -> npt.NDArray[np.int32]:
        """Return this rank's (blocked) dofs on both surfaces."""
        return np.union1d(*self._facing.owned)

    def rounding(self) -> Array:
        """Return the distance of each node from where positions count (m); collective."""
        self.update()
        own = self._facing.positions(self.side.u.x.array)[0][self._own]
        return np.asarray(np.max(abs(own), axis=1))
