"""The meshes of the concentric spheres are the published ones."""

import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem

sys.path.insert(0, str(Path(__file__).parents[1] / "meshes"))
import concentric_spheres as geometry
from from_gmsh import mesh_with_tags


@pytest.mark.parametrize(("density", "inner", "outer"), [("coarse", 125, 45), ("fine", 405, 605)])
def test_faces_angles_and_walls(density, inner, outer):
    """5 n² faces a sphere, nodes at uniform angles on the symmetry planes, all on the spheres."""
    data = mesh_with_tags(lambda: geometry.build(density), MPI.COMM_SELF)
    msh, tags, tag = data.mesh, data.facet_tags, geometry.TAGS
    numbers = {name: len(tags.find(tag[name])) for name in ("inside", "top")}
    assert numbers == {"inside": inner, "top": outer}
    assert [len(tags.find(tag[f"{k} contact"])) for k in ("inner", "outer")] == [inner, outer]
    assert msh.topology.index_map(3).size_local == geometry.LAYERS * (inner + outer)
    V = fem.functionspace(msh, ("Lagrange", 1))
    x = V.tabulate_dof_coordinates()
    divisions = dict(zip(("inside", "top"), geometry.DENSITIES[density], strict=True))
    for name, radius in (("inside", geometry.RADII[0]), ("top", geometry.RADII[-1])):
        on = x[fem.locate_dofs_topological(V, 2, tags.find(tag[name]))]
        assert np.linalg.norm(on, axis=1) == pytest.approx(radius, rel=1e-9)
        n = divisions[name]
        for axis, (a, b), count in ((0, (1, 2), 3 * n), (1, (0, 2), 3 * n), (2, (0, 1), 2 * n)):
            plane = on[abs(on[:, axis]) < 1e-9]
            angles = np.sort(np.degrees(np.arctan2(plane[:, b], plane[:, a])))
            assert angles == pytest.approx(np.linspace(0.0, 90.0, count + 1), abs=1e-4)
