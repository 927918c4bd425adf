"""Kill or interrupt compilations at random moments; the next run always works.

usage: killed_compilation.py {KILL,INT} RANKS COUNT    one run, then the next
       killed_compilation.py beside RANKS COUNT        two runs at once, one of them killed
"""

import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

from fenicsx_friction.base.compilation import NonlinearProblem, compiled

FORMS = 3


def compile_forms(comm):
    """Compile functionals, an expression and a nonlinear problem; check their values."""
    msh = mesh.create_unit_square(comm, 2, 2)
    form, x = compiled(fem.form, comm), ufl.SpatialCoordinate(msh)
    print("ready", os.getpid(), flush=True)
    for k in range(FORMS):
        area = fem.assemble_scalar(form(2 * (1 + k) * x[0] * ufl.dx(msh)))
        assert abs(comm.allreduce(area) - (1 + k)) < 1e-12
    twice = compiled(fem.Expression, comm)(2 * x, np.zeros((1, 2)), comm)
    assert twice.eval(msh, np.array([0], dtype=np.int32)).shape == (1, 1, 2)
    V = fem.functionspace(msh, ("Lagrange", 1))
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = (u**3 + u - 2) * v * ufl.dx
    problem = compiled(NonlinearProblem, comm)(F, u, petsc_options_prefix="k_")
    problem.solve()
    assert abs(u.x.array - 1).max() < 1e-8
    print("done", flush=True)


def start(ranks, cache):
    """Start a run in a session of its own."""
    mpirun = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
    return subprocess.Popen(
        [*mpirun, sys.executable, __file__], env={**os.environ, "XDG_CACHE_HOME": str(cache)},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a job in the background
    )  # fmt: skip


def ready(process, ranks):
    """Wait until all ranks start to compile; return their process numbers."""
    return [int(process.stdout.readline().split()[1]) for _ in range(ranks)]


def leftovers(cache):
    folder = cache / "fenics" / "fenicsx_friction"
    sources = {path.name for path in folder.glob("*.c")}
    return len(sources - {path.name.removesuffix(".cached") for path in folder.glob("*.cached")})


def finish(process):
    """Wait for a run, which must work; return its seconds."""
    begin = time.monotonic()
    output = process.communicate()[0]
    assert process.returncode == 0, output
    assert output.count("done") >= 1, output
    return time.monotonic() - begin


def main(how, ranks, count):
    random.seed(how)
    duration, hit, broken, waits = 0.0, 0, 0, []
    for k in range(-1, count):  # the first one measures how long it takes
        with tempfile.TemporaryDirectory() as folder:
            cache = Path(folder)
            runs = 2 if how == "beside" and k >= 0 else 1
            process, *others = [start(ranks, cache) for _ in range(runs)]
            pids, *_ = [ready(p, ranks) for p in (process, *others)]
            if k < 0:
                duration = finish(process)
                continue
            time.sleep(random.uniform(0.0, duration))
            if how == "INT":
                os.killpg(process.pid, signal.SIGINT)
            else:
                for pid in pids:
                    with contextlib.suppress(ProcessLookupError):  # it is done
                        os.kill(pid, signal.SIGKILL)
            process.communicate()
            hit += process.returncode != 0
            broken += leftovers(cache) > 0
            for other in others or [start(ranks, cache)]:
                waits.append(finish(other))
            assert leftovers(cache) == 0
    print(
        f"{how}, {ranks} ranks: {count} of {count} next runs work; {hit} ended early, "
        f"{broken} with incomplete files; alone {duration:.1f} s, next at most {max(waits):.1f} s",
        flush=True,
    )


if __name__ == "__main__":
    if len(sys.argv) == 1:
        compile_forms(MPI.COMM_WORLD)
    else:
        main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
