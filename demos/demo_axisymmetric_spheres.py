# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Compressed concentric spheres, axisymmetric
#
# SPDX-License-Identifier: MIT
#
# Two hollow spheres, one in the other, are pressed between rigid planes, as in
# `demo_concentric_spheres.py`. Shape and loads are those of a body of revolution. As long as the
# spheres buckle in rings, a half-plane is enough: a mesh with 60 elements along the inner meridian,
# far finer than the published ones in 3D, costs seconds. x is the radius, y the axis.
#
# The inner sphere dips away from the outer one, then the top of the outer sphere snaps through,
# too. At a snap there is no equilibrium nearby: `ViscousRelaxation` lets the spheres creep to the
# next. The force is compared with one near the limit of fine meshes, found by another code.
#
# ```
# ./container python3 demos/demo_axisymmetric_spheres.py --mu 0
# ./container python3 demos/demo_axisymmetric_spheres.py --mu 0.5 --end 8
# ```

# +
import argparse
from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pyvista
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from concentric_spheres_forces import compare, draw_force
from deformable_output import write_table

RADII = (10.0, 12.0, 14.0)  # mm: inside, contact, outside
E, NU = 1.0, 0.3  # MPa = N/mm², -
SHOWN = (4.0, 6.0, 7.0, 9.0)  # mm, displacements that are drawn
# -

# ## Two shells
#
# A rectangle of angles and radii is bent to a quarter of a ring. Angles count from the pole.


def shell(radii: tuple[float, float], along: int, layers: int) -> ff.NamedMesh:
    """Return a quarter of a ring, with names for its sides."""
    corners = [(0.0, radii[0]), (np.pi / 2.0, radii[1])]
    kind = mesh.CellType.quadrilateral
    msh = mesh.create_rectangle(MPI.COMM_WORLD, corners, [along, layers], kind)
    places = {"axis": (0, 0.0), "rim": (0, np.pi / 2.0), "inside": (1, radii[0]),
              "outside": (1, radii[1])}  # fmt: skip
    facets = [
        mesh.locate_entities_boundary(msh, 1, lambda x, i=i, at=at: np.isclose(x[i], at))
        for i, at in places.values()
    ]
    tags = np.repeat(np.arange(1, 5, dtype=np.int32), [len(side) for side in facets])
    order = np.argsort(np.concatenate(facets))
    x = msh.geometry.x
    angle, radius = x[:, 0].copy(), x[:, 1].copy()
    x[:, 0], x[:, 1] = radius * np.sin(angle), radius * np.cos(angle)
    groups = {name: (1, (k,)) for k, name in enumerate(places, 1)}
    tags = mesh.meshtags(msh, 1, np.concatenate(facets)[order], tags[order])
    return ff.NamedMesh(msh, None, tags, groups)


# ## The model
#
# Energies, areas and forces are those of full rings: `axisymmetric=True`. Faces of the two shells
# do not match; `close_gaps` counts the gaps between their chords as closed. The rims stay on the
# plane z = 0, as the symmetry of whole spheres demands.


def build(
    mu: float, along: int
) -> tuple[ff.FrictionalContactProblem, ff.RigidMotion, ff.ViscousRelaxation]:
    """Return the problem, the motion of the upper plane, and the relaxation."""
    layers = max(along // 10, 2)
    inner, outer = shell(RADII[:2], along, layers), shell(RADII[1:], 9 * along // 10, layers)
    model = ff.join_meshes({"inner": inner, "outer": outer})
    V = fem.functionspace(model.mesh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E, NU), axisymmetric=True)
    energy = ff.bulk.stored_energy(density, ufl.dx, axisymmetric=True)
    relaxation = ff.ViscousRelaxation(u)
    bcs = []
    for component, side in enumerate(("axis", "rim")):
        facets = np.concatenate([model.facets(f"{body}/{side}") for body in ("inner", "outer")])
        dofs = fem.locate_dofs_topological(V.sub(component), 1, facets)
        bcs.append(fem.dirichletbc(0.0, dofs, V.sub(component)))

    def surface(name: str) -> ff.ContactSurface:
        return model.surface(name, axisymmetric=True)

    motion = ff.RigidMotion(model.mesh)
    spheres = ff.DeformableObstacle(surface("outer/inside"), close_gaps=0.1)
    plane = ff.RigidPlane((0.0, RADII[-1]), (0.0, -1.0), motion=motion)
    mirror = ff.RigidPlane((0.0, 0.0), (0.0, 1.0))
    law = ff.Coulomb(mu) if mu > 0.0 else ff.Frictionless()
    problem = ff.FrictionalContactProblem(
        ufl.derivative(energy, u, v) + relaxation.residual(v),
        u,
        contact=[
            ff.Contact(surface("inner/outside"), spheres, law),
            ff.Contact(surface("outer/outside"), plane, ff.Frictionless()),
            ff.Contact(surface("inner/inside"), mirror, ff.Frictionless()),
        ],
        bcs=bcs,
        petsc_options_prefix="rings_",
        settings=ff.StepSettings(fallbacks=2),  # a step can be cut instead
    )
    return problem, motion, relaxation


# ## The way down
#
# Published forces are those on an octant, a quarter of the ring's.


def draw_shapes(folder: Path, steps: dict[float, int]) -> None:
    """Draw the sections at some displacements (mm), found at these steps."""
    plotter = pyvista.Plotter(shape=(1, len(steps)), off_screen=True, window_size=(1600, 230))
    look = {"scalars": "displacement", "clim": (0.0, 9.0), "show_scalar_bar": False}
    for k, (displacement, step) in enumerate(steps.items()):
        grid = ff.plot.fields(folder, "bulk", step).warp_by_vector("displacement")
        plotter.subplot(0, k)
        for half in (grid, grid.reflect((1.0, 0.0, 0.0))):
            plotter.add_mesh(half, **look)
        plotter.add_text(f"{displacement:g} mm", font_size=12)
        plotter.camera_position = [(0.0, 6.0, 38.0), (0.0, 6.0, 0.0), (0.0, 1.0, 0.0)]
    plotter.screenshot(str(folder / "shapes.png"))
    plotter.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Press, compare, and draw."""
    parser = argparse.ArgumentParser(description="Compressed concentric spheres, axisymmetric")
    parser.add_argument("--mu", type=float, default=0.0)
    parser.add_argument("--along", type=int, default=60, help="elements along the inner meridian")
    parser.add_argument("--end", type=float, default=9.5, help="displacement (mm)")
    parser.add_argument("--step", type=float, default=0.1, help="largest step (mm)")
    parser.add_argument("--output", type=Path, default=Path("results/axisymmetric_spheres"))
    parser.add_argument("--movie", action="store_true", help="draw all steps as a GIF, too")
    given = parser.parse_args(arguments)
    problem, motion, relaxation = build(given.mu, given.along)
    results = ff.Results(problem, given.output)

    def press(displacement: float) -> None:
        motion.translation.value[1] = -displacement

    rows = []
    for record in ff.LoadStepper(
        problem,
        press,
        end=given.end,
        step=given.step,
        smallest=given.step / 4.0,
        stops=[d for d in SHOWN if d < given.end],
        relaxation=relaxation,
        results=results,
    ):
        rows.append(
            {
                "displacement_mm": record.time,
                "force_N": -record.report.contacts[1].force[1] / 4.0,
                "iterations": record.report.iterations,
                "relaxed": record.relaxed,
                "certificate": record.report.certificate.relative,
            }
        )
    if problem.comm.rank == 0:
        table = {f"{given.along} elements": rows}
        write_table(rows, given.output / "force.csv")
        print("\n".join(compare(table, given.mu)))
        draw_force(table, given.mu, given.output / "force.png")
        steps = {row["displacement_mm"]: step for step, row in enumerate(rows)}
        draw_shapes(given.output, {d: steps[d] for d in SHOWN if d in steps})
        if given.movie:
            ff.plot.movie(given.output, given.output / "spheres.gif")


if __name__ == "__main__":
    main()
