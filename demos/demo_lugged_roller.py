# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A lugged roller on rubber
#
# SPDX-License-Identifier: MIT
#
# A steel roller with 16 round lugs, 40 mm across their tips, is made by gmsh's CAD kernel and saved
# as STL, in mm. `RigidSurface.from_file` reads it. As a `RigidBody` it carries a load and turns
# freely, while its axle is moved along a pad of rubber: lugs come into contact, stick, and leave.
#
# ```
# ./container python3 demos/demo_lugged_roller.py
# ```

# +
import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np
import ufl
from dolfinx import fem, mesh, plot

import fenicsx_friction as ff
from deformable_output import Row, write_table

#: Radius to the axes of the lugs, and of these (m); their number; width of the roller (m).
RADIUS, LUG, NUMBER, WIDTH = 17e-3, 3e-3, 16, 26e-3
#: Pad (m); its moduli (Pa); friction; load (N); way of the axle (m).
PAD, E, NU, MU, LOAD, WAY = (80e-3, 20e-3, 12e-3), 3e6, 0.4, 0.8, 40.0, 40e-3
TIP = RADIUS + LUG
# -


# ## The tool
#
# A cylinder and the lugs round it, fused. Curvature sets the size of the triangles.


def write_roller(path: Path) -> None:
    """Write the roller, its axis along y through the origin, as STL in mm."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    radius, lug, width = (1e3 * length for length in (RADIUS, LUG, WIDTH))
    shapes = [(3, gmsh.model.occ.addCylinder(0, -width / 2, 0, 0, width, 0, radius))]
    for k in range(NUMBER):
        x, z = (radius * f(2.0 * np.pi * k / NUMBER) for f in (np.sin, np.cos))
        shapes.append((3, gmsh.model.occ.addCylinder(x, -width / 2, z, 0, width, 0, lug)))
    gmsh.model.occ.fuse(shapes[:1], shapes[1:])
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 24)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 4.0)
    gmsh.model.mesh.generate(2)
    gmsh.write(str(path))
    gmsh.finalize()


# ## The model


@dataclass
class Model:
    """The roller on the pad."""

    problem: ff.FrictionalContactProblem
    contact: ff.Contact
    roller: ff.RigidBody


def build(tool: Path, cells: int, comm: MPI.Intracomm = MPI.COMM_WORLD) -> Model:
    """State the problem: a lug of the roller touches the pad at its first quarter."""
    n = [round(cells * length / 4e-3) for length in PAD]
    msh = mesh.create_box(comm, [[0.0] * 3, PAD], n, mesh.CellType.hexahedron)
    top = mesh.locate_entities_boundary(msh, 2, lambda x: np.isclose(x[2], PAD[2]))
    tags = mesh.meshtags(msh, 2, top, np.ones(len(top), dtype=np.int32))
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    density = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E, NU))
    energy = ff.bulk.stored_energy(density, ufl.dx, bbar=True)
    bottom = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[2], 0.0))
    roller = ff.RigidBody(msh, name="roller")
    roller.given.value[:3] = start = 0.25 * PAD[0], 0.5 * PAD[1], PAD[2] + TIP
    roller.q.x.array[:3] = start
    roller.commit()
    surface = ff.RigidSurface.from_file(tool, scale=1e-3, motion=roller, comm=comm)
    if comm.rank == 0:
        print(surface.soundness)
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1, "pad"), surface, ff.Coulomb(MU))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(energy, u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(np.zeros(3), bottom, V)],
        petsc_options_prefix="roller_",
    )
    return Model(problem, contact, roller)


# ## Press and roll
#
# The axle comes down by a given way first, then it carries the load.


def roll(model: Model, steps: int, output: Path) -> list[Row]:
    """Press and roll; return a row a step."""
    roller, rows = model.roller, []
    roller.given.value[2] -= 0.5e-3
    model.problem.solve()
    roller.free = ("z", "ry")
    roller.force.value[2] = -LOAD
    x0 = float(roller.given.value[0])
    for way in np.linspace(0.0, WAY, steps + 1):
        roller.given.value[0] = x0 + way
        report = model.problem.solve()
        totals, found = report.contacts[0], report.bodies[0]
        rows.append(
            {
                "way_mm": 1e3 * way,
                "angle_rad": found.rotation[1],
                "height_mm": 1e3 * (found.translation[2] - PAD[2]),
                "load_N": found.force[2],
                "push_N": found.force[0],
                "open": totals.open,
                "stick": totals.stick,
                "slip": totals.slip,
                "newton": report.iterations,
                "certificate": report.certificate.relative,
            }
        )
        if model.problem.comm.rank == 0:
            print(", ".join(f"{k} {value:.4g}" for k, value in rows[-1].items()), flush=True)
    return rows


def rolling_radius() -> float:
    """Return the radius (m) of a wheel that advances as the roller does on a rigid floor.

    From lug to lug it advances by the distance of their axes, and by what it rolls on one.
    """
    angle = 2.0 * np.pi / NUMBER
    return float((2.0 * RADIUS * np.sin(angle / 2.0) + LUG * angle) / angle)


# ## The picture


def draw(model: Model, tool: Path, path: Path) -> None:
    """Draw the roller on the deformed pad, coloured by the vertical displacement."""
    import pyvista

    u, roller = model.problem.u, model.roller
    grid = pyvista.UnstructuredGrid(*plot.vtk_mesh(u.function_space))
    moved = u.x.array.reshape(-1, 3)
    grid.points, grid["u_z (mm)"] = 1e3 * (grid.points + moved), 1e3 * moved[:, 2]
    grid = grid.extract_cells(np.arange(u.function_space.mesh.topology.index_map(3).size_local))
    parts = u.function_space.mesh.comm.gather(grid)
    if parts is None:
        return
    steel = pyvista.read(tool)
    steel.points = steel.points @ (np.eye(3) + roller.turned_by()).T + 1e3 * roller.translated()
    plotter = pyvista.Plotter(off_screen=True, window_size=(1100, 620))
    edges = steel.extract_feature_edges(25.0, boundary_edges=False)
    plotter.add_mesh(steel, color="lightsteelblue", smooth_shading=True, split_sharp_edges=True)
    plotter.add_mesh(edges, color="black", line_width=1)
    for number, part in enumerate(parts):
        plotter.add_mesh(
            part,
            show_edges=True,
            cmap="viridis",
            scalar_bar_args={"vertical": True, "position_x": 0.9, "position_y": 0.2},
            show_scalar_bar=number == 0,
        )
    plotter.camera_position = [(20.0, -125.0, 68.0), (41.0, 10.0, 22.0), (0.0, 0.0, 1.0)]
    plotter.screenshot(str(path))
    plotter.close()


# +
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the demo."""
    parser = argparse.ArgumentParser(description="A lugged roller on rubber")
    parser.add_argument("--cells", type=int, default=2, help="cells on 4 mm")
    parser.add_argument("--steps", type=int, default=40, help="steps of rolling 40 mm")
    parser.add_argument("--output", type=Path, default=Path("results/lugged_roller"))
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    tool, comm = options.output / "roller.stl", MPI.COMM_WORLD
    if comm.rank == 0:
        write_roller(tool)
    comm.barrier()
    model = build(tool, options.cells)
    rows = roll(model, options.steps, options.output)
    draw(model, tool, options.output / "roller.png")
    if comm.rank == 0:
        write_table(rows, options.output / "history.csv")
        turned = rows[-1]["angle_rad"] - rows[0]["angle_rad"]
        print(
            f"It rolls as a wheel of radius {1e3 * WAY / turned:.2f} mm, on a rigid floor it would "
            f"be {1e3 * rolling_radius():.2f} mm. Tables and pictures in {options.output}"
        )


if __name__ == "__main__":
    main()
# -
