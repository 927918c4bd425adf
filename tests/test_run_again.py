"""The same script is run again with a checkpoint: resumed = uninterrupted, adaptive steps too."""

import shutil
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import fenicsx_friction as ff
from bodies import stack
from models import block, by_place
from restart_run import path_run
from sweeps import fingerprint, follow, swept
from test_relaxation import LOAD, arch

#: MUMPS on several ranks does not repeat itself, nor does multigrid.
SAME = 0.0 if MPI.COMM_WORLD.size == 1 else 1e-9
KEPT = []  # PETSc's objects must not be freed on one rank earlier than on another


def swept_script(prefix):
    """Sweep a floor under a block; steps grow up to a stop."""
    model = swept(prefix)
    audit = ff.EnergyAudit(model.problem, model.stored)
    return model.problem, model.loads, audit, {"end": 1.0, "step": 0.1, "easy": 6, "largest": 0.3}


def halved_script(prefix):
    """The same with error control."""
    problem, loads, audit, _ = swept_script(prefix)
    return problem, loads, audit, {"end": 1.0, "step": 0.1, "error": 0.2, "stops": [0.4]}


def arch_script(prefix):
    """An arch snaps: steps are cut, relaxed, and grow again."""
    problem, stored, weight, relaxation, loads = arch(MPI.COMM_WORLD, prefix, 0.3)
    audit = ff.EnergyAudit(problem, stored, weight)
    options = {"step": LOAD / 10, "smallest": LOAD / 40, "relaxation": relaxation}
    return problem, loads, audit, {"end": LOAD, **options}


def stack_script(prefix, **options):
    """A block slides on a deformable base: forces at a step's end depend on its pairs."""
    model = stack(0.4, prefix, upper=(3, 3, 1), **options)
    way = follow([(0, 0, 0), (0, 0, -0.03), (0.1, 0.05, -0.03), (0.05, 0.1, -0.03)])
    audit = ff.EnergyAudit(model.problem, model.stored)
    options = {"end": 3.0, "step": 0.25, "largest": 0.6, "easy": 8}
    return model.problem, lambda t: model.move(*way(t)), audit, options


SCRIPTS = {
    "swept": swept_script,
    "halved": halved_script,
    "arch": arch_script,
    "stack": stack_script,
    "mortar": lambda prefix: stack_script(prefix, method="mortar"),
}


def run(make, prefix, folder, count=None, **options):
    """Run a script, or its next steps only; return what was seen after each of them."""
    problem, loads, audit, given = make(prefix)
    KEPT.append(problem)
    files = {"checkpoint": folder / "run.h5", "events": folder / "events.csv"}
    options = {"progress": False, "audit": audit} | files | given | options
    seen = []
    for record in ff.LoadStepper(problem, loads, **options):
        steps = (record.time, record.step, record.report.iterations)
        seen.append((steps, record.energy, fingerprint(problem), by_place(problem.u)))
        if len(seen) == count:
            break
    problem.comm.barrier()
    return seen


@pytest.fixture
def folders(tmp_path):
    """Folders that all ranks share."""
    top = Path(MPI.COMM_WORLD.bcast(str(tmp_path)))
    for name in ("whole", "cut"):
        (top / name).mkdir(exist_ok=True)
    return top / "whole", top / "cut"


def assert_same(expected, found):
    """Compare runs: bit for bit on one rank."""
    assert [steps for steps, *_ in expected] == [steps for steps, *_ in found]
    for (_, energy, bits, u), (_, energy_found, bits_found, u_found) in zip(
        expected, found, strict=True
    ):
        if SAME == 0.0:
            assert energy == energy_found
            assert bits == bits_found
        assert np.max(abs(u - u_found)) <= SAME * np.max(abs(u))
        assert energy_found.stored == pytest.approx(energy.stored, rel=1e-6, abs=1e-9)


def events(log):
    """Return the events of a log in order, without the numbers of the nodes."""
    found = []
    for step, _, x, *states in (line.split(",") for line in log[1:]):
        place = [round(float(value), 9) + 0.0 for value in x.split()]
        found.append((int(step), place, states))
    return sorted(found)


@pytest.mark.mpi
@pytest.mark.parametrize("name", SCRIPTS)
def test_cut_anywhere_it_goes_on_as_if_it_had_not_been(name, folders):
    whole, cut = folders
    expected = run(SCRIPTS[name], f"{name}_whole_", whole)
    sizes = {round(steps[1], 9) for steps, *_ in expected}
    assert len(sizes) > 2  # adaptive
    first = run(SCRIPTS[name], f"{name}_first_", cut, 2)
    second = run(SCRIPTS[name], f"{name}_second_", cut, 3)
    rest = run(SCRIPTS[name], f"{name}_rest_", cut)
    # Of two halves, the second one ends the step: a cut between them repeats the first.
    start = 2 + (2 if name == "halved" else 3)
    assert_same(expected, [*first, *second[: start - 2], *rest])
    logs = [(folder / "events.csv").read_text().splitlines() for folder in folders]
    if MPI.COMM_WORLD.size < 3:  # else equal meshes may be divided in two ways, with other numbers
        assert logs[0] == logs[1]
    assert events(logs[0]) == events(logs[1]) and len(logs[0]) > 4
    assert run(SCRIPTS[name], f"{name}_again_", cut) == []


def test_an_old_checkpoint_goes_on_with_the_first_size_and_says_so(folders):
    """It holds the time only: the path takes other steps, which the tests above would see."""
    whole, cut = folders
    expected = run(swept_script, "new_", whole, audit=None)
    problem, loads, _, options = swept_script("old_")
    KEPT.append(problem)
    for record in ff.LoadStepper(problem, loads, progress=False, **options):
        if record.report.step == 3:
            ff.write_checkpoint(cut / "run.h5", problem, {"time": record.time})
            break
    with pytest.warns(UserWarning, match="does not hold the size of the next step"):
        rest = run(swept_script, "old_rest_", cut, audit=None)
    assert rest[0][0][1] == pytest.approx(0.1) and expected[3][0][1] > 0.2
    assert rest[-1][0][0] == 1.0 and 3 + len(rest) > len(expected)


@pytest.mark.mpi
def test_a_checkpoint_that_is_of_no_such_path_is_refused(folders):
    _, cut = folders
    problem, loads, audit, options = swept_script("foreign_")
    KEPT.append(problem)
    options = {"checkpoint": cut / "run.h5", "progress": False} | options
    ff.write_checkpoint(cut / "run.h5", problem, {"load": 1.0})
    problem.u.x.array[:] = 7.0
    with pytest.raises(ff.CheckpointError, match=r"run\.h5' holds no number 'time'"):
        ff.LoadStepper(problem, loads, **options)
    assert np.all(problem.u.x.array == 7.0)
    ff.write_checkpoint(cut / "run.h5", problem, {"time": 0.5})
    with pytest.raises(ff.CheckpointError, match="number of history functions: 0; here: 2"):
        ff.LoadStepper(problem, loads, audit=audit, **options)
    with pytest.raises(ff.ContactInputError, match=r"time 0\.5 only, .* before its start, 0\.7"):
        with pytest.warns(UserWarning, match="size of the next step"):
            ff.LoadStepper(problem, loads, start=0.7, **options)
    for bad in (7, b"run.h5"):
        with pytest.raises(ff.ContactInputError, match=r"checkpoint = .* the name of a file"):
            ff.LoadStepper(problem, loads, **options | {"checkpoint": bad})


@pytest.mark.quick
@pytest.mark.mpi
def test_paths_follow_each_other_with_one_file(folders):
    """Press, then slide; the second path begins with its own size of step."""

    def script(prefix, folder, stop=None):
        model = block("hexahedron", 0.4, prefix, n=(2, 2, 1))
        KEPT.append(model)
        way, seen = follow([(0, 0, 0), (0, 0, -0.01), (0.02, 0.01, -0.01)]), []

        def loads(upto):
            def move(t):
                assert t <= upto
                model.move(*way(t))

            return move

        for start, step in ((0.0, 0.5), (1.0, 0.25)):
            options = {"start": start, "end": start + 1.0, "step": step, "largest": 0.5}
            stepper = ff.LoadStepper(
                model.problem,
                loads(start + 1.0),
                checkpoint=folder / "run.h5",
                progress=False,
                **options,
            )
            for record in stepper:
                seen.append((record.time, model.problem.u.x.array.copy()))
                if len(seen) == stop:
                    return seen
        return seen

    whole, cut = folders
    expected = script("two_whole_", whole)
    assert expected[2][0] == 1.25
    found = [s for k in range(8) for s in script(f"two_{k}_", cut, 1)]
    assert [t for t, _ in found] == [t for t, _ in expected]
    for (_, u), (_, v) in zip(expected, found, strict=True):
        assert np.max(abs(u - v)) <= SAME * np.max(abs(u))


@pytest.mark.serial
@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
def test_begun_on_two_ranks_it_goes_on_on_one(folders):
    cut = folders[1]
    command = (sys.executable, "-m", "mpi4py", Path(__file__).with_name("restart_run.py"))
    command = map(str, ("mpirun", "--oversubscribe", "-n", 2, *command, "some", cut))
    assert subprocess.run([*command], capture_output=True, text=True).returncode == 0
    expected, found = (path_run(MPI.COMM_SELF, f"on_{f.name}_", f) for f in folders)
    assert len(expected) > len(found) > 4
    for (time, u), (time_found, u_found) in zip(expected[-len(found) :], found, strict=True):
        assert time == time_found
        assert np.max(abs(u - u_found)) <= 1e-9 * np.max(abs(u))


def test_what_the_solver_has_learnt_is_forgotten(folders):
    """Levels of multigrid from steps before would change iterations, and so sizes of steps."""
    model = block("hexahedron", 0.4, "levels_", n=(4, 4, 3), linear_solver="multigrid")
    way = follow([(0, 0, 0), (0, 0, -0.01), (0.002, 0.001, -0.01)])
    options = {"end": 2.0, "step": 1.0, "progress": False}
    stepper = ff.LoadStepper(
        model.problem, lambda t: model.move(*way(t)), checkpoint=folders[0] / "run.h5", **options
    )
    assert all(record.report.set_ups >= 1 for record in stepper)
