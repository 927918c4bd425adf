# SPDX-License-Identifier: MIT
"""From a gmsh model to a DOLFINx mesh."""

from collections.abc import Callable

from mpi4py import MPI

import gmsh
from dolfinx import io


def mesh_with_tags(build: Callable[[], None], comm: MPI.Intracomm) -> io.gmsh.MeshData:
    """Return mesh and tags of the model that ``build`` makes; collective."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    build()
    data = io.gmsh.model_to_mesh(gmsh.model, comm, 0, gdim=3)
    gmsh.finalize()
    return data
