# SPDX-License-Identifier: MIT
"""Edges of a surface, where its own normals may not be the direction in which it presses.

Mortar contact pushes along the normals of the secondary patches. Where surfaces lie on each other,
these are those of the primary surface, too, or differ to either side by turns. A block that stands
on its edge presses along the normal of what it stands on instead, and that of its face is wrong.
"""

from __future__ import annotations

from itertools import combinations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from ..surfaces.lagrange_faces import LagrangeFaces
from .mortar_element import MortarElement
from .planes import outward_normals

Array = npt.NDArray[np.floating]
Mask = npt.NDArray[np.bool_]

#: Between faces at more than this angle (degrees) is an edge.
KINK = 10.0
#: The part of the force in a wrong direction from which on a step is refused. Rings, spheres and
#: blocks that lie on others have up to 0.011; a block on its edge, at 20 degrees, 0.07 to 0.3.
ASKEW = 0.02


class Edges:
    """The nodes at edges of a surface, and where it ends.

    Args:
        comm: All ranks.
        faces: The surface.
        own: This rank's nodes.
    """

    def __init__(self, comm: MPI.Intracomm, faces: LagrangeFaces, own: slice) -> None:
        self._comm, number = comm, comm.allreduce(own.stop, MPI.MAX)
        self._nodes = _edge_nodes(faces, number)[own]

    def askew(self, element: MortarElement, force: Array, held: Mask) -> Mask:
        """Tell which nodes press in a wrong direction, if these are a part that counts; collective.

        Parts count by their amounts: the feet of an arch are wrong to opposite sides.

        On a symmetry plane the surface has no end: what is wrong across it is right with its image.

        Args:
            element: How the nodes meet the other body.
            force: Normal forces of this rank's nodes (N).
            held: Their displacements that are prescribed, (nodes, d).
        """
        tilts = element.averages(element.tilts()) * (self._nodes[:, None] & ~held)
        wrong, size = np.linalg.norm(tilts, axis=1), self._comm.allreduce(float(np.sum(force)))
        if self._comm.allreduce(float(force @ wrong)) <= ASKEW * size:
            return np.zeros(len(force), dtype=bool)
        return np.asarray((force > 0.0) & (wrong > ASKEW))


def _edge_nodes(faces: LagrangeFaces, number: int) -> Mask:
    """Tell which of so many nodes are at an edge."""
    corners = faces.nodes.shape[1]
    if corners == 4:
        ends = [(0, 1), (0, 2), (1, 3), (2, 3)]
    else:
        ends = list(combinations(range(corners), corners - 1))
    sides = np.sort(faces.nodes[:, ends].reshape(-1, len(ends[0])), axis=1)
    normals = outward_normals(faces, faces.X).reshape(len(faces.nodes), -1, faces.d).mean(axis=1)
    found, inverse = np.unique(sides, axis=0, return_inverse=True)
    total = np.zeros((len(found), faces.d))
    np.add.at(total, inverse.ravel(), np.repeat(normals, len(ends), axis=0))
    # Two unit vectors at an angle have a sum of twice the cosine of half of it.
    sharp = np.linalg.norm(total, axis=1) < 2.0 * np.cos(np.radians(KINK / 2.0))
    edge = np.zeros(number, dtype=bool)
    edge[found[sharp].ravel()] = True
    return edge
