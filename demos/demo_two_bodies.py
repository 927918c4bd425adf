# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Two bodies from gmsh
#
# SPDX-License-Identifier: MIT
#
# Half a cylinder of radius $R$ lies on a block of the same rubber. Each body comes from a model of
# its own in gmsh, with names for what matters; their meshes need not match. The cylinder is pressed
# and then shifted. Where both bodies have the same moduli, pressure and shear do not mix, and the
# closed forms hold: with the modulus $E^* = E/(2 (1 - \nu^2))$ of the pair, pressed by $P$ and
# shifted by $Q$ a unit width,
#
# $$
# a = \sqrt{\frac{4 P R}{\pi E^*}}, \qquad
# p = \frac{2 P}{\pi a} \sqrt{1 - \frac{x^2}{a^2}} \quad \text{(Hertz)}, \qquad
# \frac{c}{a} = \sqrt{1 - \frac{Q}{\mu P}} \quad \text{(Cattaneo, Mindlin)}.
# $$
#
# The middle, $|x| < c$, sticks; the rims slip.
#
# ```
# ./container python3 demos/demo_two_bodies.py
# ```

# +
import argparse
from collections.abc import Sequence
from pathlib import Path

import gmsh
import numpy as np
import ufl
from dolfinx import fem

import fenicsx_friction as ff

R, E, NU, MU = 50e-3, 10e6, 0.3, 0.4  # m, Pa, -, -
DOWN, ALONG = 0.2e-3, 0.05e-3  # m, of the cylinder's flat side
WIDTH, HEIGHT, NEAR = 200e-3, 100e-3, 4e-3  # m, of the block, and where cells are small
PLACES = {"flat": R, "top": 0.0, "bottom": -HEIGHT}  # heights (m) of the sides that have names
# -

# ## Two models with names
#
# What is in a physical group is kept, with its name. Cells are small near the contact.


def mesh_body(name: str, size: float) -> ff.NamedMesh:
    """Return the mesh of a body, its groups named."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    occ = gmsh.model.occ
    if name == "cylinder":
        disk, half = occ.addDisk(0, R, 0, R, R), occ.addRectangle(-R, 0, 0, 2 * R, R)
        body = occ.intersect([(2, disk)], [(2, half)])[0]
    else:
        body = [(2, occ.addRectangle(-WIDTH / 2, -HEIGHT, 0, WIDTH, HEIGHT))]
    occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [body[0][1]], name="rubber")
    sides: dict[str, list[int]] = {}
    for _, curve in gmsh.model.getBoundary(body, oriented=False):
        y = occ.getCenterOfMass(1, curve)[1]
        side = next((k for k, height in PLACES.items() if np.isclose(y, height)), "side")
        sides.setdefault(side, []).append(curve)
    for side, curves in sides.items():
        gmsh.model.addPhysicalGroup(1, curves, name=side)
    fields = gmsh.model.mesh.field
    fields.add("MathEval", 1)
    fields.setString(1, "F", f"{size} + 0.15 * Max(sqrt(x * x + y * y) - {NEAR}, 0)")
    fields.setAsBackgroundMesh(1)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.mesh.generate(2)
    model = ff.read_gmsh(gmsh.model)
    gmsh.finalize()
    return model


# ## The problem
#
# `join_meshes` puts both into one mesh without connecting them. Their names get a prefix.


def build(size: float) -> tuple[ff.FrictionalContactProblem, fem.Function]:
    """Return the problem, and the displacement of the cylinder's flat side."""
    model = ff.join_meshes(
        {"cylinder": mesh_body("cylinder", size), "block": mesh_body("block", 1.3 * size)}
    )
    V = fem.functionspace(model.mesh, ("Lagrange", 1, (2,)))
    u, v, moved = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    energy = ff.bulk.stored_energy(ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU)), ufl.dx)
    ends = [model.facets(name) for name in ("cylinder/flat", "block/bottom")]
    driven, held = (fem.locate_dofs_topological(V, 1, facets) for facets in ends)
    contact = ff.Contact(
        model.surface("cylinder/side"),
        ff.DeformableObstacle(model.surface("block/top")),
        ff.Coulomb(MU),
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(energy, u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(moved, driven), fem.dirichletbc(np.zeros(2), held, V)],
        petsc_options_prefix="bodies_",
    )
    return problem, moved


# ## Pressure and shear beside the closed forms


def closed_form(x: np.ndarray, P: float, Q: float) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Return pressure and shear (Pa) at places (m), half-widths of contact and of stick (m)."""
    modulus = E / (2.0 * (1.0 - NU**2))
    a = np.sqrt(4.0 * P * R / (np.pi * modulus))
    c = a * np.sqrt(1.0 - Q / (MU * P))
    ellipse, inner = (np.sqrt(np.maximum(1.0 - (x / b) ** 2, 0.0)) for b in (a, c))
    p0 = 2.0 * P / (np.pi * a)
    return p0 * ellipse, MU * p0 * (ellipse - c / a * inner), a, c


def draw(folder: Path, P: float, Q: float) -> None:
    """Draw the tractions and the bodies."""
    ax = ff.plot.contact_line(folder, "cylinder/side")
    x = np.linspace(*(1.4 * closed_form(np.zeros(1), P, Q)[2] * np.array([-1.0, 1.0])), 400)
    pressure, shear, a, c = closed_form(x, P, Q)
    ax.plot(x, pressure, color="tab:green", lw=1.0, label=f"Hertz, a = {1e3 * a:.2f} mm")
    ax.plot(x, -shear, "--", color="tab:green", lw=1.0, label=f"Mindlin, c = {1e3 * c:.2f} mm")
    ax.set(xlim=(x[0], x[-1]))
    ax.legend(fontsize="small")
    ax.figure.savefig(folder / "tractions.png", dpi=150)
    ff.plot.deformed(folder, factor=20.0, file=folder / "bodies.png").close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Press, shift, compare, and draw."""
    parser = argparse.ArgumentParser(description="Half a cylinder on a block.")
    parser.add_argument("--output", type=Path, default=Path("results/two_bodies"))
    parser.add_argument("--size", type=float, default=0.1e-3, help="of the smallest cells (m)")
    given = parser.parse_args(arguments)
    problem, moved = build(given.size)
    results, (contact,) = ff.Results(problem, given.output), problem.contacts
    for step, place in enumerate([(0.0, -DOWN), (ALONG, -DOWN)]):
        moved.x.array[:] = np.tile(place, len(moved.x.array) // 2)
        report = problem.solve()
        results.write(float(step), report)
    Q, P = np.abs(report.contacts[0].force)
    nodal, places = contact.nodal(), contact.surface.x[:, 0]
    states = nodal.states()
    parts = [np.where(states == k, abs(places), 0.0) for k in (ff.STICK, ff.SLIP)]
    stick, touch = (max(problem.comm.allgather(np.max(part, initial=0.0))) for part in parts)
    _, _, a, c = closed_form(places, P, Q)
    if problem.comm.rank == 0:
        print(f"P = {P:.1f} N/m, Q = {Q:.1f} N/m")
        print(f"contact up to {1e3 * touch:.2f} mm, Hertz {1e3 * a:.2f} mm")
        print(f"stick up to {1e3 * stick:.2f} mm, Cattaneo and Mindlin {1e3 * c:.2f} mm")
        draw(given.output, P, Q)


if __name__ == "__main__":
    main()
