# SPDX-License-Identifier: MIT
"""The facets that a tag marks, checked."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import mesh

from ..base.compat import same_topology
from ..base.errors import ContactInputError
from ..base.validators import instance, integer


def checked_facets(
    msh: mesh.Mesh, facet_tags: mesh.MeshTags, tag: int, name: str
) -> npt.NDArray[np.int32]:
    """Return the facets of ``tag`` after checks that agree on all ranks."""
    comm, tdim = msh.comm, msh.topology.dim
    cure = "dolfinx.mesh.MeshTags of the facets, see dolfinx.mesh.meshtags"
    instance(facet_tags, mesh.MeshTags, f"Contact surface '{name}': facet_tags", cure)
    tag = integer(tag, f"Contact surface '{name}': tag")
    if not same_topology(facet_tags, msh):
        raise ContactInputError(
            f"Contact surface '{name}': the facet tags are those of another mesh; make them on "
            "the mesh that you give."
        )
    if facet_tags.dim != tdim - 1:
        raise ContactInputError(
            f"Contact surface '{name}': the tags mark entities of dimension {facet_tags.dim}, "
            f"the facets of this mesh have dimension {tdim - 1}."
        )
    facets = facet_tags.find(tag)
    known = sorted(set().union(*comm.allgather(set(facet_tags.values.tolist()))))
    if comm.allreduce(len(facets), op=MPI.SUM) == 0:
        raise ContactInputError(
            f"Contact surface '{name}': tag {tag} marks no facet; tags present: {known}."
        )
    msh.topology.create_connectivity(tdim - 1, tdim)
    owned = facets[facets < msh.topology.index_map(tdim - 1).size_local]
    interior = np.setdiff1d(owned, mesh.exterior_facet_indices(msh.topology))
    if (count := comm.allreduce(len(interior), op=MPI.SUM)) > 0:
        raise ContactInputError(
            f"Contact surface '{name}': {count} facets of tag {tag} lie inside the mesh; "
            "contact facets must be boundary facets."
        )
    return facets
