# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Compressed concentric spheres
#
# SPDX-License-Identifier: MIT
#
# Two hollow half-spheres, one in the other, stand on a rigid plane and are pressed by another one
# (Puso and Laursen, Comput. Methods Appl. Mech. Engrg. 193, 2004; section 4.3 of the paper). An
# octant is modelled, neo-Hookean, E = 1 MPa, nu = 0.3, radii 10, 12 and 14 mm. The meshes do not
# match. The inner sphere buckles; both planes are without friction, between the spheres there is
# some. The demo writes the force of the upper plane against published ones, and pictures.
#
# ```
# ./container python3 demos/demo_concentric_spheres.py --density coarse --mu 0 --end 6
# ./container python3 demos/demo_concentric_spheres.py --density medium --mu 0.5
# ```

# +
import argparse
import csv
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

import gmsh
import matplotlib
import numpy as np
import ufl
from dolfinx import fem, io, plot

import fenicsx_friction as ff

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "meshes"))
import concentric_spheres as geometry

matplotlib.use("Agg")
import matplotlib.pyplot as plt

PUBLISHED = Path(__file__).with_name("data") / "concentric_spheres_force.csv"
E, NU = 1.0, 0.3  # MPa = N/mm², lengths in mm
#: Displacements (mm) at which a picture is drawn.
SHOWN = (2.0, 4.0, 6.0, 8.0, 10.0)
# -


@dataclass
class Model:
    """The two spheres between the planes."""

    problem: ff.FrictionalContactProblem
    spheres: ff.Contact
    upper: ff.Contact
    motion: ff.RigidMotion

    def press(self, displacement: float) -> None:
        """Lower the upper plane (mm)."""
        self.motion.translation.value = (0.0, 0.0, -displacement)


# ## The model
#
# Each sphere comes with its own faces. The one with more of them is the secondary surface, whose
# nodes meet the faces of the other. On curved surfaces faces that do not match cut through each
# other: `close_initial_gaps` puts the nodes on the faces, without strain.
#
# One contact needs thought. At the rims both spheres may stand on the lower plane and stick to
# each other *along its normal*: then forces of friction and of the plane cannot be told apart, and
# the system is singular. There is no friction at the nodes of the rim, therefore.


def build(density: str, mu: float, comm: MPI.Intracomm = MPI.COMM_WORLD) -> Model:
    """Mesh the spheres and state the problem."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    geometry.build(density)
    data = io.gmsh.model_to_mesh(gmsh.model, comm, 0, gdim=3)
    gmsh.finalize()
    msh, tags, tag = data.mesh, data.facet_tags, geometry.TAGS
    inner, outer = geometry.DENSITIES[density]
    names = ("inner contact", "outer contact")
    secondary, primary = names if inner >= outer else names[::-1]
    ff.close_initial_gaps(msh, tags, tag[secondary], tag[primary], reach=0.5)

    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    rubber = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E, NU))
    bcs = []
    for axis, plane in enumerate(("x = 0", "y = 0")):
        W = V.sub(axis)
        dofs = fem.locate_dofs_topological(W, 2, tags.find(tag[plane]))
        bcs.append(fem.dirichletbc(0.0, dofs, W))

    friction = fem.Function(fem.functionspace(msh, ("Lagrange", 1)), name="mu")
    friction.interpolate(lambda x: np.where(x[2] < 1e-6, 0.0, mu))
    motion = ff.RigidMotion(msh)
    spheres = ff.Contact(
        ff.ContactSurface(msh, tags, tag[secondary], secondary),
        ff.DeformableObstacle(ff.ContactSurface(msh, tags, tag[primary], primary)),
        ff.Coulomb(friction) if mu > 0.0 else ff.Frictionless(),
    )
    height = geometry.RADII[-1]
    upper = ff.Contact(
        ff.ContactSurface(msh, tags, tag["top"], "upper plane"),
        ff.RigidPlane((0.0, 0.0, height), (0.0, 0.0, -1.0), motion=motion),
        ff.Frictionless(),
    )
    lower = ff.Contact(  # with the inside: the inner sphere touches it after buckling
        ff.ContactSurface(msh, tags, tag["below"], "lower plane"),
        ff.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ff.Frictionless(),
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(rubber, ufl.dx), u, v),
        u,
        contact=[spheres, upper, lower],
        bcs=bcs,
        petsc_options_prefix=f"spheres_{density}_{mu:g}_",
        settings=ff.StepSettings(fallbacks=4),  # a step can be cut instead
    )
    return Model(problem, spheres, upper, motion)


# ## The way down


def compress(
    model: Model, end: float, step: float, output: Path | None = None
) -> list[dict[str, float]]:
    """Press the spheres and return a row of results for each step."""
    comm, rows = model.problem.comm, []
    stops = [d for d in SHOWN if d < end]
    stepper = ff.LoadStepper(
        model.problem, model.press, end=end, step=0.1, smallest=1e-4, largest=step, stops=stops
    )
    for record in stepper:
        spheres, upper, lower = record.report.contacts
        rows.append(
            {
                "displacement_mm": record.time,
                "force_N": -upper.force[2],
                "lower_force_N": lower.force[2],
                "open": spheres.open,
                "stick": spheres.stick,
                "slip": spheres.slip,
                "iterations": record.report.iterations,
                "cuts": len(record.failed),
                "certificate": record.report.certificate.relative,
            }
        )
        if comm.rank == 0 and output is not None:
            write_table(rows, output / "force.csv")
            print(
                f"{record.time:7.3f} mm  {rows[-1]['force_N']:7.4f} N  open/stick/slip "
                f"{spheres.open}/{spheres.stick}/{spheres.slip}  "
                f"{record.report.iterations} iterations  certificate "
                f"{record.report.certificate.relative:.0e}",
                flush=True,
            )
        if output is not None and any(np.isclose(record.time, d) for d in [*stops, end]):
            draw_configuration(model, output / f"configuration_{record.time:04.1f}mm.png")
    return rows


def write_table(rows: Sequence[dict[str, float]], path: Path) -> None:
    """Write the results as CSV."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


# ## Pictures


def draw_configuration(model: Model, path: Path) -> None:
    """Draw the deformed spheres, coloured by the vertical displacement."""
    import pyvista

    u = model.problem.u
    grid = pyvista.UnstructuredGrid(*plot.vtk_mesh(u.function_space))
    displacement = u.x.array.reshape(-1, 3)
    grid.points = grid.points + displacement
    grid["u_z (mm)"] = displacement[:, 2]
    blocks = u.function_space.mesh.comm.gather(grid)
    if blocks is None:
        return
    plotter = pyvista.Plotter(off_screen=True, window_size=(900, 750))
    for number, block in enumerate(blocks):
        plotter.add_mesh(
            block,
            scalars="u_z (mm)",
            show_edges=True,
            clim=[-10.0, 0.0],
            cmap="viridis",
            show_scalar_bar=number == 0,
            scalar_bar_args={"vertical": True, "position_x": 0.88, "position_y": 0.2},
        )
    plotter.camera_position = [(-32.0, -26.0, 14.0), (6.0, 6.0, 5.0), (0.0, 0.0, 1.0)]
    plotter.screenshot(str(path))
    plotter.close()


def published(mu: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return published forces (N) over displacements (mm) by code, for mu = 0 and 0.5."""
    table = np.genfromtxt(PUBLISHED, delimiter=",", names=True, skip_header=1)
    prefix = {0.0: "mu0_", 0.5: "mu05_"}.get(mu)
    names = [n for n in table.dtype.names if prefix and n.startswith(prefix)]
    return {n.removeprefix(str(prefix)): (table["u_mm"], table[n]) for n in names}


def draw_force(rows: Sequence[dict[str, float]], mu: float, path: Path) -> None:
    """Draw the force over the displacement with published ones."""
    figure, axes = plt.subplots(figsize=(7.0, 4.5), layout="constrained")
    for name, (x, y) in published(mu).items():
        axes.plot(x, y, lw=1.0, label=name.replace("PusoLaursen", "Puso, Laursen"))
    x, y = ([row[key] for row in rows] for key in ("displacement_mm", "force_N"))
    axes.plot(x, y, "k.-", lw=1.5, label="this package")
    axes.set_xlabel("displacement of the upper plane (mm)")
    axes.set_ylabel("force on the octant (N)")
    axes.set_title(f"Compressed concentric spheres, µ = {mu:g}")
    axes.legend()
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=150)
    plt.close(figure)


# +
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the demo."""
    parser = argparse.ArgumentParser(description="Compressed concentric spheres")
    parser.add_argument("--density", choices=geometry.DENSITIES, default="coarse")
    parser.add_argument("--mu", type=float, default=0.0)
    parser.add_argument("--end", type=float, default=10.0, help="displacement (mm)")
    parser.add_argument("--step", type=float, default=0.2, help="largest step (mm)")
    parser.add_argument("--output", type=Path, default=Path("results/concentric_spheres"))
    options = parser.parse_args(arguments)
    output = options.output / f"{options.density}_mu{options.mu:g}"
    output.mkdir(parents=True, exist_ok=True)
    model = build(options.density, options.mu)
    try:
        rows = compress(model, options.end, options.step, output)
    finally:
        table = output / "force.csv"
        if model.problem.comm.rank == 0 and table.exists():
            done = np.genfromtxt(table, delimiter=",", names=True)
            draw_force(
                [dict(zip(done.dtype.names, r, strict=True)) for r in np.atleast_1d(done)],
                options.mu,
                output / "force.png",
            )
    if model.problem.comm.rank == 0:
        print(f"{len(rows)} steps; table and pictures in {output}")


if __name__ == "__main__":
    main()
# -
