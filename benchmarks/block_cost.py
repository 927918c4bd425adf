# SPDX-License-Identifier: MIT
"""Cost of steps of a 3D block in linear elastic solves on the same mesh, in the same run.

    ./container python3 benchmarks/block_cost.py [--cells 12 24] [--mu 0.3] [--solver full]

A cube (E = 1000 Pa, nu = 0.3, Q1) is pressed on a plane by 1 % of its height and dragged to and
fro. The elastic solve is MUMPS' LU with assembly and back-substitution, the base held; its symbolic
factorisation is made once, before. Forms are compiled before. CPU time: compare ratios.
"""

import argparse
import statistics
import time

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from elastic import cpu_of, elastic_problem

#: Where the top goes: across and down (fractions of the height).
PATH = [
    (0.0, -0.01), (0.001, -0.01), (0.003, -0.01), (0.006, -0.01), (0.003, -0.01), (0.0, -0.008),
]  # fmt: skip


def cube(  # type: ignore[no-untyped-def]
    n: int,
    mu: float,
    settings: ff.StepSettings,
    name: str,
    finite: bool = False,
    linear: str = "auto",
):
    """Return the problem of a cube of ``n`` cells an edge, and the Function that moves its top."""
    msh = mesh.create_unit_cube(MPI.COMM_WORLD, n, n, n, mesh.CellType.hexahedron)
    base = mesh.locate_entities_boundary(msh, 2, lambda x: np.isclose(x[2], 0.0))
    tags = mesh.meshtags(msh, 2, base, np.full(len(base), 1, dtype=np.int32))
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v, top = fem.Function(V, name="u"), ufl.TestFunction(V), fem.Function(V)
    density = ff.bulk.neo_hooke_energy if finite else ff.bulk.small_strain_energy
    energy = density(u, ff.bulk.Elastic(E=1000.0, nu=0.3))
    F = ufl.derivative(ff.bulk.stored_energy(energy, ufl.dx), u, v)
    held = fem.dirichletbc(top, fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[2], 1.0)))
    plane = ff.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1), plane, ff.Coulomb(mu))
    problem = ff.FrictionalContactProblem(
        F,
        u,
        contact=contact,
        bcs=[held],
        petsc_options_prefix=name,
        linear_solver=linear,
        settings=settings,
    )
    return problem, top


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[12, 24])
    parser.add_argument("--mu", type=float, nargs="+", default=[0.3])
    parser.add_argument("--solver", choices=["auto", "condensed", "full"], default="auto")
    arguments = parser.parse_args()
    settings = ff.StepSettings(solver=arguments.solver)
    print("cells    mu  contact nodes  iterations            first step  mean of others  elastic s")
    for n in arguments.cells:
        for mu in arguments.mu:
            problem, top = cube(n, mu, settings, f"cube_{n}_{mu}_")
            surface = problem.contacts[0].surface
            dofs = surface.parent_dofs(problem.u.function_space)
            elastic = elastic_problem(problem, dofs, None, f"{n}_{mu}")
            for substep in (problem.stick, problem.projection):
                substep.residual().destroy()
            costs, units, reports = [], [cpu_of(elastic)], []
            for across, down in PATH:
                values = top.x.array.reshape(-1, 3)
                values[:] = across, 0.0, down
                units.append(cpu_of(elastic))
                start = time.process_time()
                reports.append(problem.solve())
                costs.append((time.process_time() - start) / units[-1])
            iterations = " ".join(str(r.iterations) for r in reports)
            print(
                f"{n:3d}³  {mu:5.1f}  {surface.num_owned:13d}  {iterations:20s}  {costs[0]:10.2f}  "
                f"{statistics.mean(costs[1:]):14.2f}  {statistics.median(units[1:]):9.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
