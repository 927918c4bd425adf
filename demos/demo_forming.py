# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A strip is drawn over a die, and springs back
#
# SPDX-License-Identifier: MIT
#
# A punch draws an elastic strip over the round shoulder of a die, against a tension $T_1$ at its
# end: plane strain, finite strain, the right half of a symmetric strip. Between die and punch the
# strip has the tension $T_2$, at an angle $\theta$ to $T_1$. Where all of it slides on the die, the
# belt equation of Euler and Eytelwein holds. The tension is in the middle of the thickness $h$,
# friction on the surface:
#
# $$
# T_2 = T_1 \exp\left(\pm \mu\, \theta\, \frac{R}{R + h/2}\right).
# $$
#
# The strip is elastic: when the punch goes back, it springs back in whole; friction turns round.
# What the punch loses in the loop is what friction has dissipated.
#
# ```
# ./container python3 demos/demo_forming.py
# ```

# +
import argparse
from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np
import pyvista
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff

R, SPAN = 5e-3, 15e-3  # m, radius of punch and die, distance of their centres
LENGTH, THICKNESS = 32e-3, 0.4e-3  # m, of the strip
E, NU, MU = 2e9, 0.3, 0.3  # Pa, -, -
TENSION = 0.02 * E * THICKNESS  # N per metre of width
DEPTH, STEPS = 12e-3, 24  # m, - each way
# -

# ## Strip, die and punch
#
# One layer of Q2 cells bends without locking; contact is at all of their nodes. A thin strip gives
# way by bending, far more easily than its thickness does. So `r_p`, which turns gaps into tractions
# on the way to the solution, is smaller than the default: less than half the iterations.


def build(cells: int) -> tuple[ff.FrictionalContactProblem, ff.RigidMotion]:
    """Return the problem and the motion of the punch."""
    corners = [(0.0, 0.0), (LENGTH, THICKNESS)]
    msh = mesh.create_rectangle(MPI.COMM_WORLD, corners, [cells, 1], mesh.CellType.quadrilateral)
    places = [
        lambda x: np.isclose(x[1], 0.0) & (x[0] > 0.5 * SPAN) & (x[0] < 0.99 * LENGTH),
        lambda x: np.isclose(x[1], THICKNESS) & (x[0] < 0.9 * SPAN),
        lambda x: np.isclose(x[0], LENGTH),
        lambda x: np.isclose(x[0], 0.0),
    ]
    sides = [mesh.locate_entities_boundary(msh, 1, place) for place in places]
    facets, values = np.concatenate(sides), np.repeat(np.arange(1, 5), [len(s) for s in sides])
    order = np.argsort(facets)
    tags = mesh.meshtags(msh, 1, facets[order], values[order].astype(np.int32))

    V = fem.functionspace(msh, ("Lagrange", 2, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    energy = ff.bulk.stored_energy(ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E, NU)), ufl.dx)
    end = ufl.Measure("ds", domain=msh, subdomain_data=tags)(3)
    F = ufl.derivative(energy, u, v) - TENSION / THICKNESS * v[0] * end
    bcs = []
    for component, tag in ((0, 4), (1, 3)):  # symmetry; a gripper that moves along
        dofs = fem.locate_dofs_topological(V.sub(component), 1, tags.find(tag))
        bcs.append(fem.dirichletbc(0.0, dofs, V.sub(component)))

    punch = ff.RigidMotion(msh)
    tools = {
        "die": ff.RigidSphere((SPAN, -R), R),
        "punch": ff.RigidSphere((0.0, THICKNESS + R), R, motion=punch),
    }
    contacts = [
        ff.Contact(
            ff.ContactSurface(msh, tags, tag, name, degree=2), tool, ff.Coulomb(MU), r_p=E / R
        )
        for tag, (name, tool) in enumerate(tools.items(), 1)
    ]
    problem = ff.FrictionalContactProblem(
        F, u, contact=contacts, bcs=bcs, petsc_options_prefix="forming_"
    )
    return problem, punch


# ## Down and up
#
# Both tensions follow from the forces on the tools: of the part of the strip beyond the punch, and
# of the whole, the forces are in balance.


def tensions(report: ff.StepReport) -> tuple[float, float]:
    """Return the angle (rad) between the tensions before and behind the die, and their ratio."""
    die, punch = (np.array(contact.force) for contact in report.contacts)
    first = np.array([TENSION, -die[1] - punch[1]])
    second = np.array([TENSION + die[0], -punch[1]])
    angle = np.arctan2(*second[::-1]) + np.arctan2(*first[::-1])
    return float(angle), float(np.linalg.norm(second) / np.linalg.norm(first))


def belt(angle: np.ndarray) -> np.ndarray:
    """Return the ratio of tensions of the belt equation, sliding against the first one."""
    return np.exp(MU * angle * R / (R + THICKNESS / 2.0))


def form(
    problem: ff.FrictionalContactProblem, punch: ff.RigidMotion, results: ff.Results
) -> np.ndarray:
    """Drive the punch by a crank; return depth, its force, angle, ratio and dissipation."""
    rows = []
    down = DEPTH / 2.0 * (1.0 - np.cos(np.linspace(0.0, np.pi, STEPS + 1)))
    for step, depth in enumerate([*down, *down[-2::-1]]):
        punch.translation.value[1] = -depth
        report = problem.solve()
        results.write(float(step), report)
        lost = sum(contact.dissipation for contact in report.contacts)
        rows.append((depth, -report.contacts[1].force[1], *tensions(report), lost))
    return np.array(rows)


# ## The pictures


def draw(rows: np.ndarray, folder: Path) -> None:
    """Draw the loop of the punch, the tensions, and the strip between its tools."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
    depth, force, angle, ratio, _ = rows.T
    for part, name in ((slice(0, STEPS + 1), "down"), (slice(STEPS + 1, -1), "up")):
        left.plot(1e3 * depth[part], 1e-3 * force[part], ".-", label=name)
        right.plot(np.degrees(angle[part]), ratio[part], ".", label=name)
    left.set(xlabel="depth (mm)", ylabel="force of the punch, half (kN/m)")
    theta = np.linspace(0.0, np.max(angle), 50)
    for sign in (1.0, -1.0):
        right.plot(np.degrees(theta), belt(sign * theta), "k-", lw=0.8, zorder=0)
    right.set(xlabel="angle (degrees)", ylabel="$T_2 / T_1$; lines: belt equation")
    left.legend()
    figure.savefig(folder / "loop.png", dpi=150)
    grid = ff.plot.fields(folder, "bulk", STEPS).warp_by_vector("displacement")
    plotter = pyvista.Plotter(off_screen=True, window_size=(1200, 420))
    for strip in (grid, grid.reflect((1.0, 0.0, 0.0))):
        bar = {"title": "strain (%)", "vertical": True, "position_x": 0.9, "position_y": 0.2}
        plotter.add_mesh(strip, scalars="strain", scalar_bar_args=bar)
    for x, y in ((-SPAN, -R), (0.0, THICKNESS + R - DEPTH), (SPAN, -R)):
        disc = pyvista.Disc(center=(x, y, 0.0), inner=0.0, outer=R, c_res=90)
        plotter.add_mesh(disc, color="lightgrey")
    plotter.view_xy()
    plotter.camera.zoom(2.4)
    plotter.screenshot(str(folder / "strip.png"))
    plotter.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Form, compare, and draw."""
    parser = argparse.ArgumentParser(description="A strip is drawn over a die.")
    parser.add_argument("--output", type=Path, default=Path("results/forming"))
    parser.add_argument("--cells", type=int, default=64, help="along the strip")
    given = parser.parse_args(arguments)
    problem, punch = build(given.cells)
    u = problem.u
    strain = 100.0 * (ufl.sqrt((1.0 + u[0].dx(0)) ** 2 + u[1].dx(0) ** 2) - 1.0)
    results = ff.Results(problem, given.output, fields={"strain": strain})
    rows = form(problem, punch, results)
    if problem.comm.rank == 0:
        depth, force, angle, ratio, lost = rows.T
        for step in (STEPS, STEPS + STEPS // 3):
            belted = belt(angle[step] if step == STEPS else -angle[step])
            print(f"T2/T1 = {ratio[step]:.4f} at {np.degrees(angle[step]):.1f} degrees, "
                  f"by the belt equation {belted:.4f}")  # fmt: skip
        work = np.trapezoid(force, depth)
        print(f"Lost by the punch: {work:.3f} J/m; dissipated by friction: {np.sum(lost):.3f} J/m")
        draw(rows, given.output)


if __name__ == "__main__":
    main()
