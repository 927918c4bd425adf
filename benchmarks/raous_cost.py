# SPDX-License-Identifier: MIT
"""Cost of a contact step in linear elastic solves on the same mesh, in the same run.

    ./container python3 benchmarks/raous_cost.py [--sizes 64 256] [--mu 0.2 1 5] [--repeat 3]
    ./container python3 benchmarks/raous_cost.py --history [--sizes 64 128] [--mu 0.2 1 5 20]

The elastic solve is `dolfinx.fem.petsc.LinearProblem` with MUMPS: assembly, factorisation and
back-substitution of the block with its base held; its symbolic factorisation is made once, before.
The contact step is the Raous rectangle, 0 to full load, with its certificate. Forms are compiled
before both; the figure is the median of the repetitions, in CPU time. Machines differ and are
shared: compare ratios. ``--history`` follows ten steps of loading, unloading with reversal, and
reloading, and tells the cost of the first and the mean of the others.
"""

import argparse
import statistics
import sys
import time
from pathlib import Path

from mpi4py import MPI

from dolfinx.fem.petsc import LinearProblem

from elastic import cpu_of, elastic_problem
from fenicsx_friction import StepReport, StepSettings

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
from demo_raous_rectangle import Block, create_problem
from raous_options import Options, parse_options

#: Fractions of the lateral and the top pressure: loading, unloading with reversal, reloading.
HISTORY = [
    (0.3, 0.6), (0.7, 0.8), (1.0, 1.0), (0.6, 1.0), (0.1, 1.0),
    (-0.4, 1.0), (0.0, 0.7), (0.5, 0.4), (0.9, 0.8), (1.0, 1.0),
]  # fmt: skip


def held_block(block: Block, name: str) -> LinearProblem:
    """Return the elastic problem of the block, its base held vertically."""
    V = block.problem.u.function_space
    vertical = 2 * block.problem.contacts[0].surface.parent_dofs(V) + 1
    return elastic_problem(block.problem, vertical, 1, name)


def measure(
    options: Options, settings: StepSettings, repeat: int
) -> tuple[float, float, float, StepReport]:
    """Return the medians of contact, of the elastic solve (CPU s) and of their ratios."""
    n, mu = options.nx, options.mu
    elastic = held_block(create_problem(MPI.COMM_WORLD, options, f"bulk_{n}_{mu}_"), f"{n}_{mu}")
    pairs = []
    for i in range(repeat):  # in turn, for the speed of the machine changes
        block = create_problem(MPI.COMM_WORLD, options, f"contact_{n}_{mu}_{i}_", settings)
        block.load(options, (1.0, 1.0))
        for substep in (block.problem.stick, block.problem.projection):
            substep.residual().destroy()
        before = cpu_of(elastic)
        start = time.process_time()
        report = block.problem.solve()
        pairs.append((time.process_time() - start, 0.5 * (before + cpu_of(elastic))))
    contact, solve = (statistics.median(column) for column in zip(*pairs, strict=True))
    return contact, solve, statistics.median(a / b for a, b in pairs), report


def follow(options: Options, settings: StepSettings) -> tuple[list[float], list[StepReport]]:
    """Return the cost of each step of a history, in elastic solves, and its report."""
    n, mu = options.nx, options.mu
    elastic = held_block(create_problem(MPI.COMM_WORLD, options, f"bulk_h{n}_{mu}_"), f"h{n}_{mu}")
    block = create_problem(MPI.COMM_WORLD, options, f"history_{n}_{mu}_", settings)
    costs, reports = [], []
    for load in HISTORY:
        block.load(options, load)
        unit, start = cpu_of(elastic), time.process_time()
        reports.append(block.problem.solve())
        costs.append((time.process_time() - start) / unit)
    return costs, reports


def print_history(sizes: list[int], coefficients: list[float], settings: StepSettings) -> None:
    """Print the table of histories."""
    print("mesh       mu  steps  iterations     first step  mean of others  largest certificate")
    for n in sizes:
        for mu in coefficients:
            options = parse_options(f"--nx {n} --ny {n} --mu {mu} --element q1".split())
            costs, reports = follow(options, settings)
            iterations = [r.iterations for r in reports]
            worst = max(r.certificate.relative for r in reports)
            print(
                f"{n:4d}²  {mu:5.1f}  {sum(r.certified for r in reports):5d}  "
                f"{min(iterations):4d}-{max(iterations):<8d} {costs[0]:10.2f}  "
                f"{statistics.mean(costs[1:]):14.2f}  {worst:.1e}",
                flush=True,
            )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 256])
    parser.add_argument("--mu", type=float, nargs="+", default=[0.2, 1.0, 5.0])
    parser.add_argument("--corrector", choices=["projection", "ramp"], default="projection")
    parser.add_argument("--history", action="store_true")
    parser.add_argument("--solver", choices=["auto", "condensed", "full"], default="auto")
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    settings = StepSettings(corrector=arguments.corrector, solver=arguments.solver)
    if arguments.history:
        print_history(arguments.sizes, arguments.mu, settings)
        return
    print("mesh       mu  iterations (substeps)         contact s  elastic s  ratio  certificate")
    for n in arguments.sizes:
        for mu in arguments.mu:
            options = parse_options(f"--nx {n} --ny {n} --mu {mu} --element q1".split())
            contact, elastic, ratio, report = measure(options, settings, arguments.repeat)
            parts = " + ".join(f"{s.iterations}" for s in report.substeps)
            print(
                f"{n:4d}²  {mu:5.1f}  {report.iterations:3d} = {parts:22s} {contact:9.2f}  "
                f"{elastic:9.2f}  {ratio:5.2f}  {report.certificate.relative:.1e}",
                flush=True,
            )


if __name__ == "__main__":
    main()
