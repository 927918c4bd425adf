"""Forms compile although an earlier compilation was killed, and beside a living one."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from mpi4py import MPI

import pytest
import ufl
from dolfinx import fem, mesh

from fenicsx_friction.base import compilation
from fenicsx_friction.base.compilation import NonlinearProblem, compiled, remove_leftovers

SCRIPT = Path(__file__).with_name("killed_compilation.py")


@pytest.fixture
def cache(tmp_path, comm):
    """A fresh cache folder, the same on all ranks; DOLFINx waits a second only for other ranks."""
    return {"cache_dir": comm.bcast(tmp_path), "timeout": 1}


def folder_of(cache):
    return cache["cache_dir"] / "fenicsx_friction"


def area(comm, factor, cache, form):
    msh = mesh.create_unit_square(comm, 2, 2)
    compiled_form = form(factor * ufl.dx(msh), jit_options=cache)
    return comm.allreduce(fem.assemble_scalar(compiled_form)) / factor


def break_entries(comm, folder, remove):
    """Make entries as a killed compilation leaves them; return their sources."""
    comm.Barrier()
    if comm.rank == 0:
        for path in folder.iterdir():
            if path.name.endswith(remove):
                path.unlink()
    comm.Barrier()
    return sorted(folder.glob("*.c"))


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("remove", [(".cached", ".so", ".o"), (".cached",)])
def test_leftover_of_this_run_is_replaced(remove, cache, comm):
    form = compiled(fem.form, comm)
    assert area(comm, 2.0, cache, form) == pytest.approx(1.0)
    break_entries(comm, folder_of(cache), remove)
    assert area(comm, 2.0, cache, form) == pytest.approx(1.0)


@pytest.mark.mpi
def test_without_the_net_it_fails(cache, comm):
    """What the other tests hold against: FFCx waits and gives up."""
    form = compiled(fem.form, comm)
    area(comm, 3.0, cache, form)
    break_entries(comm, folder_of(cache), (".cached",))
    plain = {**cache, "cache_dir": folder_of(cache)}
    with pytest.raises((TimeoutError, RuntimeError), match="JIT compilation"):
        area(comm, 3.0, plain, fem.form)


@pytest.mark.parametrize("remove", [".so", ".c", ".c.cached"])
def test_first_use_removes_incomplete_entries(remove, cache):
    area(MPI.COMM_SELF, 4.0, cache, compiled(fem.form, MPI.COMM_SELF))
    area(MPI.COMM_SELF, 5.0, cache, compiled(fem.form, MPI.COMM_SELF))
    folder = folder_of(cache)
    victim, *others = sorted(folder.glob("*.c"))
    kept = {path for path in folder.iterdir() if not path.name.startswith(victim.stem)}
    next(path for path in folder.glob(f"{victim.stem}*") if path.name.endswith(remove)).unlink()
    assert remove_leftovers(folder)
    assert set(folder.iterdir()) == kept
    assert others[0] in kept


def test_failed_problem_is_made_again(cache):
    """The first attempt fails in the constructor of the DOLFINx class."""
    msh = mesh.create_unit_square(MPI.COMM_SELF, 2, 2)
    V = fem.functionspace(msh, ("Lagrange", 1))
    u, v = fem.Function(V), ufl.TestFunction(V)

    def solve():
        F, problem = (u**5 + u - 2) * v * ufl.dx, compiled(NonlinearProblem, MPI.COMM_SELF)
        problem(F, u, petsc_options_prefix="compilation_", jit_options=cache).solve()
        assert abs(u.x.array - 1).max() < 1e-8

    solve()
    break_entries(MPI.COMM_SELF, folder_of(cache), (".cached",))
    solve()


@pytest.fixture
def other(tmp_path):
    """Another process in the middle of a compilation; ends when its input is closed."""
    code = (
        "import sys; from pathlib import Path; from mpi4py import MPI\n"
        "from fenicsx_friction.base.compilation import compiled\n"
        "def compile(jit_options):\n"
        "    source = Path(jit_options['cache_dir']) / 'libffcx_forms_0.c'\n"
        "    source.touch(); print('compiling', flush=True); sys.stdin.read()\n"
        "    assert source.exists(); source.unlink()\n"
        "compiled(compile, MPI.COMM_SELF)(jit_options={'cache_dir': sys.argv[1]})\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdout.readline() == b"compiling\n"
    yield process
    process.kill()
    process.communicate()


def test_living_compilation_is_left_alone(cache, other):
    source = folder_of(cache) / "libffcx_forms_0.c"
    assert not remove_leftovers(folder_of(cache))
    assert area(MPI.COMM_SELF, 6.0, cache, compiled(fem.form, MPI.COMM_SELF)) == pytest.approx(1.0)
    assert source.exists()
    other.communicate(b"")
    assert other.returncode == 0


def test_killed_compilation_is_dead(cache, other):
    source = folder_of(cache) / "libffcx_forms_0.c"
    other.kill()
    other.wait()
    assert source.exists()
    assert remove_leftovers(folder_of(cache))
    assert not source.exists()


def test_wait_for_another_process_ends_with_a_clear_error(cache, other, monkeypatch):
    monkeypatch.setattr(compilation, "PATIENCE", 2.0)
    monkeypatch.setattr(compilation, "PAUSE", 0.1)
    form = compiled(fem.form, MPI.COMM_SELF)
    area(MPI.COMM_SELF, 7.0, cache, form)
    (source, *_) = break_entries(MPI.COMM_SELF, folder_of(cache), (".cached",))
    with pytest.raises(TimeoutError, match=rf"{folder_of(cache)}: another process .* remove it"):
        area(MPI.COMM_SELF, 7.0, cache, form)
    assert source.exists()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_run_after_a_killed_or_interrupted_one_works(number, tmp_path):
    """See killed_compilation.py, which does this at random moments."""
    process = subprocess.Popen(
        [sys.executable, SCRIPT], env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    folder = tmp_path / "fenics" / "fenicsx_friction"
    while not list(folder.glob("*.c")):
        assert process.poll() is None, process.communicate()[0]
        time.sleep(1e-3)
    process.send_signal(number)
    process.communicate()
    assert process.returncode == -number
    assert bool(list(folder.glob("*.c"))) == (number == signal.SIGKILL)  # the other cleans up
    subprocess.run([sys.executable, SCRIPT], env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)},
                   check=True)  # fmt: skip
