# SPDX-License-Identifier: MIT
"""How friction holds motions of whole bodies: by the virtual work of forces at its limit."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from ..equations.floating import fewer_rows

Array = npt.NDArray[np.floating]
#: Friction that may do no more work than this multiple of what errors may do holds nothing.
SURE = 4.0
#: Least and largest of the errors, relative to the largest one and in N m, that are told apart.
LEAST, LARGEST = 1e-30, 1e100
#: A node that may do so many times the work of errors is as good as one that may do more.
STRONG = 1e8
#: Work along a way below this part of a node's largest is rounding.
ROUNDED = 1e-12


@dataclass(frozen=True)
class Grip:
    """What friction does against motions; methods are collective.

    Attributes:
        comm: The communicator.
        friction: Virtual work (N m) of friction at its limit in each motion: for each node of this
            rank and each tangential direction, along an axis of motions; a node does the work of
            the length of its vector.
        doubts: The same of what tractions may be wrong by.
        errors: Virtual work of forces that may be out of balance in each motion (N m).
    """

    comm: MPI.Intracomm
    friction: Array
    doubts: Array
    errors: Array

    def slipping(self, directions: Array) -> Array:
        """Return directions in which friction holds by no more than errors may do.

        Args:
            directions: Independent combinations of the motions, one a row.

        Returns:
            Combinations of the directions, one a row.
        """
        if not len(directions):
            return directions
        # In units of their errors, motions of small and large bodies are alike.
        units = np.minimum(np.nan_to_num(self.errors, nan=LARGEST), LARGEST)
        units = np.maximum(units, LEAST * np.max(units)) if np.any(units) else np.ones_like(units)
        basis, _ = np.linalg.qr((directions * units).T)
        ways = basis @ self._weakest(self.friction / units, basis).T
        works = [_work(f / units, ways) for f in (self.friction, self.doubts)]
        work, doubt = self.comm.allreduce(np.array(works))
        weak = work <= SURE * (np.sum(abs(ways), axis=0) + doubt)
        return np.asarray(ways[:, weak].T / units)

    def _weakest(self, friction: Array, basis: Array) -> Array:
        """Return combinations of a basis, one a row, from the best held to the weakest.

        A strong node holds no turn about itself.
        """
        sizes = np.linalg.norm(friction, axis=(1, 2), keepdims=True)
        # Beside the strongest nodes, weak ones would be rounding.
        friction = friction / np.maximum(sizes / STRONG, 1.0)
        rows = fewer_rows(self.comm, friction.reshape(-1, len(basis)))
        return np.asarray(np.linalg.svd(rows @ basis)[2])


def _work(friction: Array, ways: Array) -> Array:
    """Return the work of this rank's nodes along ways, one a column, without rounding."""
    sizes = np.linalg.norm(friction, axis=(1, 2))[:, None]
    work = np.linalg.norm(friction @ ways, axis=1)
    return np.asarray(np.sum(work * (work > ROUNDED * sizes), axis=0))
