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
        friction, doubts = self.friction / units, self.doubts / units
        rows = fewer_rows(self.comm, friction.reshape(-1, friction.shape[-1]))
        # The weakest directions: a strong node holds no turn about itself.
        _, _, weakest = np.linalg.svd(rows @ basis)
        ways = basis @ weakest.T
        work, doubt = self.comm.allreduce(
            np.array([np.sum(np.linalg.norm(f @ ways, axis=1), axis=0) for f in (friction, doubts)])
        )
        weak = work <= SURE * (np.sum(abs(ways), axis=0) + doubt)
        return np.asarray(ways[:, weak].T / units)
