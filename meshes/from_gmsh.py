# SPDX-License-Identifier: MIT
"""From a gmsh model to a mesh with names."""

from collections.abc import Callable

from mpi4py import MPI

import gmsh

import fenicsx_friction as ff


def mesh_with_tags(build: Callable[[], None], comm: MPI.Intracomm) -> ff.NamedMesh:
    """Return mesh and tags of the model that ``build`` makes; collective."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    build()
    data = ff.read_gmsh(gmsh.model, comm)
    gmsh.finalize()
    return data
