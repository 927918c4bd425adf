# SPDX-License-Identifier: MIT
"""A step of the Raous rectangle beside GetFEM's, on the same mesh in the same run.

    make getfem

or, with GetFEM installed beside DOLFINx (``python3-getfem`` in Debian):

    python3 benchmarks/getfem_raous.py [--sizes 64 256] [--mu 0.2 1 5] [--factors 1 10]

Each code's CPU time of the step from zero to the full load is divided by that of its own linear
elastic solve with MUMPS. The displacements of the base are compared with the certified ones.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from fenicsx_friction import StepSettings
from raous_cost import measure

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
from demo_raous_rectangle import create_problem
from raous_options import Options, parse_options


def certified_displacement(options: Options) -> np.ndarray:
    """Return the displacement of the base, node by node along it (m)."""
    block = create_problem(MPI.COMM_WORLD, options, "beside_getfem_")
    block.load(options, (1.0, 1.0))
    block.problem.solve()
    surface = block.problem.contacts[0].surface
    u, n = block.problem.u, surface.num_owned
    values = u.x.array.reshape(-1, 2)[surface.parent_dofs(u.function_space)[:n]]
    return np.asarray(values[np.argsort(surface.x[:n, 0])])


def getfem(options: Options, factor: float, repeat: int) -> dict[str, Any]:
    """Return what ``getfem_step.py`` printed."""
    command = [sys.executable, str(Path(__file__).with_name("getfem_step.py"))]
    command += [str(a) for a in (options.nx, options.mu, factor, repeat)]
    ran = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return dict(json.loads(ran.stdout.splitlines()[-1]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 256])
    parser.add_argument("--mu", type=float, nargs="+", default=[0.2, 1.0, 5.0])
    parser.add_argument("--factors", type=float, nargs="+", default=[1.0, 10.0])
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    print("mesh       mu  code                   iterations  elastic s  ratio  difference of u")
    for n in arguments.sizes:
        for mu in arguments.mu:
            options = parse_options(f"--nx {n} --ny {n} --mu {mu} --element q1".split())
            _, unit, ratio, report = measure(options, StepSettings(), arguments.repeat)
            row = f"{n:4d}²  {mu:5.1f}  {{:22s}} {{:10}} {{:10.2f}} {{:6.2f}}  {{}}"
            print(row.format("fenicsx_friction", report.iterations, unit, ratio, "certified"))
            exact = certified_displacement(options)
            for factor in arguments.factors:
                found = getfem(options, factor, arguments.repeat)
                error = np.max(abs(np.array(found["u"]) - exact)) / np.max(abs(exact))
                difference = f"{error:.0e}" if found["converged"] else f"{error:.0e}, not converged"
                numbers = (found["iterations"], found["elastic"], found["ratio"], difference)
                print(row.format(f"GetFEM, r = {factor:g} E", *numbers), flush=True)


if __name__ == "__main__":
    main()
