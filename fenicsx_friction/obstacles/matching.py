# SPDX-License-Identifier: MIT
"""Whether the faces of two surfaces match."""

import numpy as np
from dolfinx import fem

from ..base.collective import any_rank
from ..surfaces.face_cells import shape_matrix
from ..surfaces.faces import FaceSet
from ..surfaces.surface import ContactSurface
from .candidates import TIE
from .search import nearest_faces

#: A node is on a node of the other surface if its shape function there is one up to this.
OFF = 1e-6


def shared_nodes(first: ContactSurface, second: ContactSurface, V: fem.FunctionSpace) -> bool:
    """Tell whether a node belongs to both surfaces, as the tip of a crack; collective."""
    both = np.intersect1d(first.parent_dofs(V), second.parent_dofs(V))
    return any_rank(first.mesh.comm, len(both) > 0)


def faces_match(first: FaceSet, second: FaceSet, reach: float) -> bool:
    """Tell whether nodes of either surface that see the other one see its nodes; collective.

    Surfaces that are out of reach of each other do not match: nobody knows what they will meet.
    """
    found = False
    for nodes, faces in ((first, second), (second, first)):
        near = nearest_faces(faces, faces.positions(), nodes.positions())
        sees = (near.overhang <= TIE) & (abs(near.gap) <= reach)
        largest = np.max(shape_matrix(faces.cell, near.xi), axis=1)
        if np.any(largest[sees] < 1.0 - OFF):
            return False
        found |= bool(np.any(sees))
    return found
