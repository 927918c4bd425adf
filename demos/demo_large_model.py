# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A large model in 3D
#
# SPDX-License-Identifier: MIT
#
# A rigid ball of radius $R$ is pressed on a block of rubber and shifted: Hertz's pressure, and a
# ring that slips round a middle that sticks. The meshes are cubes of $n^3$ cells. A factor of their
# matrix grows much faster than the mesh; multigrid grows with it. It is the default for models in
# 3D above 10 000 displacements, on any number of ranks, and needs no settings. Contact is solved
# with the whole system: GMRES with one V-cycle, in which the multipliers are eliminated node by
# node (docs/solvers.md).
#
# The demo solves the same two steps on finer and finer meshes, and tells what they cost. The force
# is compared with Hertz's, $F = \frac{4}{3} E^* \sqrt{R}\, \delta^{3/2}$: the block is only four
# times as wide as the contact, and held at its bottom, so that it is stiffer.
#
# ```
# ./container python3 demos/demo_large_model.py
# ./container mpirun -n 2 python3 demos/demo_large_model.py --cells 48
# ```

# +
import argparse
import time
from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff

SIDE, R = 1.0, 2.0  # m
E, NU, MU = 1e6, 0.3, 0.3  # Pa, -, -
DOWN, ALONG = 0.03, 0.012  # m, of the ball
# -

# ## The model


def build(n: int) -> tuple[ff.FrictionalContactProblem, ff.RigidMotion]:
    """Return the problem of a block of n³ cells, and the motion of the ball."""
    corners = [(-SIDE / 2, -SIDE / 2, -SIDE), (SIDE / 2, SIDE / 2, 0.0)]
    msh = mesh.create_box(MPI.COMM_WORLD, corners, [n, n, n], mesh.CellType.hexahedron)
    top = mesh.locate_entities_boundary(msh, 2, lambda x: np.isclose(x[2], 0.0))
    tags = mesh.meshtags(msh, 2, top, np.ones(len(top), dtype=np.int32))
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    energy = ff.bulk.stored_energy(ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU)), ufl.dx)
    bottom = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[2], -SIDE))
    motion = ff.RigidMotion(msh)
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "top"),
        ff.RigidSphere((0.0, 0.0, R), R, motion=motion),
        ff.Coulomb(MU),
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(energy, u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(np.zeros(3), bottom, V)],
        petsc_options_prefix=f"large{n}_",
        linear_solver="multigrid",  # else models of a linear bulk up to 1e5 are factored once
    )
    return problem, motion


# ## Two steps on each mesh


def solve(n: int, folder: Path) -> dict[str, float]:
    """Press and shift on a mesh; return what it gave and cost."""
    problem, motion = build(n)
    results = ff.Results(problem, folder)
    start, reports = time.process_time(), []
    for step, place in enumerate([(0.0, 0.0, -DOWN), (ALONG, 0.0, -DOWN)]):
        motion.translation.value[:] = place
        reports.append(problem.solve())
        results.write(float(step), reports[-1])
    spent = problem.comm.allreduce(time.process_time() - start)
    V, (pressed, shifted) = problem.u.function_space, (report.contacts[0] for report in reports)
    return {
        "n": n,
        "displacements": 3 * V.dofmap.index_map.size_global,
        "force": -pressed.force[2],
        "shear": abs(shifted.force[0]) / -shifted.force[2],
        "stick": shifted.stick,
        "slip": shifted.slip,
        "newton": sum(report.iterations for report in reports),
        "krylov": sum(report.krylov for report in reports),
        "cpu": spent,
        "certificate": max(report.certificate.relative for report in reports),
    }


def draw(rows: list[dict[str, float]], folder: Path) -> None:
    """Draw cost and iterations over the size; the surface of the finest mesh."""
    import matplotlib.pyplot as plt

    size, cpu, krylov = (
        np.array([row[k] for row in rows]) for k in ("displacements", "cpu", "krylov")
    )
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    left.loglog(size, cpu, "o-", label="two steps")
    left.loglog(size, cpu[0] * size / size[0], "k--", lw=1.0, label="proportional")
    left.set(ylabel="CPU time (s)")
    left.legend()
    right.semilogx(size, krylov, "o-")
    right.set(ylabel="iterations of GMRES", ylim=(0.0, 1.3 * max(krylov)))
    for axes in (left, right):
        axes.set(xlabel="displacements")
        axes.set_xticks(size, [f"{n:,}" for n in size])
        axes.minorticks_off()
    left.set_yticks(cpu, [f"{t:.1f}" for t in cpu])
    figure.savefig(folder / "cost.png", dpi=150)
    finest = folder / str(rows[-1]["n"])
    ff.plot.contact_map(finest, "top", file=folder / "surface.png").close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Solve on each mesh, tell, and draw."""
    parser = argparse.ArgumentParser(description="A ball on a block of many cells.")
    parser.add_argument("--output", type=Path, default=Path("results/large_model"))
    parser.add_argument("--cells", type=int, nargs="+", default=[16, 24, 32])
    given = parser.parse_args(arguments)
    hertz = 4.0 / 3.0 * E / (1.0 - NU**2) * np.sqrt(R) * DOWN**1.5
    rows = []
    for n in given.cells:
        row = solve(n, given.output / str(n))
        rows.append(row)
        if MPI.COMM_WORLD.rank == 0:
            print(f"{n}³ cells, {row['displacements']} displacements: force "
                  f"{row['force'] / hertz:.3f} of Hertz's, shear {row['shear']:.4f} of it, "
                  f"{row['stick']} nodes stick, {row['slip']} slip; {row['newton']} Newton and "
                  f"{row['krylov']} Krylov iterations, {row['cpu']:.1f} s, certified to "
                  f"{row['certificate']:.0e}", flush=True)  # fmt: skip
    if MPI.COMM_WORLD.rank == 0:
        draw(rows, given.output)


if __name__ == "__main__":
    main()
