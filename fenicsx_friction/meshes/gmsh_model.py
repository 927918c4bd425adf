# SPDX-License-Identifier: MIT
"""Meshes with names from gmsh: of a file, or of the model that is being made."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from ..base.collective import on_first_rank
from ..base.errors import ContactInputError
from ..base.validators import number, shown
from .named_mesh import NamedMesh

Groups = dict[str, tuple[int, tuple[int, ...]]]
#: What gmsh calls entities of each dimension.
KINDS = ("point", "curve", "surface", "volume")


def read_gmsh(
    source: str | Path | Any,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    *,
    gdim: int | None = None,
    scale: float = 1.0,
) -> NamedMesh:
    """Return a mesh with the physical groups of gmsh, by their names; collective.

    Only what is in physical groups is kept: give bodies and surfaces names there.

    Args:
        source: A ``.msh`` file, or ``gmsh.model`` with a mesh (looked at on rank 0 only).
        comm: The ranks that share the mesh.
        gdim: Dimension of space; by default that of the model.
        scale: Factor of all coordinates, 1e-3 for millimetres.

    Raises:
        ContactInputError: If the file is missing or cannot be read, or if there are no groups of
            cells; on all ranks.
    """
    number(scale, "scale", above=0.0)
    try:
        import gmsh
        from dolfinx.io import gmsh as reader
    except ImportError as error:
        raise ContactInputError("read_gmsh needs the Python package gmsh: install it.") from error
    file = Path(source) if isinstance(source, str | Path) else None
    if file is None and not hasattr(source, "getPhysicalGroups"):
        raise ContactInputError(
            f"source = {shown(source)} must be the name of a file, or gmsh.model with a mesh."
        )
    if gdim not in (None, 2, 3):
        raise ContactInputError(f"gdim = {shown(gdim)} must be 2 or 3.")
    with _session(gmsh, comm.rank == 0 and file is not None):
        dim, groups = comm.bcast(on_first_rank(comm, lambda: _prepared(gmsh, file)))
        data = reader.model_to_mesh(gmsh.model, comm, 0, gdim=gdim or dim)
    data.mesh.geometry.x[:] *= scale
    return NamedMesh(data.mesh, _of_groups(data.cell_tags), _of_groups(data.facet_tags), groups)


@contextmanager
def _session(gmsh: Any, needed: bool) -> Iterator[None]:
    """Begin gmsh where that is needed and has not been done, and end it then."""
    begun = needed and not gmsh.isInitialized()
    if begun:
        gmsh.initialize()
        gmsh.option.setNumber("General.Verbosity", 2)
    try:
        yield
    finally:
        if begun:
            gmsh.finalize()


def _prepared(gmsh: Any, file: Path | None) -> tuple[int, Groups]:
    """Open a file, if there is one; return the dimension of the model, and its groups."""
    if file is not None:
        if not file.is_file():
            raise ContactInputError(f"source = {shown(str(file))}: there is no such file.")
        try:
            gmsh.open(str(file))
        except Exception as error:  # gmsh raises Exception itself
            raise ContactInputError(f"gmsh cannot read {file}: {error}") from None
    dim = int(gmsh.model.getDimension())
    if not gmsh.model.getPhysicalGroups(dim):
        raise ContactInputError(
            f"The gmsh model has no physical group of dimension {dim}: name its bodies and "
            "surfaces by gmsh.model.addPhysicalGroup(dim, tags, name=...)."
        )
    facets, cells = _groups(gmsh, dim - 1), _groups(gmsh, dim)
    if both := sorted(set(facets) & set(cells)):
        raise ContactInputError(
            f"A body and a surface of gmsh are both called '{both[0]}': rename one of the groups."
        )
    return dim, {**facets, **cells}


def _groups(gmsh: Any, dim: int) -> Groups:
    """Return the groups of a dimension; those without a name are called by kind and number.

    Raises:
        ContactInputError: If a mesh with one tag an entity cannot hold them all.
    """
    groups: Groups = {}
    of_entity: dict[int, str] = {}
    for _, tag in gmsh.model.getPhysicalGroups(dim):
        name = gmsh.model.getPhysicalName(dim, tag) or f"{KINDS[dim]} {tag}"
        if name in groups:
            raise ContactInputError(f"Two physical groups of gmsh are called '{name}'; rename one.")
        groups[name] = dim, (int(tag),)
        for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, tag):
            if entity in of_entity:
                raise ContactInputError(
                    f"The {KINDS[dim]} {entity} of gmsh is in the physical groups "
                    f"'{of_entity[entity]}' and '{name}'; a mesh holds one tag an entity: put it "
                    "into one of them."
                )
            of_entity[entity] = name
    return groups


def _of_groups(tags: Any) -> Any:
    """Return tags unless they are empty on all ranks; collective."""
    if tags is None:
        return None
    total = tags.topology.index_map(tags.dim).comm.allreduce(len(np.asarray(tags.indices)))
    return tags if total else None
