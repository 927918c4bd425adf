# SPDX-License-Identifier: MIT
"""What the demos of deformable bodies write: tables and pictures of the configuration."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from dolfinx import fem, plot

Row = dict[str, float]


def write_table(rows: Sequence[Row], path: Path) -> None:
    """Write one row a step as CSV."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def read_table(path: Path) -> list[Row]:
    """Read what :func:`write_table` wrote."""
    with path.open(newline="") as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]


def draw_configuration(
    u: fem.Function,
    path: Path,
    *,
    component: int,
    title: str,
    limits: tuple[float, float],
    camera: Sequence[Sequence[float]],
    size: tuple[int, int] = (900, 750),
) -> None:
    """Draw the deformed bodies of all ranks, coloured by one component of the displacement.

    Args:
        u: Displacement.
        path: The picture.
        component: The component that colours.
        title: Its name and unit.
        limits: Range of the colours.
        camera: Position, focus and upward direction.
        size: Width and height in pixels.
    """
    import pyvista

    grid = pyvista.UnstructuredGrid(*plot.vtk_mesh(u.function_space))
    displacement = u.x.array.reshape(-1, 3)
    grid.points = grid.points + displacement
    grid[title] = displacement[:, component]
    # Not the ghosts: their faces would show inside the bodies.
    owned = u.function_space.mesh.topology.index_map(3).size_local
    grid = grid.extract_cells(np.arange(owned))
    blocks = u.function_space.mesh.comm.gather(grid)
    if blocks is None:
        return
    plotter = pyvista.Plotter(off_screen=True, window_size=size)
    for number, block in enumerate(blocks):
        plotter.add_mesh(
            block,
            scalars=title,
            show_edges=True,
            clim=limits,
            cmap="viridis",
            show_scalar_bar=number == 0,
            scalar_bar_args={"vertical": True, "position_x": 0.88, "position_y": 0.2},
        )
    plotter.camera_position = [tuple(row) for row in camera]
    plotter.screenshot(str(path))
    plotter.close()
