"""A run that is stopped and resumed equals the uninterrupted one; bad files are refused."""

import random
import shutil
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import basix.ufl
import h5py
import numpy as np
import pytest
from dolfinx import fem, mesh

from checkpointed import RUNS, STEPS, bare, painted, square
from fenicsx_friction import CheckpointError
from fenicsx_friction.files.checkpoint import read_checkpoint, write_checkpoint
from fenicsx_friction.files.checkpoint_content import CONTACT_HISTORY
from models import by_place, gathered

#: How close runs are that should be the same: MUMPS on several ranks does not repeat itself.
SAME = 1e-12 if MPI.COMM_WORLD.size == 1 else 1e-9
#: With mpi4py, an exception on one rank ends all.
PYTHON = (sys.executable, "-m", "mpi4py", Path(__file__).with_name("restart_run.py"))
VECTOR = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder that all ranks share."""
    return Path(MPI.COMM_WORLD.bcast(str(tmp_path_factory.mktemp("checkpoints"))))


@pytest.fixture
def path(folder, request):
    return folder / f"{request.node.name}.h5"


def history(problem):
    """Return all that a step needs of the last ones."""
    (contact,) = problem.contacts
    functions = [*problem.unknowns, problem.u_old, contact.c, contact.path, contact.hint]
    motion = contact.obstacle.motion
    return [by_place(f) for f in functions] + ([] if motion is None else motion.save())


@pytest.fixture(scope="module")
def uninterrupted(folder):
    """Run all runs with a checkpoint after each step; keep histories, reports and ends."""
    results = {}
    for name, build in RUNS.items():
        problem, step = build(MPI.COMM_WORLD)
        states, reports = [history(problem)], [None]
        for k in range(1, STEPS + 1):
            reports.append(step(k))
            states.append(history(problem))
            write_checkpoint(folder / f"{name}-{k}.h5", problem, {"time": 0.1 * k})
        results[name] = (states, reports, gathered(problem), build(MPI.COMM_WORLD))
    return results


def close(values, expected, rtol):
    """Tell whether values agree relative to the largest of each array."""
    return all(
        np.max(abs(a - b), initial=0.0) <= rtol * np.max(abs(b), initial=1e-300)
        for a, b in zip(values, expected, strict=True)
    )


# -- stop and resume ------------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("name", RUNS)
def test_resumed_run_equals_the_uninterrupted_one(name, folder, uninterrupted):
    states, reports, _, (problem, step) = uninterrupted[name]
    totals = [r.contacts[0] for r in reports[1:]]
    assert any(t.slip for t in totals) and any(t.stick for t in totals)
    for stop in range(1, STEPS, MPI.COMM_WORLD.size):  # on one rank, after each step
        scalars = read_checkpoint(folder / f"{name}-{stop}.h5", problem)
        assert scalars == {"time": 0.1 * stop}
        assert problem.num_steps == stop
        for k in range(stop, STEPS + 1):
            if k > stop:
                assert step(k).contacts[0].dissipation == pytest.approx(
                    reports[k].contacts[0].dissipation, rel=10 * SAME, abs=1e-18
                )
            assert close(history(problem), states[k], 0.0 if k == stop else SAME)
    assert problem.num_steps == STEPS


@pytest.mark.parametrize("part", ["path", "u_old", "old position"])
def test_without_a_part_of_the_history_the_run_would_differ(part, folder, uninterrupted):
    """The runs above can tell: each part matters to them."""
    for name in ("block",) if part == "old position" else RUNS:
        states, _, _, (problem, step) = uninterrupted[name]
        read_checkpoint(folder / f"{name}-3.h5", problem)
        (contact,) = problem.contacts
        if part == "path":
            contact.path.x.array[:] = 0.0
        elif part == "u_old":
            problem.u_old.x.array[:] = 0.0
        else:
            translation, old, *angles = contact.obstacle.motion.save()
            contact.obstacle.motion.restore([translation, 0.0 * old, *angles])
        for k in range(4, STEPS + 1):
            step(k)
        assert not close([by_place(contact.c)], [states[STEPS][len(problem.unknowns) + 1]], 1e-6)


def test_the_history_of_a_contact_is_complete(uninterrupted):
    """Whoever gives Contact another Function decides here whether it is history."""
    _, _, _, (problem, _) = uninterrupted["block"]
    (contact,) = problem.contacts
    names = {name for name, value in vars(contact).items() if isinstance(value, fem.Function)}
    of_one_step, set_up = (
        {"c_stick", "slipping", "slip_scale"},
        {"free", "r", "scale", "felt", "_u"},
    )
    assert names == {*CONTACT_HISTORY} | of_one_step | set_up


@pytest.mark.quick
@pytest.mark.mpi
def test_last_accepted_step_and_dt_are_restored(folder, uninterrupted):
    _, _, _, (problem, step) = uninterrupted["block"]
    read_checkpoint(folder / "block-3.h5", problem)
    accepted, slip = problem.accepted, problem.contacts[0].slip_increment
    assert float(problem.dt.value) == 0.1 * 3
    read_checkpoint(folder / "block-2.h5", problem)
    assert float(problem.dt.value) == 0.1 * 2
    step(3)
    assert np.max(abs(problem.contacts[0].slip_increment - slip), initial=0.0) <= SAME
    for name in ("gap", "slip", "limit", "c", "area"):
        values = [getattr(a[0], name) for a in (problem.accepted, accepted)]
        assert np.max(abs(values[0] - values[1]), initial=0.0) <= SAME * np.max(
            abs(values[1]), initial=1.0
        )
    assert accepted[0].free.dtype == bool
    assert np.array_equal(problem.accepted[0].states(), accepted[0].states())


@pytest.mark.mpi
def test_before_the_first_step_nothing_is_accepted(comm, path):
    problem = bare(square(comm), [VECTOR], (1,))
    write_checkpoint(path, problem)
    problem.accepted = [None]
    assert read_checkpoint(path, problem) == {}
    assert problem.accepted == []


@pytest.mark.mpi
def test_user_history_and_shared_motions(comm, path):
    msh = square(comm)
    problem = bare(msh, [VECTOR], (1, 2), motions=(0, 1))
    strain = fem.Function(
        fem.functionspace(
            msh, basix.ufl.quadrature_element("triangle", degree=2, value_shape=(2, 2))
        )
    )
    rng = np.random.default_rng(comm.rank)
    strain.x.array[:] = rng.random(strain.x.array.shape)
    strain.x.scatter_forward()
    expected = strain.x.array.copy()
    for k, contact in enumerate(problem.contacts):
        contact.obstacle.motion.translation.value = [1.0 + k, 2.0]
        contact.obstacle.motion.commit()
        contact.obstacle.motion.angle.value = 3.0 + k
    positions = [k.obstacle.motion.save() for k in problem.contacts]
    write_checkpoint(path, problem, {"t": np.float32(0.5), "n": 3}, history=[strain])
    strain.x.array[:] = 0.0
    for contact in problem.contacts:
        contact.obstacle.motion.restore([0.0 * v for v in positions[0]])
    assert read_checkpoint(path, problem, history=[strain]) == {"t": 0.5, "n": 3.0}
    assert np.array_equal(strain.x.array, expected)
    for contact, position in zip(problem.contacts, positions, strict=True):
        assert all(map(np.array_equal, contact.obstacle.motion.save(), position))
    with pytest.raises(CheckpointError, match="number of history functions: 1; here: 0"):
        read_checkpoint(path, problem)


# -- on other numbers of ranks, and killed --------------------------------------------------------


def run(*command):
    result = subprocess.run([*map(str, command)], capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.mark.serial
@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
def test_written_on_n_ranks_read_on_m(tmp_path):
    """N and M of 1 to 3; P1, P2, DG, mixed, quadrature; four cells; coincident bodies."""
    output = run("mpirun", "-n", 3, *PYTHON, "ranks", tmp_path)
    assert output.count("ok") == 5 * 9


@pytest.mark.serial
@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
@pytest.mark.parametrize("name", RUNS)
def test_serial_run_resumed_on_two_ranks(name, folder, uninterrupted):
    run("mpirun", "-n", 2, *PYTHON, "resume", folder, name)
    states, _, expected, (problem, _) = uninterrupted[name]
    with np.load(folder / f"{name}-2.npz") as found:
        assert close([found[key] for key in "xcu"], expected, 1e-8)
    read_checkpoint(folder / f"{name}-end-2.h5", problem)
    assert close(history(problem), states[STEPS], 1e-8)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("work", "result"),
    [
        ("kill", "killed during writing"),
        ("writers", "broken: 0"),
        ("full", "refused: 15 of 15"),
        ("kill_path", "killed and resumed"),
    ],
)
def test_killed_writers_two_writers_full_disks_and_killed_runs(work, result, tmp_path):
    """The published file is whole each time; a killed and resumed run ends as the other."""
    assert result in run(*PYTHON, work, tmp_path)


# -- refused --------------------------------------------------------------------------------------


def refused(path, problem, message):
    """Assert that a file is refused with a message and the problem left as it was."""
    functions = painted(problem)
    before = [f.x.array.copy() for f in functions]
    problem.num_steps = 77
    with pytest.raises(CheckpointError, match=message) as error:
        read_checkpoint(path, problem)
    assert str(path) in str(error.value)
    assert all(np.array_equal(f.x.array, b) for f, b in zip(functions, before, strict=True))
    assert problem.num_steps == 77


@pytest.mark.mpi
def test_truncated_foreign_and_missing_files_are_refused_on_all_ranks(comm, path):
    problem = bare(square(comm), [VECTOR], (1,))
    refused(path, problem, "No such file")
    write_checkpoint(path, problem)
    read_checkpoint(path, problem)
    good = path.read_bytes()

    def store(content):
        comm.barrier()
        if comm.rank == 0:
            path.write_bytes(content)
        comm.barrier()

    for size in (len(good) - 1, len(good) // 2, 2048, 513, 512):
        store(good[:size])
        refused(path, problem, f"truncated: it has {size} of {len(good)} bytes")
    store(good[:300])
    refused(path, problem, "truncated: it has 300 bytes")
    for other in (b"", b"fenicsx", b"# a text\n" * 100, good[512:]):
        store(other)
        refused(path, problem, "is no checkpoint of fenicsx_friction")
    store(good + b"0")
    refused(path, problem, "damaged|truncated")
    store(good.replace(b"checkpoint 2\n", b"checkpoint 9\n", 1))
    refused(path, problem, "has format 9, this version of fenicsx_friction reads format 2")


@pytest.mark.serial
def test_every_flipped_bit_is_refused(comm, path):
    problem = bare(square(comm, 2), [VECTOR], (1,))
    write_checkpoint(path, problem)
    good = path.read_bytes()
    random.seed(3)
    places = [*range(0, 200, 5), 511, *(random.randrange(len(good)) for _ in range(200))]
    for place in places:
        bad = bytearray(good)
        bad[place] ^= 1 << random.randrange(8)
        path.write_bytes(bad)
        with pytest.raises(CheckpointError, match=r"damaged|no checkpoint|truncated|has format"):
            read_checkpoint(path, problem)
    path.write_bytes(good)
    read_checkpoint(path, problem)


P2 = basix.ufl.element("Lagrange", "triangle", 2, shape=(2,))
QUAD = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))


def moved(comm):
    msh = square(comm)
    msh.geometry.x[:, 1] *= 1.0 + 1e-6
    return msh


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda c: bare(square(c, 7), [VECTOR], (1,)), "mesh: 49 nodes, 72 cells.*here: 64 nodes"),
        (lambda c: bare(moved(c), [VECTOR], (1,)), r"of another mesh: a node at \[.*1e-06 m away"),
        (
            lambda c: bare(
                mesh.create_rectangle(c, [[0, 0], [1, 1]], [6, 6], diagonal=mesh.DiagonalType.left),
                [VECTOR],
                (1,),
            ),
            "mesh: 49 nodes, 72 cells",
        ),
        (
            lambda c: bare(
                mesh.create_unit_square(c, 6, 6, mesh.CellType.quadrilateral), [QUAD], (1,)
            ),
            "cell: triangle in 2D; here: quadrilateral in 2D",
        ),
        (lambda c: bare(square(c), [P2], (1,)), "element of unknown 0"),
        (lambda c: bare(square(c), [VECTOR, VECTOR], (1,)), "number of unknowns: 1; here: 2"),
        (lambda c: bare(square(c), [VECTOR], (1, 2)), "number of contacts: 1; here: 2"),
        (lambda c: bare(square(c), [VECTOR]), "number of contacts: 1; here: 0"),
        (lambda c: bare(square(c), [VECTOR], (2,)), "nodes of contact 0: 7,.*here: 7,"),
        (lambda c: bare(square(c), [VECTOR], (1,), (0,)), "obstacles: none; here: 0"),
    ],
)
def test_another_problem_is_refused(comm, folder, build, message):
    path = folder / "written.h5"
    problem = bare(square(comm), [VECTOR], (1,))
    write_checkpoint(path, problem)
    refused(path, build(comm), message)
    rounded = bare(square(comm), [VECTOR], (1,))
    rounded.u.function_space.mesh.geometry.x[:] *= 1.0 + 1e-14
    read_checkpoint(path, rounded)


@pytest.mark.mpi
@pytest.mark.parametrize("element", [("Lagrange", 3, (2,)), ("RT", 2)])
def test_elements_ordered_by_the_partition_are_refused(comm, path, element):
    with pytest.raises(CheckpointError, match="ordered by the partition"):
        write_checkpoint(path, bare(square(comm), [VECTOR, element], (1,)))


# -- what is written, and what cannot be ----------------------------------------------------------


@pytest.mark.mpi
def test_failed_write_keeps_the_old_file(comm, path):
    problem = bare(square(comm), [VECTOR], (1,))
    write_checkpoint(path, problem, {"time": 1.0})
    for bad in ({"time": "late"}, {"time": 1j}, {"time": None}):
        with pytest.raises(CheckpointError, match="was not written: scalars must be a dictionary"):
            write_checkpoint(path, problem, bad)
    assert read_checkpoint(path, problem) == {"time": 1.0}
    with pytest.raises(CheckpointError, match=r"not written.*No such file"):
        write_checkpoint(path.parent / "nowhere" / "file.h5", problem)
    with pytest.raises(CheckpointError, match=r"not written.*a folder, no file"):
        write_checkpoint(path.parent, problem)
    assert not list(path.parent.glob(".*.part"))
    assert not list(path.parent.parent.glob(".*.part"))


def test_the_file_holds_numbers_and_text_only(folder, uninterrupted):
    def check(_, node):
        if isinstance(node, h5py.Dataset):
            assert node.dtype.kind in "fb"
        for value in node.attrs.values():
            assert isinstance(value, str) or np.asarray(value).dtype.kind in "if"

    with h5py.File(folder / "block-3.h5") as file:
        file.visititems(check)
        assert file["numbers"].attrs["num_steps"] == 3
        assert {"fenicsx_friction", "dolfinx"} == {*file.attrs}
    assert b"pickle" not in (folder / "block-3.h5").read_bytes()
