# SPDX-License-Identifier: MIT
"""Bodies that were meshed apart, in one mesh that does not connect them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import graph, io, mesh

from ..base.errors import ContactInputError
from ..base.validators import instance, shown
from .named_mesh import NamedMesh

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class _Part:
    """A mesh on rank 0.

    Attributes:
        x: Its nodes (m).
        cells: Their numbers, one row a cell.
        tagged: Vertices and tags of the tagged cells and of the tagged facets.
    """

    x: Array
    cells: Indices
    tagged: list[tuple[Indices, Indices]]


def join_meshes(
    parts: Mapping[str, NamedMesh | mesh.Mesh], comm: MPI.Intracomm = MPI.COMM_WORLD
) -> NamedMesh:
    """Join meshes of several bodies to one, with their groups; collective.

    Bodies stay apart, also where their nodes are at the same place: let them meet by contact. The
    group ``name`` of a body is called ``body/name``; all cells of a body are the group ``body``.

    Args:
        parts: The bodies by their names, of one kind of cell and one degree.
        comm: The ranks that share the joined mesh, and the meshes; or these are whole on each rank
            (``MPI.COMM_SELF``), then those of the first rank count.

    Raises:
        ContactInputError: If meshes cannot be joined.
    """
    if not isinstance(parts, Mapping) or not parts:
        raise ContactInputError("join_meshes: parts must be bodies by their names, at least one.")
    named = {name: _named(name, part) for name, part in parts.items()}
    _check_alike(named, comm)
    first = next(iter(named.values())).mesh
    tdim = first.topology.dim
    gathered = [_gathered(part, comm) for part in named.values()]
    starts = np.cumsum([0, *(len(part.x) for part in gathered)])
    x = np.concatenate([part.x for part in gathered])
    cells = np.concatenate(
        [part.cells + start for part, start in zip(gathered, starts[:-1], strict=True)]
    )
    domain = first.ufl_domain()
    assert domain is not None
    joined = mesh.create_mesh(comm, cells, domain.ufl_coordinate_element(), x)
    tags: list[mesh.MeshTags | None] = []
    groups: dict[str, tuple[int, tuple[int, ...]]] = {}
    for codim in (0, 1):
        found = [part.tagged[codim] for part in gathered]
        numbers, of_dim = _numbered(named, [tags for _, tags in found], tdim - codim, comm)
        groups |= of_dim
        entities = np.concatenate([v + k for (v, _), k in zip(found, starts[:-1], strict=True)])
        tags.append(_tags(joined, tdim - codim, entities, np.concatenate(numbers)))
    return NamedMesh(joined, tags[0], tags[1], groups)


def _named(name: str, part: object) -> NamedMesh:
    """Return a part with names; a mesh alone has none."""
    if not isinstance(name, str) or not name.strip() or "/" in name:
        raise ContactInputError(
            f"join_meshes: the body name {shown(name)} must be a string without '/', which stands "
            "between body and group."
        )
    if isinstance(part, mesh.Mesh):
        return NamedMesh(part, None, None, {})
    cure = "a mesh, or a NamedMesh as of read_gmsh"
    return instance(part, NamedMesh, f"The part '{name}' of join_meshes", cure)


def _check_alike(parts: Mapping[str, NamedMesh], comm: MPI.Intracomm) -> None:
    """Raise unless the parts have one kind of cell and degree, and the ranks."""
    kinds = {}
    for name, part in parts.items():
        domain = part.mesh.ufl_domain()
        assert domain is not None
        same = MPI.Comm.Compare(part.mesh.comm, comm) in (MPI.IDENT, MPI.CONGRUENT)
        if not same and part.mesh.comm.size > 1:
            raise ContactInputError(
                f"join_meshes: '{name}' is shared by other ranks than the joined mesh is to be; "
                "make it on the same communicator, or on MPI.COMM_SELF."
            )
        kinds[name] = str(domain.ufl_coordinate_element())
        if part.mesh.geometry.cmaps[0].degree > 2:
            raise ContactInputError(f"join_meshes: the cells of '{name}' have more than degree 2.")
    if len(set(kinds.values())) > 1:
        listed = "; ".join(f"'{name}': {kind}" for name, kind in kinds.items())
        raise ContactInputError(f"join_meshes: the parts have different cells: {listed}.")


def _gathered(part: NamedMesh, shared: MPI.Intracomm) -> _Part:
    """Return all of a mesh on rank 0 of the joined one, nothing on the others; collective."""
    msh = part.mesh
    comm, geometry, tdim = msh.comm, msh.geometry, msh.topology.dim
    numbers, d = geometry.input_global_indices, geometry.dim
    owned, cells = geometry.index_map().size_local, msh.topology.index_map(tdim).size_local
    tagged = []
    for dim, tags in ((tdim, part.cell_tags), (tdim - 1, part.facet_tags)):
        msh.topology.create_entities(dim)
        msh.topology.create_connectivity(dim, tdim)
        if tags is not None:
            own = tags.indices < msh.topology.index_map(dim).size_local
            entities, values = tags.indices[own], tags.values[own].astype(np.int64)
        else:  # a body without groups of cells is one
            entities = np.arange(cells if dim == tdim else 0, dtype=np.int32)
            values = np.zeros(len(entities), dtype=np.int64)
        tagged.append((numbers[mesh.entities_to_geometry(msh, dim, entities)], values))
    local = (numbers[:owned], geometry.x[:owned, :d], numbers[geometry.dofmaps[0][:cells]], tagged)
    every = comm.gather(local)
    if every is None or shared.rank > 0:
        empty = [(np.zeros((0, v.shape[1]), np.int64), np.zeros(0, np.int64)) for v, _ in tagged]
        return _Part(np.zeros((0, d)), np.zeros((0, local[2].shape[1]), np.int64), empty)
    order = np.argsort(np.concatenate([one[0] for one in every]))
    x = np.concatenate([one[1] for one in every])[order]
    joined = []
    for codim in (0, 1):
        rows = [one[3][codim] for one in every]
        joined.append((np.concatenate([r[0] for r in rows]), np.concatenate([r[1] for r in rows])))
    return _Part(x, np.concatenate([one[2] for one in every]), joined)


def _numbered(
    parts: Mapping[str, NamedMesh], tags: Sequence[Indices], dim: int, comm: MPI.Intracomm
) -> tuple[list[Indices], dict[str, tuple[int, tuple[int, ...]]]]:
    """Return new tags of the entities of all bodies, on rank 0, and all groups; collective."""
    numbers, groups, last = [], {}, 0
    for (body, part), old in zip(parts.items(), tags, strict=True):
        present = comm.bcast(np.unique(old).tolist())
        new = {tag: last + 1 + i for i, tag in enumerate(present)}
        last += len(present)
        numbers.append(np.array([new[tag] for tag in old.tolist()], dtype=np.int64))
        named = {name: group for name, (d, group) in part.groups.items() if d == dim}
        known = {tag for group in named.values() for tag in group}
        named |= {str(tag): (tag,) for tag in present if tag not in known}
        for name, group in named.items():
            groups[f"{body}/{name}"] = dim, tuple(new[tag] for tag in group if tag in new)
        if dim == part.mesh.topology.dim:
            groups[body] = dim, tuple(new.values())
    return numbers, groups


def _tags(msh: mesh.Mesh, dim: int, entities: Indices, values: Indices) -> mesh.MeshTags | None:
    """Return tags of entities, given by their input nodes on rank 0; collective."""
    if not msh.comm.allreduce(len(values)):
        return None
    found, at = io.distribute_entity_data(msh, dim, entities, values.astype(np.int32))
    msh.topology.create_connectivity(dim, msh.topology.dim)
    return mesh.meshtags_from_entities(msh, dim, graph.adjacencylist(found), at.astype(np.int32))
