# SPDX-License-Identifier: MIT
"""Cost of steps of a 3D block with multigrid, in elastic multigrid solves of the same mesh and run.

    ./container python3 benchmarks/multigrid_cost.py [--cells 16 24 48] [--finite] [--direct]

A cube (E = 1000 Pa, nu = 0.3, mu = 0.3, Q1) is pressed on a plane by 1 % of its height, dragged so
that some nodes slip, and so that nearly all do. The unit is one linear elastic solve of the cube
with its base held: assembly, conjugate gradients with the same multigrid to 1e-8. Forms are
compiled before. CPU time: compare ratios. On several ranks (``./container mpirun -n 2 python3
benchmarks/multigrid_cost.py``) it is the largest of all. Peak memory is that of all processes.
"""

import argparse
import resource
import statistics
import time

from mpi4py import MPI

from dolfinx.fem.petsc import LinearProblem

import fenicsx_friction as ff
from block_cost import cube
from elastic import cpu_of, elastic_problem
from fenicsx_friction.solvers.multigrid import CYCLE_OPTIONS
from fenicsx_friction.solvers.rigid_modes import rigid_modes

#: Where the top goes, across and down: press, stick-slip, drag.
LOADS = [(0.0, -0.01), (0.003, -0.01), (0.01, -0.01)]
CG = {"ksp_type": "cg", "ksp_rtol": 1e-8, **CYCLE_OPTIONS}


def tell(line: str) -> None:
    """Print on rank 0."""
    if MPI.COMM_WORLD.rank == 0:
        print(line, flush=True)


def held_cube(problem: ff.FrictionalContactProblem, name: str) -> LinearProblem:
    """Return the elastic problem of the cube with its base held."""
    V = problem.u.function_space
    held = problem.contacts[0].surface.parent_dofs(V)
    elastic = elastic_problem(problem, held, None, name, CG)
    modes = rigid_modes(V)
    elastic.A.setNearNullSpace(modes)
    elastic.A.setBlockSize(3)
    return elastic


def over_ranks(value: float, how: MPI.Op = MPI.MAX) -> float:
    """Return the largest value of all ranks, or their sum."""
    return float(MPI.COMM_WORLD.allreduce(value, how))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[16, 24])
    parser.add_argument("--mu", type=float, default=0.3)
    parser.add_argument("--finite", action="store_true", help="neo-Hooke instead of linear")
    parser.add_argument("--direct", action="store_true", help="MUMPS instead of multigrid")
    arguments = parser.parse_args()
    linear = "direct" if arguments.direct else "multigrid"
    tell(
        "cells     dofs  Newton     Krylov        set-ups  elastic solves     elastic s  certified"
    )
    for n in arguments.cells:
        settings = ff.StepSettings(solver="full")
        problem, top = cube(n, arguments.mu, settings, f"mg_{n}_", arguments.finite, linear)
        elastic = held_cube(problem, f"mg{n}")
        for substep in (problem.stick, problem.projection):
            substep.residual().destroy()
        cpu_of(elastic)
        costs, units, reports = [], [], []
        for across, down in LOADS:
            top.x.array.reshape(-1, 3)[:] = across, 0.0, down
            units.append(over_ranks(cpu_of(elastic)))
            start = time.process_time()
            reports.append(problem.solve())
            costs.append(over_ranks(time.process_time() - start))
        unit = statistics.median(units)
        newton = " ".join(str(r.iterations) for r in reports)
        krylov = " ".join(str(r.krylov) for r in reports)
        set_ups = " ".join(str(r.set_ups) for r in reports)
        ratios = " ".join(f"{cost / unit:5.1f}" for cost in costs)
        worst = max(r.certificate.relative for r in reports)
        its = elastic.solver.getIterationNumber()
        dofs = problem.u.function_space.dofmap.index_map.size_global * 3
        memory = over_ranks(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, MPI.SUM) / 2**20
        tell(
            f"{n:3d}³  {dofs:8d}  {newton:9s}  {krylov:12s}  {set_ups:7s}  "
            f"{ratios}  {unit:8.2f} ({its})  {worst:.0e}  {memory:.2f} GiB"
        )


if __name__ == "__main__":
    main()
