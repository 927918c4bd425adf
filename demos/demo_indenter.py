# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A rigid indenter under a force
#
# SPDX-License-Identifier: MIT
#
# A ball of radius $R$ is pressed on an elastic body, not by a given way but by a given force $F$.
# For that it is a `RigidBody`: how deep it goes is an unknown, found with the displacement. Without
# friction, on a body that is large beside the contact, this is Hertz's problem. With
# $E^* = E/(1 - \nu^2)$ the radius of contact, the pressure and the depth are
#
# $$
# a = \left(\frac{3 F R}{4 E^*}\right)^{1/3}, \qquad
# p = \frac{3 F}{2 \pi a^2} \sqrt{1 - \frac{r^2}{a^2}}, \qquad
# \delta = \frac{a^2}{R} .
# $$
#
# The mesh is the half-plane of a body of revolution, and forces are those of the whole ball.
#
# ```
# ./container python3 demos/demo_indenter.py
# ```

# +
import argparse
from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff

E, NU, R = 200e9, 0.3, 10e-3  # Pa, -, m
MODULUS = E / (1.0 - NU**2)
FORCES = np.array([50.0, 100.0, 200.0, 400.0])  # N
WIDEST = np.cbrt(0.75 * FORCES[-1] * R / MODULUS)  # m, radius of contact at the last force
# -

# ## A mesh that is fine where contact is
#
# The unit square is meshed, and its nodes are moved: even cells up to $1.25\, a$, then growing ones
# up to $60\, a$.


def half_plane(cells: int) -> mesh.Mesh:
    """Return a mesh with a number of cells on the radius of contact; x is the radius."""
    places = [*np.arange(round(1.25 * cells) + 1) / cells]
    while places[-1] < 60.0:
        places.append(places[-1] + 1.2 * (places[-1] - places[-2]))
    n = len(places) - 1
    corners = [(0.0, -1.0), (1.0, 0.0)]
    msh = mesh.create_rectangle(MPI.COMM_WORLD, corners, [n, n], mesh.CellType.quadrilateral)
    x = msh.geometry.x[:, :2]
    x[:] = np.sign(x) * WIDEST * np.interp(abs(x), np.arange(n + 1) / n, places)
    return msh


# ## Body, ball and contact


def build(cells: int) -> tuple[ff.FrictionalContactProblem, ff.RigidBody]:
    """Return the problem and the ball, which is in contact by a given way."""
    msh = half_plane(cells)
    far = 60.0 * WIDEST
    places = (lambda x: x[1] == 0.0, lambda x: x[1] < -far, lambda x: x[0] == 0.0)
    top, bottom, axis = (mesh.locate_entities_boundary(msh, 1, place) for place in places)
    tags = mesh.meshtags(msh, 1, top, np.ones(len(top), dtype=np.int32))

    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU), axisymmetric=True)
    energy = ff.bulk.stored_energy(density, ufl.dx, axisymmetric=True)
    sides = ((0, axis), (1, bottom))
    dofs = [fem.locate_dofs_topological(V.sub(i), 1, side) for i, side in sides]

    ball = ff.RigidBody(msh, center=(0.0, R), name="ball")
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "surface", axisymmetric=True),
        ff.RigidSphere((0.0, R), R, motion=ball),
        ff.Frictionless(),
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(energy, u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(0.0, dofs[i], V.sub(i)) for i in range(2)],
        petsc_options_prefix="indenter_",
    )
    ball.given.value[1] = -0.1 * WIDEST**2 / R
    problem.solve()
    return problem, ball


# ## Press
#
# A ball that touches nothing is held by nothing: so `build` has brought it into contact by a given
# way. From now on the vertical motion is free, and the force counts.


def press(problem: ff.FrictionalContactProblem, ball: ff.RigidBody, folder: Path) -> np.ndarray:
    """Press by each force; return rows of depth (m) and largest pressure (Pa)."""
    results, (contact,) = ff.Results(problem, folder), problem.contacts
    ball.free = ("y",)
    rows = []
    for force in FORCES:
        ball.force.value[1] = -force
        report = problem.solve()
        results.write(force, report)
        highest = np.max(contact.multipliers()[:, 0], initial=0.0)
        depth = -report.bodies[0].translation[1]
        rows.append((depth, problem.comm.allreduce(highest, MPI.MAX)))
    return np.array(rows)


# ## Beside Hertz


def hertz(force: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return radius of contact (m), largest pressure (Pa) and depth (m)."""
    a = np.cbrt(0.75 * force * R / MODULUS)
    return a, 1.5 * force / (np.pi * a**2), a**2 / R


def draw(folder: Path, depth: np.ndarray) -> None:
    """Draw the pressures, and the force over the depth."""
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.8), layout="constrained")
    for step, force in enumerate(FORCES):
        grid, (a, p0, _) = ff.plot.fields(folder, "surface", step), hertz(force)
        r, order = np.linspace(0.0, a, 200), np.argsort(grid.points[:, 0])
        (line,) = left.plot(1e6 * r, 1e-9 * p0 * np.sqrt(1.0 - (r / a) ** 2), label=f"{force:g} N")
        x, pressure = 1e6 * grid.points[order, 0], 1e-9 * grid["pressure"][order]
        left.plot(x, pressure, "o", ms=3.5, mfc="none", color=line.get_color())
    left.set(xlabel="radius (µm)", ylabel="pressure (GPa)", xlim=(0.0, 1.3e6 * WIDEST))
    left.legend(title="lines: Hertz")
    forces = np.linspace(1.0, FORCES[-1], 200)
    right.plot(1e6 * hertz(forces)[2], forces, label="Hertz")
    right.plot(1e6 * depth, FORCES, "o", label="ball under a force")
    right.set(xlabel="depth (µm)", ylabel="force (N)")
    right.legend()
    figure.savefig(folder / "indenter.png", dpi=150)


def main(arguments: Sequence[str] | None = None) -> None:
    """Press, compare, and draw."""
    parser = argparse.ArgumentParser(description="A ball is pressed by a force.")
    parser.add_argument("--output", type=Path, default=Path("results/indenter"))
    parser.add_argument("--cells", type=int, default=16, help="on the radius of contact")
    given = parser.parse_args(arguments)
    problem, ball = build(given.cells)
    found = press(problem, ball, given.output)
    if problem.comm.rank == 0:
        for force, (depth, highest) in zip(FORCES, found, strict=True):
            _, p0, delta = hertz(force)
            print(f"{force:3.0f} N: depth {1e6 * depth:.3f} µm, {depth / delta:.4f} of Hertz's; "
                  f"pressure {highest / 1e9:.3f} GPa, {highest / p0:.4f}")  # fmt: skip
        draw(given.output, found[:, 0])


if __name__ == "__main__":
    main()
