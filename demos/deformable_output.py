# SPDX-License-Identifier: MIT
"""What the demos of deformable bodies write: tables, pictures of bodies and of contact faces."""

import csv
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from dolfinx import fem, plot

import fenicsx_friction as ff

Row = dict[str, float]
STATES = tuple(zip(("open", "stick", "slip"), ff.plot.COLOURS, strict=True))


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


def draw_face(
    contact: ff.Contact,
    fields: ff.ContactFields,
    title: str,
    path: Path,
    *,
    units: tuple[str, str],
) -> None:
    """Draw where the nodes of a horizontal contact face are now, their states and pressures.

    Args:
        contact: The contact.
        fields: Its fields, updated.
        title: Of the picture.
        path: The picture.
        units: Of lengths and of pressures.
    """
    (length, unit), n = units, contact.surface.num_owned
    local = (contact.pairing.positions(), fields.state.x.array[:n], contact.nodal().c[:, 0])
    parts = contact.surface.mesh.comm.gather(local)
    if parts is None:
        return
    x, state, pressure = (np.concatenate(p) for p in zip(*parts, strict=True))
    size = max(30.0 * (50.0 / len(x)) ** 0.5, 2.0)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 3.6), layout="constrained")
    for k, (name, colour) in enumerate(STATES):
        chosen = np.rint(state) == k
        left.scatter(*x[chosen, :2].T, c=colour, s=size, label=f"{name} ({chosen.sum()})")
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3)
    points = right.scatter(*x[:, :2].T, c=pressure, s=size, vmin=0.0)
    figure.colorbar(points, ax=right, label=f"pressure ({unit})")
    for axis in (left, right):
        axis.set_aspect("equal")
        axis.set_xlabel(f"x ({length})")
        axis.set_ylabel(f"y ({length})")
    figure.suptitle(title)
    figure.savefig(path, dpi=150)
    plt.close(figure)


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
