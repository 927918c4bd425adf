# SPDX-License-Identifier: MIT
"""The deformable bodies that conditions do not hold, and how they may move as a whole."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import largest_of_ranks
from ..base.groups import Labels
from ..contact.contact import Contact
from ..obstacles.rigid_body import COMPONENTS
from ..obstacles.rotations import angles, nearest_rotation
from ..surfaces.bodies import number_bodies
from ..surfaces.cells import extent
from .conditions import constrained_dofs
from .numbering import num_owned

Array = npt.NDArray[np.floating]

#: Relative singular values below this are rounding: what holds a body does not resist there.
NOTHING = 1e-9


class FloatingBodies:
    """Knows them; all methods are collective.

    Args:
        u: The displacement.
        bcs: Dirichlet conditions.

    Attributes:
        number, body: Number of all bodies, and the body of each local (blocked) dof.
        names: Those of the rigid motions.
        bodies: The bodies, by number.
        length: Length of the mesh (m).
        held: The local dofs under a condition.
    """

    def __init__(self, u: fem.Function, bcs: Sequence[fem.DirichletBC]) -> None:
        V = u.function_space
        self._u, self.length, self._d = u, extent(V.mesh), V.mesh.geometry.dim
        self._comm, self.names = V.mesh.comm, COMPONENTS[self._d]
        self.number, self.body = number_bodies(V)
        self._valued = _valued(V)
        self._X = V.tabulate_dof_coordinates()[:, : self._d]
        self.held = constrained_dofs(V, bcs)
        self.bodies = [b for b in range(self.number) if not self._is_held(b)]

    def surfaces_of(self, body: int, contacts: Sequence[Contact]) -> list[str]:
        """Return the names of the contact surfaces that a body has."""
        mine = [bool(np.any(self.body[k.parent_dofs] == body)) for k in contacts]
        there = self._comm.allreduce(np.array(mine, dtype=np.int64), MPI.SUM)
        return [k.surface.name for k, n in zip(contacts, there, strict=True) if n]

    def motions(self, body: int, *, undeformed: bool) -> tuple[Array, Array]:
        """Return the rigid motions of a body, (local dofs, motions), and their sizes (m; rad).

        They are zero elsewhere. They move the body by the length of the mesh, or turn it about its
        middle, so that no point goes further along an axis.

        Args:
            body: The body.
            undeformed: Whether they are those of where it was at first.
        """
        x = self._X if undeformed else self._X + self._u.x.array.reshape(self._X.shape)
        nodes = np.flatnonzero((self.body == body) & self._valued)
        motions = np.zeros((*x.shape, len(self.names)))
        about = self._about(x[nodes] - self._middle(x, nodes))
        factors, units = self._units(about)
        motions[nodes] = about * factors
        return motions.reshape(x.size, len(self.names)), units

    def moved(self, body: int, start: Array, *, undeformed: bool) -> tuple[Array, float]:
        """Return how far a body has gone in each of its motions, and how far beside them.

        Args:
            body: The body.
            start: The displacement at the local dofs at first (m).
            undeformed: See :meth:`motions`: a turn is linear then.

        Returns:
            The motions, in units of :meth:`motions`, and the largest other displacement over the
            length of the mesh.
        """
        if undeformed:
            shapes, _ = self.motions(body, undeformed=True)
            return self._by_shapes(shapes, body, self._u.x.array - start)
        x = [self._X + values.reshape(self._X.shape) for values in (start, self._u.x.array)]
        nodes = np.flatnonzero((self.body == body) & self._valued)
        middles = [self._middle(y, nodes) for y in x]
        nodes = nodes[nodes < num_owned(self._u) // self._d]
        before, after = (y[nodes] - middle for y, middle in zip(x, middles, strict=True))
        turn = nearest_rotation(self._comm.allreduce(after.T @ before))
        rest = np.max(abs(after - before @ turn.T), initial=0.0) / self.length
        gone = np.append(middles[1] - middles[0], angles(turn))
        _, units = self._units(self._about(after))
        return gone / units, float(largest_of_ranks(self._comm, np.array([rest]))[0])

    def _by_shapes(self, motions: Array, body: int, way: Array) -> tuple[Array, float]:
        """Return shares of motions in a change of the displacement (m), and the rest."""
        n = num_owned(self._u)
        size = float(largest_of_ranks(self._comm, np.array([np.max(abs(way), initial=0.0)]))[0])
        own, went = motions[:n], way[:n] / max(size, np.finfo(float).tiny)
        both = self._comm.allreduce(np.column_stack([own.T @ own, own.T @ went]))
        share = np.linalg.lstsq(both[:, :-1], both[:, -1], rcond=None)[0]
        here = np.repeat(((self.body == body) & self._valued)[: n // self._d], self._d)
        rest = abs(went - own @ share)[here]
        most = largest_of_ranks(self._comm, np.array([np.max(rest, initial=0.0)]))[0]
        return share * size, float(most) * size / self.length

    def _is_held(self, body: int) -> bool:
        """Tell whether conditions hold a body as a whole."""
        nodes, component = np.divmod(self.held, self._d)
        here = self.body[nodes] == body
        middle = self._middle(self._X, np.flatnonzero((self.body == body) & self._valued))
        rows = self._about(self._X[nodes[here]] - middle)[np.arange(np.sum(here)), component[here]]
        sizes = np.linalg.svd(fewer_rows(self._comm, rows), compute_uv=False)
        return len(sizes) == len(self.names) and bool(sizes[-1] > NOTHING * sizes[0])

    def _middle(self, x: Array, nodes: Labels) -> Array:
        """Return the middle of the owned ones of some nodes (m); collective."""
        own = nodes[nodes < num_owned(self._u) // self._d]
        sums = self._comm.allreduce(np.append(np.sum(x[own], axis=0), len(own)))
        return np.asarray(sums[:-1] / sums[-1])

    def _units(self, about: Array) -> tuple[Array, Array]:
        """Return what makes motions as long as the mesh, and how large they are then (m; rad)."""
        arms = largest_of_ranks(self._comm, np.max(abs(about), axis=(0, 1), initial=0.0))
        factors = np.divide(self.length, arms, out=np.ones_like(arms), where=arms > 0.0)
        return factors, np.where(np.arange(len(arms)) < self._d, self.length, factors)

    def _about(self, arms: Array) -> Array:
        """Return the rigid motions of points, by their arms: (points, d, motions)."""
        d = self._d
        motions = np.zeros((*arms.shape, len(self.names)))
        motions[:, :, :d] = np.eye(d) * self.length
        if d == 2:
            motions[:, :, 2] = np.column_stack([-arms[:, 1], arms[:, 0]])
            return motions
        for i in range(3):
            motions[:, i - 2, d + i], motions[:, i - 1, d + i] = -arms[:, i - 1], arms[:, i - 2]
        return motions


def fewer_rows(comm: MPI.Intracomm, rows: Array) -> Array:
    """Return few rows that resist the same as those of all ranks; collective."""
    return np.concatenate(comm.allgather(np.linalg.qr(rows, mode="r")))


def _valued(V: fem.FunctionSpace) -> npt.NDArray[np.bool_]:
    """Tell which local (blocked) dofs are values of the displacement: of MINI, no bubbles."""
    element = V.ufl_element()
    scalar = element.sub_elements[0] if element.sub_elements else element
    basix_element = getattr(scalar, "basix_element", None)
    valued = np.zeros(len(V.tabulate_dof_coordinates()), dtype=bool)
    if getattr(basix_element, "interpolation_is_identity", False):
        valued[:] = True
        return valued
    layout, corners = V.dofmap.dof_layout, len(basix.geometry(V.mesh.basix_cell()))
    at_vertices = [layout.entity_dofs(0, i)[0] for i in range(corners)]
    valued[V.dofmap.list[:, at_vertices]] = True
    return valued
