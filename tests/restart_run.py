"""What test_checkpoint.py needs other processes for.

mpirun -n 3 python3 restart_run.py ranks FOLDER
mpirun -n 2 python3 restart_run.py resume FOLDER RUN
mpirun -n 2 python3 restart_run.py some FOLDER
python3 restart_run.py kill|writers|full|kill_path FOLDER
"""

import faulthandler
import itertools
import os
import random
import resource
import shutil
import signal
import sys
import time
from pathlib import Path

from mpi4py import MPI

import h5py
import numpy as np
from dolfinx import fem, mesh

import fenicsx_friction as ff
from checkpointed import RUNS, STEPS, bare, elements, painted, parts, square, two_bodies
from fenicsx_friction.files.checkpoint import read_checkpoint, write_checkpoint
from models import gathered, raous

MESHES = {
    "triangle": square,
    "quadrilateral": lambda c: mesh.create_unit_square(c, 4, 5, mesh.CellType.quadrilateral),
    "tetrahedron": lambda c: mesh.create_unit_cube(c, 3, 2, 2),
    "hexahedron": lambda c: mesh.create_unit_cube(c, 3, 2, 2, mesh.CellType.hexahedron),
    "bodies": two_bodies,
}


def ranks(folder):
    """Write on N and read on M ranks, for all N and M up to the number of ranks."""
    world = MPI.COMM_WORLD
    comms = [world.Split(0 if world.rank < n else 1) for n in range(1, world.size + 1)]
    mine = [comm if world.rank < n else None for n, comm in enumerate(comms, 1)]
    for name, make in MESHES.items():
        tags = (1,) if name == "bodies" else (1, 2)
        problems = [bare(msh, elements(msh), tags) for msh in (make(comm) for comm in mine if comm)]
        problems = [None] * (world.size - len(problems)) + problems
        for n, writer in enumerate(problems, 1):
            path = folder / f"{name}-{n}.h5"
            if writer is not None:
                painted(writer)
                write_checkpoint(path, writer, {"ranks": n})
            world.barrier()
            for m, reader in enumerate(problems, 1):
                if reader is None:
                    continue
                functions = painted(reader)
                expected = [f.x.array.copy() for f in functions]
                for f in functions:
                    f.x.array[:] = np.nan
                assert read_checkpoint(path, reader) == {"ranks": n}
                for f, values in zip(functions, expected, strict=True):
                    np.testing.assert_allclose(f.x.array, values, rtol=1e-13, atol=0.0)
                if reader.comm.rank == 0:
                    print(name, n, m, "ok", flush=True)


def resume(folder, name):
    """Go on with a run from step 3 and save its end, on all ranks."""
    problem, step = RUNS[name](MPI.COMM_WORLD)
    assert read_checkpoint(folder / f"{name}-3.h5", problem) == {"time": 0.1 * 3}
    for k in range(4, STEPS + 1):
        step(k)
    x, c, u = gathered(problem)
    write_checkpoint(folder / f"{name}-end-{problem.comm.size}.h5", problem)
    if problem.comm.rank == 0:
        np.savez(folder / f"{name}-{problem.comm.size}.npz", x=x, c=c, u=u)


def marked(n=60):
    """Return a problem of one contact and what writes it with all values equal to a number."""
    problem = bare(square(MPI.COMM_SELF, n), [("Lagrange", 2, (2,))], (1,))
    functions = [*problem.unknowns, problem.u_old, problem.contacts[0].c]

    def write(path, k):
        problem.num_steps = k
        for f in functions:
            f.x.array[:] = k
        write_checkpoint(path, problem, {"k": k})

    def read(path):
        found = read_checkpoint(path, problem)["k"]
        assert found == problem.num_steps
        assert all(np.all(f.x.array == found) for f in functions)
        return int(found)

    return write, read


def child(work):
    """Fork; do the work in the child and end it."""
    if (pid := os.fork()) == 0:
        work()
        os._exit(0)
    return pid


def kill(folder):
    """Kill writers at random moments; the file is complete each time.

    At least 24 times, five of them while a part of a file is on the disk: a busy machine may let
    a writer end before the signal reaches it.
    """
    path, number, kills, during = folder / "killed.h5", 0, 0, 0
    write, read = marked()
    start = time.perf_counter()
    write(path, 0)
    duration = time.perf_counter() - start
    random.seed(1)

    def work():
        for k in itertools.count(number + 1):
            write(path, k)

    while kills < 24 or during < 5:
        pid = child(work)
        time.sleep(random.uniform(0.2, 3.0) * duration)
        while kills % 4 == 0 and not parts(path):  # every fourth one while it writes to the disk
            pass
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        kills += 1
        during += len(parts(path)) > 0
        assert len(parts(path)) <= 1  # the next write removes what a killed one left
        found = read(path)
        assert found >= number
        number = found
    write(path, number + 1)
    assert not parts(path)
    print(f"killed during writing: {during} of {kills}, last: {number}, seconds: {duration:.3f}")


def writers(folder):
    """Two processes write one file 100 times each, a third reads it; a link is in the way."""
    path, reads = folder / "shared.h5", 0
    write, read = marked(12)
    write(path, 0)
    victim = folder / "victim"
    victim.write_text("not to be touched")
    path.with_name(f".{path.name}.part").symlink_to(victim)
    children = [child(lambda n=n: [write(path, n + k) for k in range(100)]) for n in (0, 1000)]
    while children:
        read(path)
        reads += 1
        for pid in list(children):
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                assert status == 0
                children.remove(pid)
    assert read(path) in (99, 1099)
    assert victim.read_text() == "not to be touched"
    assert [p.name for p in parts(path)] == [f".{path.name}.part"]
    print("reads:", reads, "broken: 0")


def full(folder):
    """Write again and again beyond the largest size of a file: no room, as on a full disk."""
    path, refused = folder / "full.h5", 0
    write, read = marked(20)
    write(path, 1)
    size = path.stat().st_size
    for k in range(15):
        resource.setrlimit(resource.RLIMIT_FSIZE, (k * size // 15, resource.RLIM_INFINITY))
        try:
            write(path, 2)
        except ff.CheckpointError as error:
            refused += "was not written: OSError" in str(error)
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        assert read(path) == 1
        assert not parts(path)
    write(path, 3)
    assert read(path) == 3
    print("refused:", refused, "of 15")


def path_run(comm, prefix, folder, count=None):
    """Go on along a path of adaptive steps, with event log and history; return times and u."""
    model = raous(4, 4, 0.5, prefix, comm=comm)
    sums, seen = fem.Function(model.problem.u.function_space), []

    def update():
        sums.x.array[:] += model.problem.u.x.array

    stepper = ff.LoadStepper(
        model.problem,
        lambda t: model.load(2.0 * np.sin(t) ** 2, 0.5 + 0.1 * t),
        end=3.0,
        step=0.05,
        largest=0.2,
        easy=2,
        stops=[0.25, 1.0],
        history=[sums],
        update=update,
        events=folder / "events.csv",
        checkpoint=folder / "path.h5",
        progress=False,
    )
    for record in stepper:
        seen.append((record.time, np.append(model.problem.u.x.array, sums.x.array)))
        if len(seen) == count:
            break
    return seen


def some(folder):
    """Make the first steps of the path, on all ranks."""
    path_run(MPI.COMM_WORLD, "some_", folder, 6)


def kill_path(folder):
    """Kill a run at random moments, resume it; it ends as the one that was not killed.

    At least ten times, three of them with a checkpoint on the way. A run that comes to its end
    before, on a machine that has become faster, begins anew.
    """
    comm = MPI.COMM_SELF
    for name in ("whole", "killed"):
        (folder / name).mkdir()
    start = time.perf_counter()
    whole = path_run(comm, "kill_whole_", folder / "whole")
    steps = len(whole)
    duration = time.perf_counter() - start
    random.seed(2)
    kills, middle = 0, 0
    while kills < 10 or middle < 3:
        pid = child(lambda: path_run(comm, "killed_", folder / "killed"))
        time.sleep(random.uniform(0.0, 0.3) * duration)
        os.kill(pid, signal.SIGKILL)
        if not os.WIFSIGNALED(os.waitpid(pid, 0)[1]):
            shutil.rmtree(folder / "killed")
            (folder / "killed").mkdir()
            continue
        kills += 1
        if (file := folder / "killed" / "path.h5").exists():
            with h5py.File(file) as h5:
                middle += 0 < h5["numbers"].attrs["num_steps"] < steps
    last = path_run(comm, "last_", folder / "killed")
    if last:
        assert [t for t, _ in last] == [t for t, _ in whole[-len(last) :]]
        assert np.array_equal(last[-1][1], whole[-1][1])
    assert path_run(comm, "end_", folder / "killed") == []
    logs = [(folder / name / "events.csv").read_text() for name in ("whole", "killed")]
    assert logs[0] == logs[1]
    assert logs[0].count("\n") > 10
    print("killed and resumed:", kills, "on the way:", middle, "seconds a run:", duration)


if __name__ == "__main__":
    faulthandler.dump_traceback_later(1500, exit=True)
    works = (ranks, resume, kill, writers, full, some, kill_path)
    {work.__name__: work for work in works}[sys.argv[1]](Path(sys.argv[2]), *sys.argv[3:])
