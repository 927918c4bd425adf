# SPDX-License-Identifier: MIT
"""The history of a problem, in an order that does not depend on the partition."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.errors import CheckpointError
from ..certificate.nodal_state import NodalState
from ..obstacles.motion import Motion
from .numbering import Numbering, mesh_table

if TYPE_CHECKING:
    from ..problem import FrictionalContactProblem

#: Functions of a contact that are history; the others are made again or belong to one step.
CONTACT_HISTORY = ("c", "c_rate", "path", "hint", "bonded")
#: Name of ``Contact.slip_increment`` beside the fields of a ``NodalState``.
SLIP_INCREMENT = "slip_increment"
#: Nodal values with one column, with one for each tangent, and with one for each direction.
SCALARS, TANGENTIAL = ("gap", "limit", "r", "area", "own_map", "bonded"), ("slip",)
VECTORS = ("c", "free", SLIP_INCREMENT)
#: Nodes of the mesh may differ by this fraction of its extent.
SAME_PLACE = 1e-10

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Expected:
    """What an array must be; ``None`` where anything is allowed.

    Attributes:
        rows: Number of rows.
        columns: Shape of a row.
        kinds: Kinds of numbers, as ``numpy.dtype.kind``.
        size: Bytes of a number.
    """

    rows: int
    columns: tuple[int, ...] | None
    kinds: str
    size: int | None = None

    def check(self, name: str, shape: Sequence[int], dtype: np.dtype) -> None:
        """Raise unless shape and type are right."""
        fits = len(shape) > 0 and shape[0] == self.rows
        if not fits or self.columns not in (None, tuple(shape[1:])):
            columns = "" if self.columns is None else f" with shape {self.columns}"
            raise CheckpointError(
                f"holds '{name}' with shape {tuple(shape)}, not {self.rows} rows{columns}."
            )
        if dtype.kind not in self.kinds or self.size not in (None, dtype.itemsize):
            raise CheckpointError(f"holds '{name}' as {dtype}, not as the numbers expected.")


class Content:
    """What belongs to a checkpoint of a problem; collective.

    Attributes:
        motions: The moving obstacles' motions, each once.
        nodes: Coordinates of the mesh by input number (rank 0).
        functions: The Functions with the orders of their dofs.
        description: Properties that a file must share with the problem (rank 0).
    """

    def __init__(
        self, problem: "FrictionalContactProblem", history: Sequence[fem.Function]
    ) -> None:
        self._problem = problem
        # The motions of bodies that carry loads are kept with those that are given.
        unknowns = problem.unknowns[: len(problem.unknowns) - len(problem.bodies)]
        named = {f"unknown {k}": u for k, u in enumerate(unknowns)}
        named |= {f"history {k}": f for k, f in enumerate(history)}
        orders = {name: Numbering(f.function_space) for name, f in named.items()}
        self._surfaces = [Numbering(k.surface.S) for k in problem.contacts]
        obstacles = [k.obstacle.motion for k in problem.contacts]
        self.motions: list[Motion] = list({id(m): m for m in obstacles if m}.values())

        self.functions = {name: (orders[name], f) for name, f in named.items()}
        self.functions["u_old"] = (orders["unknown 0"], problem.u_old)
        for k in range(len(unknowns)):
            self.functions[f"rate {k}"] = (orders[f"unknown {k}"], problem.rates[k])
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
            "number of unknowns": str(len(problem.unknowns)),
            "number of history functions": str(len(history)),
            "number of contacts": str(len(self._surfaces)),
            "motions of the contacts' obstacles": " ".join(moving),
        }
        for name, f in named.items():
            self.description[f"element of {name}"] = repr(f.function_space.ufl_element())
            self.description[f"dofs of {name}"] = orders[name].fingerprint
        for k, order in enumerate(self._surfaces):
            self.description[f"nodes of contact {k}"] = order.fingerprint

    # -- what an array must be; rank 0 -----------------------------------------------------------

    def expected(self, names: Iterable[str]) -> dict[str, Expected]:
        """Return what the arrays of these names must be.

        Raises:
            CheckpointError: If one of them is unknown, or one that must be there is missing.
        """
        given, found = set(names), {}
        for name, (order, f) in self.functions.items():
            rows = _rows(f)
            found[name] = Expected(order.size, rows.shape[1:], rows.dtype.kind, rows.dtype.itemsize)
        needed = set(found)
        for k, order in enumerate(self._surfaces):
            d = self._problem.contacts[k].surface.mesh.geometry.dim
            columns = dict.fromkeys(SCALARS, ()) | dict.fromkeys(TANGENTIAL, (d - 1,))
            columns |= dict.fromkeys(VECTORS, (d,))
            for name in _nodal_names():
                kinds = "f" if name in columns else "fbiu"
                flags = name in ("free", "bonded")
                entry = Expected(order.size, columns.get(name), "b" if flags else kinds)
                found[f"accepted {k}/{name}"] = entry
        if not given <= needed:  # a step has been accepted
            needed |= {
                f"accepted {k}/{name}"
                for k in range(len(self._surfaces))
                for name in _nodal_names(optional=False)
            }
        if missing := sorted(needed - given):
            raise CheckpointError(f"is damaged: it does not hold '{missing[0]}'.")
        if unknown := sorted(given - set(found)):
            raise CheckpointError(f"holds '{unknown[0]}', which is unknown here.")
        return {name: found[name] for name in given}

    def compare(self, stored: Mapping[str, object]) -> None:
        """Raise unless elements, contacts and topology of the mesh are those of the problem."""
        for what, here in self.description.items():
            if str(there := stored.get(what)) != here:
                raise CheckpointError(f"is of another problem: its {what}: {there}; here: {here}.")

    def compare_nodes(self, nodes: Array) -> None:
        """Raise unless the nodes of the mesh are where those of the problem are."""
        extent = float(np.max(np.ptp(self.nodes, axis=0)))
        distance = np.max(abs(nodes - self.nodes), axis=1)
        if not (worst := float(np.max(distance))) <= SAME_PLACE * extent:
            x, here = (a[int(np.argmax(distance))].tolist() for a in (nodes, self.nodes))
            raise CheckpointError(
                f"is of another mesh: a node at {x} is at {here} here, {worst:g} m away."
            )

    # -- to and from rank 0 ----------------------------------------------------------------------

    def gather(self) -> dict[str, Array]:
        """Return all values in the order on rank 0, this rank's on the others; collective."""
        entries = {name: (order, _rows(f)) for name, (order, f) in self.functions.items()}
        for k, state in enumerate(self._problem.accepted):
            nodal = {f.name: getattr(state, f.name) for f in fields(NodalState)}
            nodal |= {SLIP_INCREMENT: self._problem.contacts[k].slip_increment}
            for name, rows in nodal.items():
                if rows is not None:
                    entries[f"accepted {k}/{name}"] = (self._surfaces[k], rows)
        return {name: order.gather(rows) for name, (order, rows) in entries.items()}

    def scatter(self, arrays: Mapping[str, Array | None]) -> None:
        """Fill the problem with arrays, given on rank 0; collective.

        Nothing is changed before all have arrived.
        """
        orders = {name: order for name, (order, _) in self.functions.items()}
        orders |= {f"accepted {k}": order for k, order in enumerate(self._surfaces)}
        rows = {
            name: (orders.get(name) or orders[name.partition("/")[0]]).scatter(values)
            for name, values in arrays.items()
        }
        for name, (_, f) in self.functions.items():
            _rows(f)[:] = rows[name]
            f.x.scatter_forward()
        accepted = []
        for k, contact in enumerate(self._problem.contacts):
            prefix = f"accepted {k}/"
            nodal = {n.removeprefix(prefix): v for n, v in rows.items() if n.startswith(prefix)}
            if nodal:
                contact.slip_increment = nodal.pop(SLIP_INCREMENT)
                accepted.append(NodalState(**nodal))
        self._problem.accepted = accepted


def _rows(function: fem.Function) -> Array:
    """Return a view of the owned values, one row a (blocked) dof."""
    index_map, bs = function.function_space.dofmap.index_map, function.function_space.dofmap.bs
    return function.x.array[: index_map.size_local * bs].reshape(-1, bs)


def _nodal_names(*, optional: bool = True) -> list[str]:
    """Return the names of the nodal values of a contact, with or without the optional ones."""
    names = [f.name for f in fields(NodalState) if optional or f.default is MISSING]
    return [*names, SLIP_INCREMENT]
