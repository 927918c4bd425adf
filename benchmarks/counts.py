# SPDX-License-Identifier: MIT
"""Counts of iterations, compared with those of before: unlike times, they do not vary.

    ./container python3 benchmarks/counts.py [--write]

Each case of `counts.csv` is solved again. It fails if a case takes over a third more iterations
(and three) than written there, or is not certified. ``--write`` makes the table anew.
"""

import argparse
import csv
import sys
import warnings
from pathlib import Path

from mpi4py import MPI

from block_cost import PATH, cube
from fenicsx_friction import StepReport, StepSettings
from raous_cost import HISTORY, create_problem, parse_options

TABLE = Path(__file__).with_suffix(".csv")


def raous(n: int, mu: float, solver: str, history: bool) -> list[StepReport]:
    """Load the Raous rectangle, in one step or through the history."""
    options = parse_options(f"--nx {n} --ny {n} --mu {mu} --element q1".split())
    settings = StepSettings(solver=solver, look_for_others=False)
    block = create_problem(MPI.COMM_WORLD, options, f"raous_{n}_{mu}_{solver}_{history}_", settings)
    reports = []
    for load in HISTORY if history else [(1.0, 1.0)]:
        block.load(options, load)
        reports.append(block.problem.solve())
    return reports


def dragged(n: int, mu: float, solver: str, history: bool) -> list[StepReport]:
    """Press a cube and drag it."""
    problem, top = cube(n, mu, StepSettings(solver=solver), f"cube_{n}_{mu}_{solver}_")
    reports = []
    for across, down in PATH if history else PATH[:1]:
        top.x.array.reshape(-1, 3)[:] = across, 0.0, down
        reports.append(problem.solve())
    return reports


MODELS = {"raous": raous, "cube": dragged}
CASES = [
    ("raous", 256, 5.0, "condensed", False),
    *(("raous", 64, mu, "condensed", False) for mu in (0.2, 1.0, 5.0, 20.0)),
    ("raous", 64, 5.0, "full", False),
    *(("raous", 64, mu, "condensed", True) for mu in (1.0, 20.0)),
    *(("cube", 8, mu, solver, True) for solver in ("condensed", "full") for mu in (0.3, 1.0)),
]


def main() -> None:
    """Solve, compare or write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--write", action="store_true")
    write = parser.parse_args().write
    found, worse = [], []
    known = {}
    if not write:
        with TABLE.open() as file:
            known = {tuple(row[:5]): int(row[5]) for row in list(csv.reader(file))[1:]}
    for model, n, mu, solver, history in CASES:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reports = MODELS[model](n, mu, solver, history)
        case = (model, str(n), str(mu), solver, "history" if history else "one step")
        count = sum(r.iterations for r in reports)
        certified = all(r.certified and r.solver == solver for r in reports)
        found.append((*case, count))
        before = count if write else known.get(case, -1)
        good = certified and count <= max(4 * before // 3, before + 3)
        print(f"{' '.join(case):40s} {count:5d}  before {before:5d}  {'' if good else 'WORSE'}",
              flush=True)  # fmt: skip
        if not good:
            worse.append(case)
    if write:
        with TABLE.open("w", newline="") as file:
            head = ("model", "cells", "mu", "solver", "path", "iterations")
            csv.writer(file, lineterminator="\n").writerows([head, *found])
    sys.exit(bool(worse))


if __name__ == "__main__":
    main()
