# SPDX-License-Identifier: MIT
"""Surfaces from files of meshes."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.errors import ContactInputError
from ..base.validators import shown
from ..surfaces.face_cells import Array
from ..surfaces.soundness import cut_quadrilaterals

Indices = npt.NDArray[np.int64]


def read_surface(path: str | os.PathLike[str], dimension: int | None) -> tuple[Array, Indices]:
    """Read points and faces with meshio: triangles and quadrilaterals, or line segments in 2D.

    Args:
        path: The file, of any format that meshio reads: STL, gmsh, OBJ, PLY, VTK, XDMF, ...
        dimension: Of space, 2 or 3; by default 3 if there are triangles or quadrilaterals.

    Raises:
        ContactInputError: If it cannot be read, or has no such faces.
    """
    file = _read(path)
    found = {block.type for block in file.cells}
    if dimension is None:
        dimension = 3 if found & {"triangle", "quad"} else 2
    kinds = ("line",) if dimension == 2 else ("triangle", "quad")
    X, faces = np.asarray(file.points, dtype=float), _faces(file, kinds)
    if not len(faces):
        raise ContactInputError(
            f"The file '{path}' has no {' or '.join(kinds)} cells of degree 1, which a surface in "
            f"{dimension}D is made of; it has {', '.join(sorted(found)) or 'no cells'}."
        )
    if dimension == 2:
        if X.shape[1] == 3 and np.any(X[np.unique(faces), 2] != 0.0):
            raise ContactInputError(
                f"The line segments of the file '{path}' are not in the plane z = 0, as those of a "
                "surface in 2D are."
            )
        X = X[:, :2]
    return X, faces


def _read(path: str | os.PathLike[str]) -> Any:
    """Return the mesh of a file."""
    if not isinstance(path, str | os.PathLike):
        raise ContactInputError(f"The file of a surface = {shown(path)} must be a path.")
    if not Path(path).is_file():
        raise ContactInputError(f"There is no file '{path}' to read a surface from.")
    try:
        import meshio
    except ImportError as missing:
        raise ContactInputError(
            "Surfaces are read with meshio: install it, or give points and faces as arrays."
        ) from missing
    try:
        with np.errstate(over="ignore"):  # takes text of STL for a number of triangles first
            return meshio.read(path)
    except (Exception, SystemExit) as failure:  # meshio raises all kinds, and exits
        raise ContactInputError(
            f"meshio cannot read a surface from '{path}': {failure or type(failure).__name__}"
        ) from failure


def _faces(file: Any, kinds: Iterable[str]) -> Indices:
    """Return all faces of some kinds, quadrilaterals cut."""
    parts = [np.zeros((0, 2 if "line" in kinds else 3), dtype=np.int64)]
    for block in file.cells:
        if block.type in kinds:
            data = np.asarray(block.data, dtype=np.int64)
            points = np.asarray(file.points, dtype=float)
            parts.append(cut_quadrilaterals(points, data) if block.type == "quad" else data)
    return np.concatenate(parts)
