# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A tube is crushed flat: contact of a surface with itself
#
# SPDX-License-Identifier: MIT
#
# A rubber tube lies between two rigid plates, which come closer. First it is a ring under two
# opposite loads $F$ (per length): while its wall is thin and little bent, its height shrinks by
#
# $$ \delta = \Bigl(\frac{\pi}{4} - \frac{2}{\pi}\Bigr) \frac{F R^3}{E' I}, \qquad
# E' = \frac{E}{1 - \nu^2}, \quad I = \frac{t^3}{12}. $$
#
# Then the plates flatten it, and its inner wall meets itself, all along between the two loops at
# its sides. The force rises steeply. One surface has the whole inner wall, and its obstacle is
# `SelfContact()`: which nodes meet which faces, and which side of the closing gap is the secondary
# one, is found in each step.
#
# ```
# ./container python3 demos/demo_crushed_tube.py
# ```

# +
import argparse
from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff

OUTER, WALL = 20.0, 3.0  # mm
E, NU, MU = 2.0, 0.45, 0.5  # MPa, -, -
MEETS, END = 1.0 - WALL / OUTER, 0.86  # way of each plate over the radius: walls meet, and end
INSIDE, UPPER, LOWER = 1, 2, 3
# -

# ## The mesh
#
# A ring of quadrilaterals, `n` round it, and the tags of its three surfaces.


def ring(n: int, layers: int) -> tuple[mesh.Mesh, mesh.MeshTags]:
    """Return the mesh of the tube's section, and the tags of its surfaces."""
    angle, radius = (
        2.0 * np.pi * np.arange(n) / n,
        OUTER - WALL * np.arange(layers, -1, -1) / layers,
    )
    x = np.stack([np.outer(f(angle), radius) for f in (np.cos, np.sin)], axis=-1).reshape(-1, 2)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(layers), indexing="ij"))
    here, there = i * (layers + 1) + j, (i + 1) % n * (layers + 1) + j
    cells = np.column_stack([here, here + 1, there, there + 1])
    if MPI.COMM_WORLD.rank > 0:  # one rank reads, all share
        x, cells = x[:0], cells[:0]
    shape = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    msh = mesh.create_mesh(MPI.COMM_WORLD, cells, shape, x)
    msh.topology.create_connectivity(1, 2)
    facets = np.sort(mesh.exterior_facet_indices(msh.topology))
    middle = mesh.compute_midpoints(msh, 1, facets)
    outside = np.where(middle[:, 1] > 0.0, UPPER, LOWER)
    inside = np.linalg.norm(middle, axis=1) < OUTER - WALL / 2.0
    return msh, mesh.meshtags(msh, 1, facets, np.where(inside, INSIDE, outside).astype(np.int32))


# ## The model
#
# Three contacts: two with the plates, one of the inner wall with itself. On its vertical axis the
# tube does not move sideways, or it could roll away.


def build(n: int, layers: int) -> tuple[ff.FrictionalContactProblem, list[ff.RigidMotion]]:
    """Return the problem, and the motions of the upper and the lower plate."""
    msh, tags = ring(n, layers)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    rubber = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E, NU))
    energy = ff.bulk.stored_energy(rubber, ufl.dx)
    axis = mesh.locate_entities_boundary(msh, 0, lambda x: np.isclose(x[0], 0.0))
    sideways = fem.locate_dofs_topological(V.sub(0), 0, axis)

    plates, contacts = [ff.RigidMotion(msh), ff.RigidMotion(msh)], []
    for tag, side, motion in zip((UPPER, LOWER), (1.0, -1.0), plates, strict=True):
        plate = ff.RigidPlane((0.0, side * OUTER), (0.0, -side), motion=motion)
        surface = ff.ContactSurface(msh, tags, tag, "upper" if side > 0.0 else "lower")
        contacts.append(ff.Contact(surface, plate, ff.Coulomb(MU)))
    wall = ff.ContactSurface(msh, tags, INSIDE, "wall")
    contacts.append(ff.Contact(wall, ff.SelfContact(), ff.Coulomb(MU)))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(energy, u, v),
        u,
        contact=contacts,
        bcs=[fem.dirichletbc(0.0, sideways, V.sub(0))],
        petsc_options_prefix="crushed_tube_",
    )
    return problem, plates


# ## Crushing
#
# The stepper cuts steps where the walls meet.


def crush(results: ff.Results, plates: list[ff.RigidMotion], end: float) -> list[ff.StepRecord]:
    """Bring the plates together; return the accepted steps."""

    def closer(share: float) -> None:
        """Move each plate by a share of the radius."""
        for side, motion in zip((1.0, -1.0), plates, strict=True):
            motion.translation.value[1] = -side * share * OUTER

    stops = [0.02, *np.linspace(MEETS, end, 6)] if end > MEETS else [0.02]
    steps = {"step": 0.02, "largest": 0.04, "stops": stops}
    return ff.LoadStepper(results.problem, closer, end=end, results=results, **steps).run()


# ## The pictures


def draw(folder: Path, records: list[ff.StepRecord]) -> None:
    """Draw the tube at four moments, and the force over the way of a plate."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplot_mosaic("abe;cde", figsize=(12.0, 4.2), layout="constrained")
    for name, share in zip("abcd", (0.3, 0.6, 0.8, records[-1].time), strict=True):
        step = int(np.argmin([abs(record.time - share) for record in records]))
        plotter = ff.plot.deformed(folder, step, file=folder / "tube.png")
        plotter.remove_scalar_bar()
        plotter.camera.zoom(1.6)
        picture = plotter.screenshot()
        axes[name].imshow(picture[len(picture) // 8 : -len(picture) // 8])
        axes[name].set_title(f"{records[step].time * OUTER:.1f} mm")
        axes[name].axis("off")
        plotter.close()
    way = [record.time * OUTER for record in records]
    axes["e"].plot(way, [-record.report.contacts[0].force[1] for record in records], ".-")
    axes["e"].set(xlabel="way of a plate (mm)", ylabel="force (N/mm)", yscale="log")
    axes["e"].grid(alpha=0.3)
    figure.savefig(folder / "crushed.png", dpi=150)


def main(arguments: Sequence[str] | None = None) -> None:
    """Crush the tube and draw it."""
    parser = argparse.ArgumentParser(description="A tube is crushed flat between plates.")
    parser.add_argument("--output", type=Path, default=Path("results/crushed_tube"))
    parser.add_argument("--around", type=int, default=120, help="elements round the tube")
    parser.add_argument("--layers", type=int, default=4, help="elements through its wall")
    parser.add_argument("--end", type=float, default=END, help="way of each plate over the radius")
    parser.add_argument("--movie", action="store_true", help="draw all steps as a GIF, too")
    given = parser.parse_args(arguments)
    problem, plates = build(given.around, given.layers)
    records = crush(ff.Results(problem, given.output), plates, given.end)
    if problem.comm.rank > 0:
        return
    first, last = records[0], records[-1].report
    R, inertia = OUTER - WALL / 2.0, WALL**3 / 12.0
    height = 2.0 * first.time * OUTER
    thin = height * E / (1.0 - NU**2) * inertia / R**3 / (np.pi / 4.0 - 2.0 / np.pi)
    force = -first.report.contacts[0].force[1]
    print(f"At first: {force:.5f} N/mm; a thin ring has {thin:.5f} N/mm")
    upper, lower, wall = last.contacts
    print(f"At the end: {-upper.force[1]:.4f} and {lower.force[1]:.4f} N/mm on the plates, "
          f"{np.hypot(*wall.force):.4f} N/mm between the walls; {wall.stick} nodes stick there, "
          f"{wall.slip} slip, {wall.open} are open")  # fmt: skip
    draw(given.output, records)
    if given.movie:
        ff.plot.movie(given.output, given.output / "tube.gif", fps=5)


if __name__ == "__main__":
    main()
