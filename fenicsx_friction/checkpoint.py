# SPDX-License-Identifier: MIT
"""Checkpoints: stop after any step, resume on any number of ranks.

A checkpoint is an HDF5 file of plain numbers behind a header with its SHA-256. It holds unknowns,
contact history and motions, neither mesh nor forms: a script builds its problem as for a fresh
start, then fills it with :func:`read_checkpoint`. Values are stored in an order that no partition
changes: sorted by the input numbers of the mesh entity to which a dof belongs.
"""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from .certificate import NodalState
from .collective import on_first_rank
from .errors import CheckpointError
from .motion import RigidMotion
from .numbering import Numbering, mesh_table
from .problem import FrictionalContactProblem
from .sealed_file import HEADER, hdf5_part, replacing, verify

#: Functions of a contact that are history; the others are set up anew or belong to one step.
CONTACT_HISTORY = ("c", "path", "hint")
#: Name of ``Contact.slip_increment`` beside the fields of a ``NodalState``.
SLIP_INCREMENT = "slip_increment"
#: Nodes of the mesh may differ by this fraction of its extent.
SAME_PLACE = 1e-10

Array = npt.NDArray[Any]
T = TypeVar("T")


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
        with replacing(Path(path)) as file, hdf5_part(file, "w", userblock_size=HEADER) as h5:
            h5.attrs.update(_provenance())
            h5.create_group("problem").attrs.update(content.description)
            h5.create_group("numbers").attrs.update(numbers)
            h5.create_group("scalars").attrs.update(_checked_scalars(scalars or {}))
            h5["mesh"] = content.nodes
            for k, motion in enumerate(content.motions):
                h5[f"motions/{k}"] = np.hstack([v.ravel() for v in motion.save()])
            for name, values in arrays.items():
                h5[f"values/{name}"] = values

    on_first_rank(problem.comm, _naming(f"Checkpoint '{path}' was not written:", store))


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
    load = _naming(f"Checkpoint '{path}'", lambda: _load(path, content))
    stored = on_first_rank(problem.comm, load)
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
    for k in problem.contacts:
        k.obstacle.anchor()
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
        self.nodes, cells = mesh_table(msh)
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
        verify(file)
        with hdf5_part(file, "r") as h5:
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


def _naming(what: str, work: Callable[[], T]) -> Callable[[], T]:
    """Return ``work`` with all its exceptions turned to a CheckpointError that says what failed."""

    def named() -> T:
        try:
            return work()
        except CheckpointError as error:
            raise CheckpointError(f"{what} {error}") from error
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            raise CheckpointError(f"{what.removesuffix(':')}: {reason}") from error

    return named
