# SPDX-License-Identifier: MIT
"""Read the results of a run, also while it runs; not collective."""

import csv
import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.errors import ContactInputError
from .series import file_name

Folder = str | os.PathLike[str]
Array = npt.NDArray[Any]
#: The tables, and the series of the bulk, in the folder of results.
TABLE, BODIES, BULK = "contacts.csv", "bodies.csv", "bulk"


def table(folder: Folder, name: str = TABLE) -> dict[str, Array]:
    """Return the columns of a table of results, numbers but for names.

    Energies that were not audited are NaN.

    Args:
        folder: Folder of the results.
        name: ``contacts.csv``, or ``bodies.csv`` of rigid bodies that carry loads.
    """
    path = Path(folder) / name
    _require(path)
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    columns = {name: [row[name] or "nan" for row in rows] for name in (rows[0] if rows else ())}
    return {
        k: np.array(v, dtype=None if k in ("contact", "body") else float)
        for k, v in columns.items()
    }


def fields(folder: Folder, name: str = BULK, step: int = -1) -> Any:
    """Return the fields of one written step as a ``pyvista.UnstructuredGrid``.

    Cells that ranks share are there once, points on each of them. ``node`` numbers the nodes.

    Args:
        folder: Folder of the results.
        name: The bulk, or the name of a contact surface; of several contacts with one name, the
            later ones are ``name_2`` and so on.
        step: Index of the step among those written, the last one by default.
    """
    reader = _series(folder, name)
    reader.set_active_time_value(reader.time_values[step])
    grid = reader.read()[0]
    grid.point_data["node"] = grid.point_data["vtkOriginalPointIds"]  # kept, unlike those
    return grid.extract_cells(np.flatnonzero(grid.cell_data["vtkGhostType"] == 0))


def num_steps(folder: Folder) -> int:
    """Return how many steps of the bulk are written."""
    return len(_series(folder, BULK).time_values)


def nodes_of(grid: Any) -> Array:
    """Return the points of a grid, those that several ranks wrote once."""
    return np.unique(grid["node"], return_index=True)[1]


def _series(folder: Folder, name: str) -> Any:
    """Return what reads a series of fields."""
    import pyvista

    path = Path(folder) / f"{file_name(name)}.pvd"
    _require(path)
    return pyvista.PVDReader(str(path))


def _require(path: Path) -> None:
    """Raise unless there is such a file of results."""
    if not path.exists():
        raise ContactInputError(
            f"folder: there is no '{path}'; give the folder of ff.Results after its first step."
        )
