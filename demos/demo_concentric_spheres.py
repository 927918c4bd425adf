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
# Two hollow spheres, one in the other, are pressed between rigid planes (Puso and Laursen, Comput.
# Methods Appl. Mech. Engrg. 193, 2004; section 4.3 of the paper). An octant is modelled,
# neo-Hookean, E = 1 MPa, nu = 0.3, radii 10, 12 and 14 mm. The meshes do not match. The inner
# sphere buckles, snaps through and meets its mirror image, for which a rigid plane at z = 0 stands.
# The planes are without friction, between the spheres there is some. The demo writes the force of
# the upper plane against published ones, and pictures.
#
# ```
# ./container python3 demos/demo_concentric_spheres.py --density coarse --mu 0 --end 6
# ./container python3 demos/demo_concentric_spheres.py --density fine --mu 0.5
# ./container python3 demos/demo_concentric_spheres.py --method mortar --degree 2 --layers 2
# ```

# +
import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem

import fenicsx_friction as ff
from concentric_spheres_forces import draw_force
from deformable_output import draw_configuration, read_table, write_table

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "meshes"))
import concentric_spheres as geometry
from from_gmsh import mesh_with_tags

E, NU = 1.0, 0.3  # MPa = N/mm², lengths in mm
#: Displacements (mm) at which a picture is drawn.
SHOWN = (2.0, 4.0, 6.0, 7.0, 8.0, 9.0, 10.0)
# -


@dataclass(frozen=True)
class Case:
    """What is compressed, and how it is modelled."""

    density: str = "coarse"
    mu: float = 0.0
    method: str = "nodes"
    degree: int = 1
    layers: int = geometry.LAYERS

    @property
    def name(self) -> str:
        """Name of the folder of results."""
        parts = [self.density, self.method, f"mu{self.mu:g}"]
        parts += [f"degree{self.degree}"] if self.degree > 1 else []
        parts += [f"layers{self.layers}"] if self.layers != geometry.LAYERS else []
        return "_".join(parts)


@dataclass
class Model:
    """The two spheres between the planes."""

    problem: ff.FrictionalContactProblem
    spheres: ff.Contact
    upper: ff.Contact
    motion: ff.RigidMotion
    relaxation: ff.ViscousRelaxation

    def press(self, displacement: float) -> None:
        """Lower the upper plane (mm)."""
        self.motion.translation.value = (0.0, 0.0, -displacement)


# ## The model
#
# Each sphere comes with its own faces. The one with more of them is the secondary surface, whose
# nodes meet the faces of the other. On curved surfaces faces that do not match cut through each
# other, by up to 0.15 mm: `close_gaps` counts this as closed. To put the nodes onto the faces
# instead would make the walls thinner.
#
# The rims stay on the plane z = 0, as the symmetry of whole spheres demands. Rims that only stand
# on it tilt and slide outwards after the snap: then the force falls where the published ones rise.
#
# At a snap there is no equilibrium nearby. `ViscousRelaxation` lets the spheres creep to the next.


def build(how: Case, comm: MPI.Intracomm = MPI.COMM_WORLD) -> Model:
    """Mesh the spheres and state the problem."""
    data = mesh_with_tags(lambda: geometry.build(how.density, how.layers), comm)
    msh, tags, tag = data.mesh, data.facet_tags, geometry.TAGS
    inner, outer = geometry.DENSITIES[how.density]
    names = ("inner contact", "outer contact")
    secondary, primary = names if inner >= outer else names[::-1]

    V = fem.functionspace(msh, ("Lagrange", how.degree, (3,)))
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    rubber = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E, NU))
    bcs = []
    for axis, plane in enumerate(("x = 0", "y = 0", "z = 0")):
        W = V.sub(axis)
        dofs = fem.locate_dofs_topological(W, 2, tags.find(tag[plane]))
        bcs.append(fem.dirichletbc(0.0, dofs, W))

    motion = ff.RigidMotion(msh)
    spheres = ff.Contact(
        ff.ContactSurface(msh, tags, tag[secondary], secondary),
        ff.DeformableObstacle(
            ff.ContactSurface(msh, tags, tag[primary], primary),
            method="mortar" if how.method == "mortar" else "node-to-face",
            close_gaps=0.5,
        ),
        ff.Coulomb(how.mu) if how.mu > 0.0 else ff.Frictionless(),
    )
    height = geometry.RADII[-1]
    upper = ff.Contact(
        ff.ContactSurface(msh, tags, tag["top"], "upper plane"),
        ff.RigidPlane((0.0, 0.0, height), (0.0, 0.0, -1.0), motion=motion),
        ff.Frictionless(),
    )
    lower = ff.Contact(
        ff.ContactSurface(msh, tags, tag["inside"], "inside"),
        ff.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ff.Frictionless(),
    )
    relaxation = ff.ViscousRelaxation(u)
    internal = ufl.derivative(ff.bulk.stored_energy(rubber, ufl.dx), u, v)
    problem = ff.FrictionalContactProblem(
        internal + relaxation.residual(v),
        u,
        contact=[spheres, upper, lower],
        bcs=bcs,
        petsc_options_prefix="spheres_",
        settings=ff.StepSettings(fallbacks=2),  # a step can be cut instead
    )
    return Model(problem, spheres, upper, motion, relaxation)


# ## The way down


def compress(
    model: Model, end: float, step: float, output: Path | None = None
) -> list[dict[str, float]]:
    """Press the spheres and return a row of results for each step."""
    comm, rows = model.problem.comm, []
    stops = [d for d in SHOWN if d < end]
    stepper = ff.LoadStepper(
        model.problem,
        model.press,
        end=end,
        step=step,
        smallest=step / 2.0,
        largest=step,
        stops=stops,
        relaxation=model.relaxation,
    )
    for record in stepper:
        spheres, upper, lower = record.report.contacts
        rows.append(
            {
                "displacement_mm": record.time,
                "force_N": -upper.force[2],
                "inside_force_N": lower.force[2],
                "open": spheres.open,
                "stick": spheres.stick,
                "slip": spheres.slip,
                "iterations": record.report.iterations,
                "cuts": len(record.failed),
                "relaxed": record.relaxed,
                "certificate": record.report.certificate.relative,
            }
        )
        if comm.rank == 0 and output is not None:
            write_table(rows, output / "force.csv")
            print(
                f"{record.time:7.3f} mm  {rows[-1]['force_N']:7.4f} N  open/stick/slip "
                f"{spheres.open}/{spheres.stick}/{spheres.slip}  "
                f"{record.report.iterations} iterations  relaxed {record.relaxed}  certificate "
                f"{record.report.certificate.relative:.0e}",
                flush=True,
            )
        if output is not None and any(np.isclose(record.time, d) for d in [*stops, end]):
            draw_configuration(
                model.problem.u,
                output / f"configuration_{record.time:04.1f}mm.png",
                component=2,
                title="u_z (mm)",
                limits=(-10.0, 0.0),
                camera=((-32.0, -26.0, 14.0), (6.0, 6.0, 5.0), (0.0, 0.0, 1.0)),
            )
    return rows


# +
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the demo."""
    parser = argparse.ArgumentParser(description="Compressed concentric spheres")
    parser.add_argument("--density", choices=geometry.DENSITIES, default="coarse")
    parser.add_argument("--mu", type=float, default=0.0)
    parser.add_argument("--method", choices=("nodes", "mortar"), default="nodes")
    parser.add_argument("--degree", type=int, default=1, help="of the displacement; 2: mortar")
    parser.add_argument("--layers", type=int, default=geometry.LAYERS, help="through each wall")
    parser.add_argument("--end", type=float, default=10.0, help="displacement (mm)")
    parser.add_argument("--step", type=float, default=0.1, help="largest step (mm)")
    parser.add_argument("--output", type=Path, default=Path("results/concentric_spheres"))
    options = parser.parse_args(arguments)
    how = Case(options.density, options.mu, options.method, options.degree, options.layers)
    output = options.output / how.name
    output.mkdir(parents=True, exist_ok=True)
    model = build(how)
    try:
        rows = compress(model, options.end, options.step, output)
    finally:
        table = output / "force.csv"
        if model.problem.comm.rank == 0 and table.exists():
            draw_force({"this package": read_table(table)}, options.mu, output / "force.png")
    if model.problem.comm.rank == 0:
        print(f"{len(rows)} steps; table and pictures in {output}")


if __name__ == "__main__":
    main()
# -
