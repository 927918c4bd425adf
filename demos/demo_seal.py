# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A rubber O-ring: between lubricated plates, and in a groove
#
# SPDX-License-Identifier: MIT
#
# An O-ring with a cord of diameter $d$ and a mean radius $R$ is squeezed by $c\,d$ between flat
# plates. Its section lies in the half-plane of a body of revolution. Rubber is nearly
# incompressible: beside the displacement (Q2) there is a pressure (Q1), Taylor and Hood's element,
# at finite strain. Between lubricated plates the ring is free to grow, and Lindley's formula,
#
# $$
# \frac{F}{2 \pi R\, d\, E} = 1.25\, c^{1.5} + 50\, c^6,
# $$
#
# is to be expected (A. R. Lindley, Journal of the Institution of the Rubber Industry 1, 1967).
# Friction holds the ring: then the section is in plane strain, which is stiffer by
# $1/(1 - \nu^2) = 4/3$. So it is in a rough groove, until the skin meets the outer wall, too.
#
# ```
# ./container python3 demos/demo_seal.py
# ./container python3 demos/demo_seal.py --cells triangles
# ```

# +
import argparse
from collections.abc import Sequence
from pathlib import Path

import gmsh
import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

import fenicsx_friction as ff

D, R = 5e-3, 25e-3  # m, cord and mean radius of the ring
WALL = R + 0.6 * D  # m, radius of the outer wall of the groove
E, NU, MU = 5e6, 0.499, 0.2  # Pa, -, -
SQUEEZES = np.linspace(0.025, 0.3, 12)  # parts of the cord
# -

# ## The section
#
# gmsh makes quadrilaterals, or triangles for comparison, curved as the displacement is.


def cord(size: float, cells: str) -> ff.NamedMesh:
    """Return the section of the cord, which stands on y = 0."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    gmsh.option.setNumber("Mesh.RecombineAll", int(cells == "quadrilaterals"))
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    disk = gmsh.model.occ.addDisk(R, D / 2.0, 0.0, D / 2.0, D / 2.0)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [disk], name="rubber")
    gmsh.model.addPhysicalGroup(1, [1], name="skin")
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(2)
    model = ff.read_gmsh(gmsh.model)
    gmsh.finalize()
    return model


# ## Displacement and pressure
#
# They are the saddle point of $W_{iso}(u) + p \ln J - p^2 / 2K$.


def volume_ratio(u: fem.Function) -> Expr:
    """Return J, the ring's circumference included."""
    r = ufl.SpatialCoordinate(u.function_space.mesh)[0]
    return ufl.det(ufl.Identity(2) + ufl.grad(u)) * (1.0 + u[0] / r)


def rubber(model: ff.NamedMesh) -> tuple[list[fem.Function], ufl.Form]:
    """Return displacement and pressure of the ring, and its energy."""
    material = ff.bulk.Elastic(E, NU)
    u = fem.Function(fem.functionspace(model.mesh, ("Lagrange", 2, (2,))))
    p = fem.Function(fem.functionspace(model.mesh, ("Lagrange", 1)))
    isochoric, _ = ff.bulk.neo_hooke_energy(u, material, axisymmetric=True)
    volumetric = p * ufl.ln(volume_ratio(u)) - p**2 / (2.0 * material.bulk_modulus)
    density = (isochoric, volumetric)
    return [u, p], ff.bulk.stored_energy(density, ufl.dx, axisymmetric=True)


# ## Plate, bottom and wall


def build(
    cells: str, size: float, groove: bool
) -> tuple[ff.FrictionalContactProblem, ff.RigidMotion, Expr]:
    """Return the problem, the motion of the plate, and the pressure in the rubber."""
    model = cord(size, cells)
    unknowns, energy = rubber(model)
    plate = ff.RigidMotion(model.mesh)
    obstacles = [
        ff.RigidPlane((R, D), (0.0, -1.0), motion=plate),
        ff.RigidPlane((R, 0.0), (0.0, 1.0)),
    ]
    if groove:
        obstacles.append(ff.RigidPlane((WALL, 0.0), (-1.0, 0.0)))
    law = ff.Coulomb(MU) if groove else ff.Frictionless()
    contacts = [
        ff.Contact(model.surface("skin", degree=2, axisymmetric=True), obstacle, law)
        for obstacle in obstacles
    ]
    F = [ufl.derivative(energy, f, ufl.TestFunction(f.function_space)) for f in unknowns]
    problem = ff.FrictionalContactProblem(
        F, unknowns, contact=contacts, petsc_options_prefix="seal_"
    )
    return problem, plate, -unknowns[1]


# ## Squeeze


def squeeze(
    problem: ff.FrictionalContactProblem, plate: ff.RigidMotion, results: ff.Results
) -> list[float]:
    """Return the force on the plate at each squeeze, over 2 pi R d E; tell of the volume."""
    forces, iterations = [], 0
    for c in SQUEEZES:
        plate.translation.value[1] = -c * D
        report = problem.solve()
        results.write(c, report)
        iterations += report.iterations
        forces.append(-report.contacts[0].force[1] / (2.0 * np.pi * R * D * E))
    ring = ff.bulk.circumference(problem.u.function_space.mesh)
    forms = [fem.form(part * ring * ufl.dx(degree=4)) for part in (volume_ratio(problem.u), 1.0)]
    now, before = (problem.comm.allreduce(fem.assemble_scalar(form)) for form in forms)
    if problem.comm.rank == 0:
        print(f"{iterations / len(SQUEEZES):.1f} iterations a step; the volume changes by "
              f"{now / before - 1.0:.1e}")  # fmt: skip
    return forces


# ## The pictures


def draw(table: dict[str, np.ndarray], folder: Path) -> None:
    """Draw the forces, and the section in the groove."""
    figure, axes = plt.subplots(figsize=(6.0, 4.0), layout="constrained")
    c, lindley = table["squeeze"], table["lindley"]
    axes.plot(c, lindley, "k-", label="Lindley")
    axes.plot(c, lindley / (1.0 - NU**2), "k--", label="Lindley, plane strain")
    axes.plot(c, table["plates"], "o", label="lubricated plates")
    axes.plot(c, table["groove"], "s", label="rough groove")
    axes.set(xlabel="squeeze $c$", ylabel=r"force $F / (2 \pi R\, d\, E)$")
    axes.legend()
    figure.savefig(folder / "forces.png", dpi=150)
    file = folder / "groove.png"
    plotter = ff.plot.deformed(folder / "groove", scalars="pressure", file=file)
    low, high = (R - 0.7 * D, WALL), (0.0, (1.0 - SQUEEZES[-1]) * D)
    corners = [(low[0], high[0]), (WALL, high[0]), (WALL, 1.2 * high[1])]
    lines = [corners[:2], corners[1:], [(low[0], high[1]), (WALL, high[1])]]
    plotter.add_lines(np.array([(*x, 0.0) for line in lines for x in line]), color="black")
    plotter.screenshot(str(file))
    plotter.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Squeeze, compare, and draw."""
    parser = argparse.ArgumentParser(description="An O-ring is squeezed.")
    parser.add_argument("--output", type=Path, default=Path("results/seal"))
    parser.add_argument(
        "--cells", choices=("quadrilaterals", "triangles"), default="quadrilaterals"
    )
    parser.add_argument("--size", type=float, default=0.2e-3, help="of the cells (m)")
    given = parser.parse_args(arguments)
    table = {"squeeze": SQUEEZES, "lindley": 1.25 * SQUEEZES**1.5 + 50.0 * SQUEEZES**6}
    for case in ("plates", "groove"):
        problem, plate, pressure = build(given.cells, given.size, case == "groove")
        results = ff.Results(problem, given.output / case, fields={"pressure": pressure})
        table[case] = np.array(squeeze(problem, plate, results))
    if problem.comm.rank == 0:
        columns = np.column_stack([*table.values()])
        np.savetxt(given.output / "forces.csv", columns, "%.6g", ",", header=",".join(table),
                   comments="")  # fmt: skip
        for c, lindley, *forces in columns:
            ratios = ", ".join(f"{force / lindley:.3f}" for force in forces)
            print(f"c = {c:.3f}: plates and groove, over Lindley's force: {ratios}")
        draw(table, given.output)


if __name__ == "__main__":
    main()
