# SPDX-License-Identifier: MIT
"""Pictures of :class:`~fenicsx_friction.Results`: contact line or map, curve, deformed bodies.

Each function reads the folder of the results, also while a run writes it, on whatever number of
ranks; call it on one rank. matplotlib and pyvista are imported when they are needed. With ``file``,
the picture is drawn off screen and saved. In notebooks, take what is returned.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .base.errors import ContactInputError
from .certificate.nodal_state import STATE_NAMES
from .files.reading import BULK, fields, nodes_of, num_steps, table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pyvista import Plotter

Folder = str | os.PathLike[str]
Array = npt.NDArray[Any]
#: Colours of the states open, stick and slip.
COLOURS = ("darkgrey", "tab:blue", "tab:red")


def contact_line(
    folder: Folder,
    name: str = "contact",
    step: int = -1,
    *,
    ax: Axes | None = None,
    file: Folder | None = None,
) -> Axes:
    """Draw pressure and tangential traction along a contact line in 2D, with the states.

    Args:
        folder: Folder of the results.
        name: Name of the contact surface.
        step: Index of the step among those written.
        ax: Where to draw, else in a new figure.
        file: Where to save it.
    """
    grid = fields(folder, name, step)
    axis = int(np.argmax(np.ptp(grid.points, axis=0)))
    nodes = nodes_of(grid)
    order = nodes[np.argsort(grid.points[nodes, axis])]
    x, state = grid.points[order, axis], np.rint(grid["state"][order]).astype(int)
    pressure, tangential = grid["pressure"][order], grid["tangential_traction"][order, axis]
    ax = _axes(ax)
    ax.plot(x, pressure, color="0.2", label="pressure")
    ax.plot(x, tangential, "--", color="0.2", label="tangential traction")
    for k, colour in enumerate(COLOURS):
        chosen = state == k
        label = f"{STATE_NAMES[k]} ({np.count_nonzero(chosen)})"
        ax.scatter(x[chosen], pressure[chosen], c=colour, edgecolor="0.2", zorder=3, label=label)
    ax.set(xlabel=f"{'xyz'[axis]} (m)", ylabel="traction (Pa)")
    ax.legend()
    return _saved(ax, file)


def curve(
    folder: Folder,
    y: str = "force_x",
    x: str | Callable[[float], float] = "time",
    contact: str | None = None,
    *,
    ax: Axes | None = None,
    file: Folder | None = None,
) -> Axes:
    """Draw one column of the table over another, such as a force over a displacement.

    Args:
        folder: Folder of the results.
        y: The column; the first call is for forces, ``force_x`` and so on.
        x: The other column, or what the loads prescribe at a time, as the displacement.
        contact: Name of the contact surface, if there are several.
        ax: Where to draw, else in a new figure.
        file: Where to save it.
    """
    columns = table(folder)
    chosen = columns["contact"] == (columns["contact"][0] if contact is None else contact)
    values = {k: v[chosen] for k, v in columns.items()}
    for name in (y, x):
        if isinstance(name, str) and name not in values:
            raise ContactInputError(f"There is no column {name!r}; take one of {[*values]}.")
    along = values[x] if isinstance(x, str) else np.array([x(t) for t in values["time"]])
    ax = _axes(ax)
    ax.plot(along, values[y], "o-", ms=3, color="tab:blue")
    ax.set(xlabel=x if isinstance(x, str) else "displacement (m)", ylabel=y)
    ax.grid(alpha=0.3)
    return _saved(ax, file)


def contact_map(
    folder: Folder,
    name: str = "contact",
    step: int = -1,
    *,
    factor: float = 1.0,
    file: Folder | None = None,
) -> Plotter:
    """Draw the states and the pressures on a contact surface in 3D, where it is now.

    Args:
        folder: Folder of the results.
        name: Name of the contact surface.
        step: Index of the step among those written.
        factor: Magnifies the displacement.
        file: Where to save it.
    """
    import pyvista

    grid = fields(folder, name, step).warp_by_vector("displacement", factor=factor)
    plotter = pyvista.Plotter(shape=(1, 2), off_screen=file is not None, window_size=(1200, 500))
    _draw(plotter, grid, scalars="pressure")
    _look(plotter, grid)
    plotter.subplot(0, 1)
    _draw(plotter, grid, color="white")
    nodes = nodes_of(grid)
    state = np.rint(grid["state"][nodes]).astype(int)
    for k, colour in enumerate(COLOURS):
        if np.any(chosen := state == k):
            points = grid.points[nodes[chosen]]
            label = f"{STATE_NAMES[k]} ({len(points)})"
            plotter.add_points(
                points, color=colour, point_size=12, render_points_as_spheres=True, label=label
            )
    plotter.add_legend(bcolor=None, face="circle", loc="lower center", size=(0.3, 0.12))
    _look(plotter, grid)
    return _shot(plotter, file)


def deformed(
    folder: Folder,
    step: int = -1,
    *,
    factor: float = 1.0,
    scalars: str = "displacement",
    file: Folder | None = None,
) -> Plotter:
    """Draw the deformed bodies, coloured by a field; edges of curved cells as they are.

    Args:
        folder: Folder of the results.
        step: Index of the step among those written.
        factor: Magnifies the displacement.
        scalars: The field that colours; of vectors, the length.
        file: Where to save it.
    """
    import pyvista

    grid = fields(folder, BULK, step)
    plotter = pyvista.Plotter(off_screen=file is not None)
    _draw(plotter, grid.warp_by_vector("displacement", factor=factor), scalars=scalars)
    if _flat(grid):
        plotter.view_xy()
    plotter.camera.zoom(0.9)
    return _shot(plotter, file)


def movie(
    folder: Folder,
    file: Folder,
    *,
    factor: float = 1.0,
    scalars: str = "displacement",
    fps: int = 10,
) -> None:
    """Draw the deformed bodies step by step as a GIF: camera and colours stay.

    Args:
        folder: Folder of the results.
        file: The picture, ``*.gif``.
        factor: Magnifies the displacement.
        scalars: The field that colours; of vectors, the length.
        fps: Steps a second.
    """
    import imageio.v3
    import pyvista

    grids = [fields(folder, BULK, step) for step in range(num_steps(folder))]
    frames = [grid.warp_by_vector("displacement", factor=factor) for grid in grids]
    sizes = [np.linalg.norm(g[scalars].reshape(g.n_points, -1), axis=1) for g in frames]
    limits = (float(min(map(np.min, sizes))), float(max(map(np.max, sizes))))
    boxes, pictures = np.array([frame.bounds for frame in frames]), []
    box = np.column_stack([boxes[:, 0::2].min(axis=0), boxes[:, 1::2].max(axis=0)]).ravel()
    plotter = pyvista.Plotter(off_screen=True)
    for frame in frames:
        plotter.clear_actors()
        _draw(plotter, frame, scalars=scalars, clim=limits)
        if _flat(grids[-1]):
            plotter.view_xy()
        plotter.reset_camera(bounds=box)
        pictures.append(plotter.screenshot())
    plotter.close()
    imageio.v3.imwrite(os.fspath(file), pictures, duration=1000 / fps, loop=0)


def _flat(grid: Any) -> bool:
    """Tell whether bodies are in the plane, and stay there."""
    return not np.any(grid.points[:, 2]) and not np.any(grid["displacement"][:, 2])


def _draw(plotter: Plotter, grid: Any, **options: Any) -> None:
    """Draw a grid and the edges of its cells, bent if they are quadratic."""
    settings = {"nonlinear_subdivision": 2, "algorithm": "dataset_surface"}
    faces, cells = (g.extract_surface(**settings) for g in (grid, grid.separate_cells()))
    at = 0.88 if len(plotter.renderers) == 1 else 0.82  # its numbers are wide in half a window
    bar = {"vertical": True, "position_x": at, "position_y": 0.2, "fmt": "%.3g"}
    plotter.add_mesh(faces, scalar_bar_args=bar, **options)
    edges = cells.extract_feature_edges(
        boundary_edges=True, feature_edges=True, non_manifold_edges=False, manifold_edges=False
    )
    plotter.add_mesh(edges, color="black", line_width=1)


def _look(plotter: Plotter, grid: Any) -> None:
    """Look at a surface along the axis in which it extends least."""
    axis = int(np.argmin(np.ptp(grid.points, axis=0)))
    (plotter.view_yz, plotter.view_xz, plotter.view_xy)[axis]()
    plotter.camera.zoom(0.9)


def _axes(ax: Axes | None) -> Axes:
    """Return given axes or new ones."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(layout="constrained")[1]


def _saved(ax: Axes, file: Folder | None) -> Axes:
    """Save the figure of the axes."""
    if file is not None and (figure := ax.get_figure(root=True)) is not None:
        figure.savefig(file, dpi=150)
    return ax


def _shot(plotter: Plotter, file: Folder | None) -> Plotter:
    """Save the picture."""
    if file is not None:
        plotter.screenshot(str(file))
    return plotter
