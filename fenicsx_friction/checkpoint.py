# SPDX-License-Identifier: MIT
"""Checkpoints: stop after any step, resume on any number of ranks.

A checkpoint is an HDF5 file of plain numbers behind a header with its SHA-256. It holds unknowns,
contact history and motions, neither mesh nor forms: a script builds its problem as for a fresh
start, then fills it with :func:`read_checkpoint`. Values are stored in an order that no partition
changes: sorted by the input numbers of the mesh entity to which a dof belongs.
"""

import contextlib
import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from mpi4py import MPI

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem, mesh

from .certificate import NodalState
from .motion import RigidMotion
from .problem import FrictionalContactProblem

#: First words of the file, version of its layout, bytes before the HDF5 part (its "user block").
FORMAT, VERSION, HEADER = "fenicsx_friction checkpoint", 1, 512
#: Functions of a contact that are history; the others are set up anew or belong to one step.
CONTACT_HISTORY = ("c", "path", "hint")
#: Name of ``Contact.slip_increment`` beside the fields of a ``NodalState``.
SLIP_INCREMENT = "slip_increment"
#: Nodes of the mesh may differ by this fraction of its extent.
SAME_PLACE = 1e-10

Array = npt.NDArray[Any]
T = TypeVar("T")


class CheckpointError(ValueError):
    """A checkpoint that cannot be written, or cannot be read into this problem."""


def write_checkpoint(
    path: str | os.PathLike[str],
    problem: FrictionalContactProblem,
    scalars: Mapping[str, float] | None = None,
    *,
    history: Sequence[fem.Function] = (),
) -> None:
    """Write the state of a problem, or leave the old file as it was; collective.

    Args:
        path: The file; a complete one of this name is replaced at once. A killed run may leave
            ``.<name>.part`` beside it, which the next write replaces.
        problem: The problem.
        scalars: Further numbers to keep, e.g. ``{"time": t}``; rank 0's are taken.
        history: Functions of the user that steps change.

    Raises:
        CheckpointError: On all ranks, if the file cannot be written, or an element has dofs
            whose order depends on the partition.
    """
    content = _Content(problem, history)
    arrays = {name: order.gather(rows) for name, (order, rows) in content.arrays().items()}

    def store() -> None:
        numbers = {"num_steps": problem.num_steps, "dt": float(problem.dt.value)}
        with _replacing(Path(path)) as file, _hdf5(file, "w", userblock_size=HEADER) as h5:
            h5.attrs.update(_provenance())
            h5.create_group("problem").attrs.update(content.description)
            h5.create_group("numbers").attrs.update(numbers)
            h5.create_group("scalars").attrs.update(_checked_scalars(scalars or {}))
            h5["mesh"] = content.nodes
            for k, motion in enumerate(content.motions):
                h5[f"motions/{k}"] = np.hstack([v.ravel() for v in motion.save()])
            for name, values in arrays.items():
                h5[f"values/{name}"] = values

    _on_root(problem.comm, store, f"Checkpoint '{path}' was not written:")


def read_checkpoint(
    path: str | os.PathLike[str],
    problem: FrictionalContactProblem,
    *,
    history: Sequence[fem.Function] = (),
) -> dict[str, float]:
    """Fill a problem, built by the same script on the same mesh, with a checkpoint; collective.

    Loads, boundary values and anything else that the script sets before a step are its own.

    Args:
        path: The file.
        problem: The problem; unchanged if the file is refused.
        history: The Functions that were written, in the same order.

    Returns:
        The ``scalars`` that were written.

    Raises:
        CheckpointError: On all ranks, if the file is missing, foreign, truncated or damaged, or
            of another mesh, element or set of contacts.
    """
    content = _Content(problem, history)
    stored = _on_root(problem.comm, lambda: _load(path, content), f"Checkpoint '{path}'")
    small = None if stored is None else (stored.numbers, stored.scalars, stored.motions)
    numbers, scalars, motions = problem.comm.bcast(small)
    names = problem.comm.bcast(None if stored is None else sorted(stored.arrays))
    content.scatter({name: None if stored is None else stored.arrays[name] for name in names})
    for motion, values in zip(content.motions, motions, strict=True):
        saved = motion.save()
        pieces = np.split(values, np.cumsum([v.size for v in saved])[:-1])
        motion.restore([v.reshape(old.shape) for v, old in zip(pieces, saved, strict=True)])
    problem.num_steps = int(numbers["num_steps"])
    problem.dt.value = numbers["dt"]
    return {name: float(value) for name, value in scalars.items()}


# -- what a problem keeps from step to step --------------------------------------------------


class _Content:
    """What belongs to a checkpoint of a problem; collective.

    Attributes:
        motions: The moving obstacles' motions, each once.
        nodes: Coordinates of the mesh by input number (rank 0).
        functions: The Functions with the orders of their dofs.
        description: What a file must agree in to be read into the problem (rank 0).
    """

    def __init__(self, problem: FrictionalContactProblem, history: Sequence[fem.Function]) -> None:
        self._problem = problem
        named = {f"unknown {k}": u for k, u in enumerate(problem.unknowns)}
        named |= {f"history {k}": f for k, f in enumerate(history)}
        orders = {name: Numbering(f.function_space) for name, f in named.items()}
        self._surfaces = [Numbering(k.surface.S) for k in problem.contacts]
        obstacles = [k.obstacle.motion for k in problem.contacts]
        self.motions: list[RigidMotion] = list({id(m): m for m in obstacles if m}.values())

        self.functions = {name: (orders[name], f) for name, f in named.items()}
        self.functions["u_old"] = (orders["unknown 0"], problem.u_old)
        for k, contact in enumerate(problem.contacts):
            for name in CONTACT_HISTORY:
                entry = (self._surfaces[k], getattr(contact, name))
                self.functions[f"contact {k}/{name}"] = entry

        msh = problem.u.function_space.mesh
        self.nodes, cells = _mesh_table(msh)
        moving = ["none" if m is None else str(self.motions.index(m)) for m in obstacles]
        self.description = {
            "scalar type": problem.u.x.array.dtype.name,
            "cell": f"{msh.topology.cell_name()} in {msh.geometry.dim}D",
            "mesh": f"{len(self.nodes)} nodes, {cells}",
            "number of unknowns": len(problem.unknowns),
            "number of history functions": len(history),
            "number of contacts": len(self._surfaces),
            "motions of the contacts' obstacles": " ".join(moving),
            "fields of a contact node": " ".join(f.name for f in fields(NodalState)),
        }
        for name, f in named.items():
            self.description[f"element of {name}"] = repr(f.function_space.ufl_element())
            self.description[f"dofs of {name}"] = orders[name].fingerprint
        for k, order in enumerate(self._surfaces):
            self.description[f"nodes of contact {k}"] = order.fingerprint

    def arrays(self) -> dict[str, tuple["Numbering", Array]]:
        """Return this rank's values, one row an owned dof, with their orders."""
        entries = {name: (order, _rows(f)) for name, (order, f) in self.functions.items()}
        for k, state in enumerate(self._problem.accepted):
            nodal = {f.name: getattr(state, f.name) for f in fields(NodalState)}
            nodal |= {SLIP_INCREMENT: self._problem.contacts[k].slip_increment}
            for name, rows in nodal.items():
                if rows is not None:
                    entries[f"accepted {k}/{name}"] = (self._surfaces[k], rows)
        return entries

    def scatter(self, arrays: Mapping[str, Array | None]) -> None:
        """Fill the problem with arrays, given on rank 0."""
        for name, (order, f) in self.functions.items():
            _rows(f)[:] = order.scatter(arrays[name])
            f.x.scatter_forward()
        self._problem.accepted = []
        for k, order in enumerate(self._surfaces):
            prefix = f"accepted {k}/"
            nodal = {
                name.removeprefix(prefix): order.scatter(values)
                for name, values in arrays.items()
                if name.startswith(prefix)
            }
            if nodal:
                self._problem.contacts[k].slip_increment = nodal.pop(SLIP_INCREMENT)
                self._problem.accepted.append(NodalState(**nodal))


def _rows(function: fem.Function) -> Array:
    """Return a view of the owned values, one row a (blocked) dof."""
    index_map, bs = function.function_space.dofmap.index_map, function.function_space.dofmap.bs
    return function.x.array[: index_map.size_local * bs].reshape(-1, bs)


# -- orders that no partition changes ---------------------------------------------------------


class Numbering:
    """The dofs of a space in an order that does not depend on the partition; collective.

    Args:
        V: The space.

    Attributes:
        fingerprint: Number of dofs and SHA-256 of their keys (rank 0).

    Raises:
        CheckpointError: If the element has dofs whose order depends on the partition.
    """

    def __init__(self, V: fem.FunctionSpace) -> None:
        _check_element(V)
        self._comm = V.mesh.comm
        parts = self._comm.gather(_keys(V))
        self._ends, self._order, self.fingerprint = np.zeros(0, int), np.zeros(0, int), ""
        if parts is not None:
            keys = np.concatenate(parts)
            self._ends = np.cumsum([len(part) for part in parts])
            self._order = np.lexsort(keys.T[::-1])
            self.fingerprint = f"{len(keys)}, SHA-256 {_sha256(keys[self._order])}"

    def gather(self, rows: Array) -> Array:
        """Return the rows of all ranks in this order on rank 0, the given ones on the others."""
        parts = self._comm.gather(rows)
        return rows if parts is None else np.concatenate(parts)[self._order]

    def scatter(self, values: Array | None) -> Array:
        """Return this rank's rows of what rank 0 has in this order."""
        parts = None
        if values is not None:
            rows = np.empty_like(values)
            rows[self._order] = values
            parts = np.split(rows, self._ends[:-1])
        return np.asarray(self._comm.scatter(parts))


def _keys(V: fem.FunctionSpace) -> npt.NDArray[np.int64]:
    """Return a key of each owned dof from the numbers that the mesh was made with.

    It is the dimension of the dof's entity, its place on the entity and the numbers of the
    entity's vertices: sorted, or for the interior of a cell in the cell's own order, so that a
    cell with another order is not taken for the same.
    """
    msh, layout, dofs = V.mesh, V.dofmap.dof_layout, V.dofmap.list
    entities = basix.topology(msh.basix_cell())
    vertices = msh.geometry.dofmaps[0][:, : len(entities[0])]
    numbers = msh.geometry.input_global_indices[vertices]
    places = [
        (dim, corners, place, dof)
        for dim, group in enumerate(entities)
        for entity, corners in enumerate(group)
        for place, dof in enumerate(layout.entity_dofs(dim, entity))
    ]
    width = max(len(corners) for _, corners, _, _ in places)
    index_map = V.dofmap.index_map
    shape = (index_map.size_local + index_map.num_ghosts, 2 + width)
    keys = np.full(shape, -1, dtype=np.int64)
    for dim, corners, place, dof in places:
        name = numbers[:, corners]
        if dim < msh.topology.dim:
            name = np.sort(name, axis=1)
        keys[dofs[:, dof], :2] = dim, place
        keys[dofs[:, dof], 2 : 2 + len(corners)] = name
    return keys[: index_map.size_local]


def _check_element(V: fem.FunctionSpace) -> None:
    """Refuse elements with several dofs on an edge or face, whose order depends on the partition.

    Lagrange elements up to degree 2 pass, discontinuous ones of any degree.
    """
    leaves = [V.ufl_element()]
    while any(e.sub_elements for e in leaves):
        leaves = [s for e in leaves for s in (e.sub_elements or [e])]
    for e in leaves:
        between = [n for dim in e.num_entity_dofs[1 : V.mesh.topology.dim] for n in dim]
        if max(between, default=0) > 1 or V.element.needs_dof_transformations:
            raise CheckpointError(
                f"A checkpoint cannot hold the element {e!r}: dofs on its edges or faces are "
                "ordered by the partition. Use a Lagrange element of degree 1 or 2, or a "
                "discontinuous one."
            )


def _mesh_table(msh: mesh.Mesh) -> tuple[Array, str]:
    """Return on rank 0 the nodes by input number, and a fingerprint of the cells."""
    comm, geometry, topology = msh.comm, msh.geometry, msh.topology
    owned = geometry.index_map().size_local
    numbers, cells = geometry.input_global_indices, topology.index_map(topology.dim).size_local
    nodes = comm.gather((numbers[:owned], geometry.x[:owned, : geometry.dim]))
    tables = comm.gather(numbers[geometry.dofmaps[0][:cells]])
    if nodes is None or tables is None:
        return np.zeros((0, geometry.dim)), ""
    order = np.argsort(np.concatenate([number for number, _ in nodes]))
    rows = np.concatenate(tables)
    digest = _sha256(rows[np.lexsort(rows.T[::-1])])
    return np.concatenate([x for _, x in nodes])[order], f"{len(rows)} cells, SHA-256 {digest}"


def _sha256(keys: npt.NDArray[np.integer]) -> str:
    """Return the SHA-256 of integers, the same on any machine."""
    return hashlib.sha256(np.ascontiguousarray(keys, dtype="<i8").tobytes()).hexdigest()[:16]


# -- the file ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Stored:
    """What a file holds."""

    numbers: dict[str, float]
    scalars: dict[str, float]
    motions: list[Array]
    arrays: dict[str, Array]


def _load(path: str | os.PathLike[str], content: _Content) -> _Stored:
    """Read a file whose every bit is right and that fits to the problem; rank 0."""
    with open(path, "rb") as file:
        _verify(file)
        with _hdf5(file, "r") as h5:
            _compare(dict(h5["problem"].attrs), h5["mesh"][...], content)
            return _Stored(
                numbers=dict(h5["numbers"].attrs),
                scalars=dict(h5["scalars"].attrs),
                motions=[h5[f"motions/{k}"][...] for k in range(len(content.motions))],
                arrays=dict(_walk(h5["values"])),
            )


def _walk(group: Any, prefix: str = "") -> Iterator[tuple[str, Array]]:
    """Yield all arrays of an HDF5 group with their names."""
    for name, entry in group.items():
        if hasattr(entry, "items"):
            yield from _walk(entry, f"{prefix}{name}/")
        else:
            yield prefix + name, entry[...]


def _compare(stored: Mapping[str, Any], nodes: Array, content: _Content) -> None:
    """Raise unless mesh, elements and contacts are those of the problem."""
    for what, here in content.description.items():
        if (there := stored.get(what)) != here:
            raise CheckpointError(f"is of another problem: its {what}: {there}; here: {here}.")
    extent = float(np.max(np.ptp(content.nodes, axis=0)))
    distance = np.max(abs(nodes - content.nodes), axis=1)
    if not (worst := float(np.max(distance))) <= SAME_PLACE * extent:
        x, here = (a[int(np.argmax(distance))].tolist() for a in (nodes, content.nodes))
        raise CheckpointError(
            f"is of another mesh: a node at {x} is at {here} here, {worst:g} m away."
        )


def _verify(file: BinaryIO) -> None:
    """Raise unless the file is a checkpoint of this format, to the last bit."""
    header = file.read(HEADER)
    if not header.startswith(FORMAT.encode()):
        raise CheckpointError("is no checkpoint of fenicsx_friction.")
    if len(header) < HEADER:
        raise CheckpointError(f"is truncated: it has {len(header)} bytes only.")
    words = header.decode("ascii", "replace").split()
    if words[2] != str(VERSION):
        raise CheckpointError(
            f"has format {words[2]}, this version of fenicsx_friction reads format {VERSION}."
        )
    right = _header(file)
    if header != right:
        size, expected = right.split()[4].decode(), words[4]
        reason = f"truncated: it has {size} of {expected} bytes" if size != expected else "damaged"
        raise CheckpointError(f"is {reason}; its SHA-256 is not the one in its header.")


def _header(file: BinaryIO) -> bytes:
    """Return the header that belongs to the rest of a file."""
    digest = hashlib.sha256()
    size = file.seek(HEADER)
    while block := file.read(1 << 20):
        digest.update(block)
        size += len(block)
    text = f"{FORMAT} {VERSION}\nbytes {size}\nsha256 {digest.hexdigest()}\n"
    return text.encode().ljust(HEADER, b"\n")


@contextlib.contextmanager
def _replacing(path: Path) -> Iterator[BinaryIO]:
    """Open a file that replaces ``path`` once it is complete and on the disk."""
    part = path.with_name(f".{path.name}.part")
    try:
        with open(part, "w+b") as file:
            yield file
            header = _header(file)
            file.seek(0)
            file.write(header)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    with contextlib.suppress(OSError):  # some file systems cannot, and need not
        os.fsync(folder)
    os.close(folder)


def _hdf5(file: BinaryIO, mode: str, **options: int) -> Any:
    """Open the HDF5 part of a file."""
    try:
        import h5py
    except ImportError as error:  # pragma: no cover - the image has it
        raise CheckpointError("needs h5py: install python3-h5py, or h5py from conda.") from error
    return h5py.File(file, mode, **options)


def _provenance() -> dict[str, str]:
    """Return the versions that write a file."""
    import dolfinx

    from . import __version__

    return {"fenicsx_friction": __version__, "dolfinx": dolfinx.__version__}


def _checked_scalars(scalars: Mapping[str, float]) -> dict[str, float]:
    """Return the scalars as floats, or raise."""
    try:
        return {str(name): float(value) for name, value in scalars.items()}
    except (TypeError, ValueError) as error:
        raise CheckpointError(f"scalars must be real numbers: {error}.") from error


def _on_root(comm: MPI.Intracomm, work: Callable[[], T], what: str) -> T | None:
    """Do something on rank 0; if it fails, raise a CheckpointError on all ranks."""
    result: T | None = None
    problem = ""
    cause: Exception | None = None
    if comm.rank == 0:
        try:
            result = work()
        except CheckpointError as error:
            problem, cause = f"{what} {error}", error
        except Exception as error:  # the other ranks wait
            problem, cause = f"{what.removesuffix(':')}: {type(error).__name__}: {error}", error
    if problem := comm.bcast(problem):
        raise CheckpointError(problem) from cause
    return result
