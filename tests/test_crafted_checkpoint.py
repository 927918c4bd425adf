"""Checkpoints with a right SHA-256 and wrong content, and paths that are no files: all refused."""

import hashlib
import io
import os
import threading
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

import basix.ufl
import h5py
import numpy as np
import pytest
from dolfinx import fem

from checkpointed import bare, painted, parts, square
from fenicsx_friction import CheckpointError, ContactInputError
from fenicsx_friction.base import atomic_file
from fenicsx_friction.certificate.nodal_state import NodalState
from fenicsx_friction.files import checkpoint_content
from fenicsx_friction.files.checkpoint import read_checkpoint, write_checkpoint

VECTOR = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))


@pytest.fixture
def path(tmp_path):
    """A file of a folder that all ranks share."""
    return Path(MPI.COMM_WORLD.bcast(str(tmp_path))) / "state.h5"


def stepped(comm):
    """Return a problem that has an accepted step, and a moving obstacle."""
    problem = bare(square(comm), [VECTOR], (1,), motions=(0,))
    painted(problem)
    (contact,) = problem.contacts
    n = contact.surface.num_owned
    rows = np.arange(2.0 * n).reshape(n, 2)
    free = np.ones((n, 2), dtype=bool)
    state = NodalState(rows[:, 0], rows[:, :1], rows[:, 0], rows, rows[:, 0], rows[:, 0], free)
    problem.accepted, problem.num_steps = [state], 1
    contact.slip_increment = rows
    return problem


def state_of(problem):
    """Return all that a checkpoint may change, as bytes."""
    (contact,) = problem.contacts
    functions = [*problem.unknowns, problem.u_old, contact.c, contact.path, contact.hint]
    values = [f.x.array for f in functions] + contact.obstacle.motion.save()
    values += [problem.dt.value, contact.slip_increment]
    values += [getattr(a, name) for a in problem.accepted for name in ("gap", "c", "free")]
    return [v.tobytes() for v in values] + [problem.num_steps, len(problem.accepted)]


def change(path, work):
    """Change the HDF5 part of a file and seal it again."""
    content = io.BytesIO(path.read_bytes())
    with h5py.File(content, "r+") as h5:
        work(h5)
    rest = content.getvalue()[512:]
    text = f"fenicsx_friction checkpoint 2\nbytes {512 + len(rest)}\n"
    text += f"sha256 {hashlib.sha256(rest).hexdigest()}\n"
    path.write_bytes(text.encode().ljust(512, b"\n") + rest)


def replaced(name, values):
    """Return what replaces an array of a file."""

    def work(h5):
        old = h5[name][...]
        del h5[name]
        h5[name] = values(old)

    return work


def deleted(name):
    return lambda h5: h5.__delitem__(name)


def attribute(group, name, value):
    return lambda h5: h5[group].attrs.__setitem__(name, value)


def spoiled(value):
    def values(old):
        old.ravel()[-1] = value
        return old

    return values


def linked(h5):
    """Let an array be one of another file."""
    del h5["values/u_old"]
    h5["values/u_old"] = h5py.ExternalLink("elsewhere.h5", "/values/u_old")


def elsewhere(h5):
    """Let the numbers of an array lie in another file."""
    old = h5["values/u_old"][...]
    del h5["values/u_old"]
    h5["values"].create_dataset(
        "u_old", old.shape, old.dtype, external=[("elsewhere", 0, old.nbytes)]
    )


CRAFTED = {
    "nothing": lambda h5: [h5.__delitem__(name) for name in list(h5)],
    **{f"no {n}": deleted(n) for n in ("problem", "numbers", "scalars", "mesh", "values")},
    "no unknown": deleted("values/unknown 0"),
    "no slip path": deleted("values/contact 0/path"),
    "no motion": deleted("motions/0"),
    "no gap": deleted("values/accepted 0/gap"),
    "no slip increment": deleted("values/accepted 0/slip_increment"),
    "no last step": lambda h5: [
        h5.__delitem__(f"values/accepted 0/{n}") for n in list(h5["values/accepted 0"]) if n != "c"
    ],
    "no number of steps": lambda h5: h5["numbers"].attrs.__delitem__("num_steps"),
    "group for an array": lambda h5: (deleted("values/u_old")(h5), h5.create_group("values/u_old")),
    "array for a group": lambda h5: (deleted("values")(h5), h5.__setitem__("values", [1.0])),
    "one array more": lambda h5: h5.__setitem__("values/accepted 0/colour", [1.0]),
    "contact too many": lambda h5: h5.__setitem__("values/accepted 1/gap", [1.0]),
    "rows missing": replaced("values/u_old", lambda old: old[:-1]),
    "columns missing": replaced("values/unknown 0", lambda old: old[:, :1]),
    "flat": replaced("values/unknown 0", lambda old: old.ravel()),
    "scalar": replaced("values/unknown 0", lambda old: 1.0),
    "gap of two columns": replaced("values/accepted 0/gap", lambda old: np.c_[old, old]),
    "slip of two columns": replaced("values/accepted 0/slip", lambda old: np.c_[old, old]),
    "nodes missing": replaced("mesh", lambda old: old[:-1]),
    "motion too long": replaced("motions/0", lambda old: np.r_[old, old]),
    "integers": replaced("values/u_old", lambda old: old.astype(int)),
    "single precision": replaced("values/u_old", lambda old: old.astype(np.float32)),
    "complex": replaced("values/u_old", lambda old: old + 1j),
    "texts": replaced("values/u_old", lambda old: np.full(old.shape, b"one")),
    "texts of any length": replaced("values/u_old", lambda old: np.full(old.shape, "one", object)),
    "free as numbers": replaced("values/accepted 0/free", lambda old: old.astype(float)),
    **{
        f"{value} in {name}": replaced(name, spoiled(value))
        for value in (np.nan, np.inf)
        for name in (
            "mesh",
            "motions/0",
            "values/u_old",
            "values/unknown 0",
            "values/contact 0/hint",
            "values/accepted 0/limit",
            "values/accepted 0/slip_increment",
        )
    },
    "dt NaN": attribute("numbers", "dt", np.nan),
    "dt a text": attribute("numbers", "dt", "1"),
    "dt an array": attribute("numbers", "dt", [1.0, 2.0]),
    "steps negative": attribute("numbers", "num_steps", -1),
    "steps halved": attribute("numbers", "num_steps", 0.5),
    "time NaN": attribute("scalars", "time", np.nan),
    "time a text": attribute("scalars", "time", "late"),
    "description an array": attribute("problem", "cell", [1.0, 2.0]),
    "link to another file": linked,
    "numbers in another file": elsewhere,
}


@pytest.mark.mpi
@pytest.mark.parametrize("name", CRAFTED)
def test_crafted_content_is_refused_and_changes_nothing(comm, path, name, monkeypatch):
    """On all ranks alike, before anything is changed."""
    problem = stepped(comm)
    write_checkpoint(path, problem, {"time": 1.0})
    monkeypatch.chdir(path.parent)
    if comm.rank == 0:
        (path.parent / "elsewhere").write_bytes(bytes(10000))
        (path.parent / "elsewhere.h5").write_bytes(path.read_bytes())
        change(path, CRAFTED[name])
    problem.unknowns[0].x.array[:] = 5.0
    problem.num_steps = 77
    before = state_of(problem)
    with pytest.raises(CheckpointError, match=r"Checkpoint '.*state\.h5' (is |holds |')"):
        read_checkpoint(path, problem)
    assert state_of(problem) == before


@pytest.mark.mpi
def test_the_same_file_uncrafted_is_read(comm, path):
    problem = stepped(comm)
    expected = state_of(problem)
    write_checkpoint(path, problem, {"time": 1.0})
    if comm.rank == 0:
        change(path, lambda h5: None)
    for f in (*problem.unknowns, problem.u_old):
        f.x.array[:] = 0.0
    problem.accepted, problem.num_steps = [], 0
    assert read_checkpoint(path, problem) == {"time": 1.0}
    assert state_of(problem) == expected


@pytest.mark.mpi
def test_nodal_values_may_get_further_optional_fields(comm, path, monkeypatch):
    """Files without them are read, those with them only by who knows them."""

    @dataclass(frozen=True)
    class Extended(NodalState):
        wear: np.ndarray | None = None
        stage: np.ndarray | None = None

    problem = stepped(comm)
    write_checkpoint(path, problem)
    monkeypatch.setattr(checkpoint_content, "NodalState", Extended)
    read_checkpoint(path, problem)
    (state,) = problem.accepted
    assert isinstance(state, Extended) and state.wear is None
    n = len(state.gap)
    wear, stage = np.arange(3.0 * n).reshape(n, 3), np.arange(n, dtype=np.int8)
    problem.accepted = [Extended(**{**vars(state), "wear": wear, "stage": stage})]
    write_checkpoint(path, problem)
    problem.accepted = []
    read_checkpoint(path, problem)
    assert np.array_equal(problem.accepted[0].wear, wear)
    assert problem.accepted[0].stage.dtype == np.int8
    monkeypatch.undo()
    with pytest.raises(CheckpointError, match=r"holds 'accepted 0/stage', which is unknown here"):
        read_checkpoint(path, problem)


# -- what is not written, for it could not be read ------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_are_not_written(comm, path, value):
    problem = stepped(comm)
    write_checkpoint(path, problem)
    good = path.read_bytes()
    comm.barrier()
    with pytest.raises(CheckpointError, match=r"not written: scalars must be .* 'time' is"):
        write_checkpoint(path, problem, {"time": value})
    problem.contacts[0].obstacle.motion.angle.value = value
    with pytest.raises(CheckpointError, match="not written: 'motions/0' holds numbers"):
        write_checkpoint(path, problem)
    if comm.rank == comm.size - 1:
        problem.u_old.x.array[0] = value
    with pytest.raises(CheckpointError, match="not written: 'u_old' holds numbers"):
        write_checkpoint(path, problem)
    assert path.read_bytes() == good


@pytest.mark.mpi
@pytest.mark.parametrize("history", [5, "strain", [1.0], None, [None]])
def test_history_that_is_none_is_refused(comm, path, history):
    problem = stepped(comm)
    for work in (write_checkpoint, read_checkpoint):
        with pytest.raises(ContactInputError, match="history"):
            work(path, problem, history=history)
        with pytest.raises(ContactInputError, match="problem = "):
            work(problem, path)
    assert not path.exists()


@pytest.mark.mpi
@pytest.mark.parametrize("scalars", [5, "time", [1.0], {"a": "b"}, {"a": [1.0, 2.0]}])
def test_scalars_that_are_none_are_refused(comm, path, scalars):
    with pytest.raises(CheckpointError, match="not written: scalars must be a dictionary"):
        write_checkpoint(path, stepped(comm), scalars)


# -- paths and parts ------------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["a pipe", "a folder", "a device"])
def test_paths_that_are_no_files_are_refused_at_once(comm, path, kind):
    """A pipe would wait for its other end for ever, a device would be replaced."""
    if comm.rank == 0:
        {
            "a pipe": os.mkfifo,
            "a folder": os.mkdir,
            "a device": lambda p: p.symlink_to("/dev/null"),
        }[kind](path)
    comm.barrier()
    problem = stepped(comm)
    before = path.lstat().st_mode
    for work in (write_checkpoint, read_checkpoint):
        with pytest.raises(CheckpointError, match=f"is {kind}, no file"):
            work(path, problem)
    assert path.lstat().st_mode == before
    assert not parts(path)


@pytest.mark.mpi
@pytest.mark.parametrize("call", ["fsync", "replace", "open"])
def test_a_failure_of_the_disk_is_one_on_all_ranks(comm, path, call, monkeypatch):
    """The old file stays, no part does."""
    problem = stepped(comm)
    write_checkpoint(path, problem, {"k": 1})

    def no_room(*_, **__):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(atomic_file.os, call, no_room)
        with pytest.raises(CheckpointError, match=r"not written: OSError.*No space left"):
            write_checkpoint(path, problem, {"k": 2})
    comm.barrier()
    assert read_checkpoint(path, problem) == {"k": 1}
    assert not parts(path)


def test_new_files_have_the_mode_of_any_new_file(path):
    for mask in (0o022, 0o077, 0o002):
        old = os.umask(mask)
        try:
            atomic_file.replace_file(path, b"new")
        finally:
            os.umask(old)
        assert path.stat().st_mode & 0o777 == 0o666 & ~mask


def test_a_link_with_the_name_of_a_part_is_not_followed(path, monkeypatch):
    """Not even if somebody guesses the name."""
    victim = path.with_name("victim")
    victim.write_bytes(b"untouched")
    monkeypatch.setattr(atomic_file.secrets, "token_hex", lambda n: "0" * 16)
    path.with_name(f".{path.name}.{'0' * 16}.part").symlink_to(victim)
    with pytest.raises(FileExistsError):
        atomic_file.replace_file(path, b"new")
    assert victim.read_bytes() == b"untouched"
    assert not path.exists()


def test_only_parts_of_dead_writers_are_removed(path):
    """A part that is locked has a writer; files of other names are none of ours."""
    dead = path.with_name(f".{path.name}.{'1' * 16}.part")
    others = [path.with_name(n) for n in (f".{path.name}.part", f".x{path.name}.{'1' * 16}.part")]
    for file in (dead, *others):
        file.write_bytes(b"half")
    with atomic_file._new_part(path) as (living, file):
        atomic_file.replace_file(path, b"new")
        assert living.exists() and not dead.exists()
        assert all(other.exists() for other in others)
        file.write(b"newer")
        file.flush()
        os.replace(living, path)
    assert path.read_bytes() == b"newer"


def test_many_threads_write_one_file(path):
    """Each version is whole; nobody fails; parts that one takes for dead are made again."""
    failures = []

    def work(k):
        for _ in range(50):
            try:
                atomic_file.replace_file(path, bytes([k]) * 5000)
            except Exception as error:
                failures.append(error)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        if path.exists():
            content = path.read_bytes()
            assert len(content) == 5000 and len(set(content)) == 1
    assert not failures
    assert not parts(path)


def test_history_of_quadrature_values_is_checked_by_shape(comm, path):
    problem = stepped(comm)
    element = basix.ufl.quadrature_element("triangle", degree=2, value_shape=(2, 2))
    strain = fem.Function(fem.functionspace(problem.u.function_space.mesh, element))
    write_checkpoint(path, problem, history=[strain])
    change(path, replaced("values/history 0", lambda old: old[:, :3]))
    with pytest.raises(CheckpointError, match="history 0' with shape"):
        read_checkpoint(path, problem, history=[strain])
