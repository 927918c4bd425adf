# SPDX-License-Identifier: MIT
"""One step of the Raous rectangle by GetFEM: its nodal Alart–Curnier method with MUMPS.

    python3 benchmarks/getfem_step.py CELLS MU R_FACTOR REPEAT

Prints its figures as JSON. It is a process of its own, for the sequential MUMPS of GetFEM cannot
live in one with the MUMPS of PETSc. The augmentation parameter is ``R_FACTOR`` times Young's
modulus.
"""

import json
import statistics
import sys
import time

import getfem as gf
import numpy as np

L, E, NU = 40.0, 130.0, 0.2  # mm, GPa: numbers near one, for GetFEM's tolerance is absolute
LATERAL, TOP = 0.150, 0.050  # GPa
BASE, FLANK, UPPER, SYMMETRY = 1, 2, 3, 4
NORMALS = {BASE: (0, -1), FLANK: (-1, 0), UPPER: (0, 1), SYMMETRY: (1, 0)}
SOLVE = ("max_res", 1e-11, "max_iter", 60, "lsolver", "mumps", "lsearch", "simplest")


def block(cells: int) -> tuple[gf.Model, gf.MeshFem, gf.MeshIm, gf.Mesh]:
    """Return the loaded elastic block, with nothing at its base."""
    x = np.linspace(0.0, L, cells + 1)
    mesh = gf.Mesh("cartesian", x, x)
    for region, normal in NORMALS.items():
        mesh.set_region(region, mesh.outer_faces_with_direction(normal, 0.01))
    V, points = gf.MeshFem(mesh, 2), gf.MeshIm(mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(2, 3)"))
    V.set_fem(gf.Fem("FEM_QK(2, 1)"))
    model = gf.Model("real")
    model.add_fem_variable("u", V)
    model.add_initialized_data("first", E * NU / ((1.0 + NU) * (1.0 - 2.0 * NU)))
    model.add_initialized_data("second", E / (2.0 * (1.0 + NU)))
    model.add_isotropic_linearized_elasticity_brick(points, "u", "first", "second")
    for name, force, region in (("side", (LATERAL, 0.0), FLANK), ("top", (0.0, -TOP), UPPER)):
        model.add_initialized_data(name, force)
        model.add_source_term_brick(points, "u", name, region)
    model.add_normal_Dirichlet_condition_with_multipliers(points, "u", 1, SYMMETRY)
    return model, V, points, mesh


def cpu_of(model: gf.Model, *unknowns: str) -> tuple[float, int, bool]:
    """Return the CPU time (s) of a solve from zero, its iterations and whether it converged."""
    for name in unknowns:
        model.set_variable(name, 0.0 * model.variable(name))
    start = time.process_time()
    iterations, converged = model.solve(*SOLVE)
    return time.process_time() - start, int(iterations), bool(converged)


def main() -> None:
    """Measure and print."""
    gf.util_trace_level(0)
    cells, mu, factor, repeat = (float(a) for a in sys.argv[1:])
    elastic, *kept = block(int(cells))  # GetFEM forgets what Python forgets
    elastic.add_normal_Dirichlet_condition_with_multipliers(kept[1], "u", 1, BASE)
    model, V, points, _mesh = block(int(cells))
    dofs = V.basic_dof_on_region(BASE)
    for name in ("normal", "tangential"):
        model.add_variable(name, len(dofs) // 2)
    model.add_initialized_data("r", factor * E)
    model.add_initialized_data("mu", mu)
    arguments = ("u", "normal", "tangential", "r", "mu", BASE, "y", 1)
    model.add_nodal_contact_with_rigid_obstacle_brick(points, *arguments)
    units, steps = [], []
    for _ in range(int(repeat)):  # in turn, for the speed of the machine changes
        before = cpu_of(elastic, "u")[0]
        steps.append(cpu_of(model, "u", "normal", "tangential"))
        units.append(0.5 * (before + cpu_of(elastic, "u")[0]))
    nodes, u = V.basic_dof_nodes()[0, dofs[::2]], model.variable("u")
    order = np.argsort(nodes)
    print(
        json.dumps(
            {
                "iterations": steps[0][1],
                "converged": steps[0][2],
                "ratio": statistics.median(s[0] / e for s, e in zip(steps, units, strict=True)),
                "elastic": statistics.median(units),
                "u": (1e-3 * u[dofs.reshape(-1, 2)[order]]).tolist(),
            }
        )
    )


if __name__ == "__main__":
    main()
