# SPDX-License-Identifier: MIT
"""Edges and corners of a tool: where it is open, and where it may enter the faces of a body."""

from __future__ import annotations

import numpy as np

from ..surfaces.face_cells import Array, normals
from ..surfaces.faces import Faces
from ..surfaces.soundness import edges
from .candidates import FACING

#: Length of the sum of two unit normals over two, from which on faces are flat, not an edge.
FLAT = 1.0 - 1e-6


class ToolEdges:
    """Corners of a surface of triangles (segments in 2D), and points between them on its edges.

    Args:
        faces: The surface.
        size: Distance (m) from which on two points on an edge have others between them.

    Attributes:
        open: Corners of the open edges (m): (n, 1 or 2, d).
        facing: Cosine of the normals of body and tool from which on faces look away: those of a
            closed tool never do.
        x: The points (m), all corners first,
        normals: and averaged normals there.
    """

    def __init__(self, faces: Faces, size: float) -> None:
        corners, center = faces.X[faces.faces], np.tile(faces.cell.center, (len(faces.faces), 1))
        around, of_face = edges(faces.faces)
        normal, number = np.zeros((len(around), faces.X.shape[1])), np.zeros(len(around))
        for edge in of_face.T:
            np.add.at(normal, edge, normals(faces.cell, corners, center))
            np.add.at(number, edge, 1.0)
        self.open = faces.X[around[number == 1.0]]
        # From the back of a sheet a body is not inside it.
        self.facing = -FACING if len(self.open) else np.inf
        length = np.linalg.norm(normal, axis=1)
        sharp = (length < FLAT * number) | (number == 1.0)
        a, b = faces.X[around[sharp][:, 0]], faces.X[around[sharp][:, -1]]
        parts = np.maximum(np.ceil(np.linalg.norm(b - a, axis=1) / size).astype(int), 1)
        edge = np.repeat(np.arange(len(a)), parts - 1)
        place = np.arange(len(edge)) - np.repeat(np.cumsum(parts - 1) - parts + 1, parts - 1) + 1
        t = (place / parts[edge])[:, None]
        self.x = np.concatenate([faces.X, (1.0 - t) * a[edge] + t * b[edge]])
        unit = (normal / np.maximum(length, np.finfo(float).tiny)[:, None])[sharp]
        self.normals = np.concatenate([faces.node_normals(faces.X), unit[edge]])

    def near(self, x: Array, margin: float) -> tuple[Array, Array]:
        """Return the points in a box round others, and the normals there.

        Args:
            x: The others (m).
            margin: How far beyond these the box reaches (m).
        """
        low, high = x.min(axis=0) - margin, x.max(axis=0) + margin
        inside = np.all((self.x > low) & (self.x < high), axis=1)
        return self.x[inside], self.normals[inside]
