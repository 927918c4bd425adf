"""A belt that slides round a pulley of flat faces, both of one surface that meets itself."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import box, joined
from folds import stored

#: Radii (m) of the pulley's hole and rim, the play, and the wall of the belt.
HOLE, RIM, PLAY, WALL = 0.3, 0.5, 0.002, 0.02


def arc(radii, layers, angles, along):
    """Mesh a part of a ring (degrees)."""
    part = box([0.0, 0.0], [1.0, 1.0], [along, layers], "quadrilateral")
    x = part.geometry.x
    angle = np.radians(angles[0] + (angles[1] - angles[0]) * x[:, 0])
    radius = radii[1] + (radii[0] - radii[1]) * x[:, 1]
    x[:, 0], x[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    return part


def reactions(kind):
    """Press the belt on the pulley, turn it by 10 degrees a step; return forces on its back."""
    inner, outer = RIM + PLAY, RIM + PLAY + WALL
    pulley, belt = arc((HOLE, RIM), 2, (-20, 200), 16), arc((inner, outer), 1, (60, 120), 13)
    msh = joined(MPI.COMM_WORLD, pulley, belt)
    msh.topology.create_connectivity(1, 2)
    facets = np.sort(mesh.exterior_facet_indices(msh.topology))
    middle = mesh.compute_midpoints(msh, 1, facets)
    radius = np.linalg.norm(middle, axis=1)
    values = np.ones(len(facets), dtype=np.int32)
    if kind == "two":
        inside = abs(np.arctan2(middle[:, 0], middle[:, 1])) < np.radians(29.8)
        values[(radius > RIM - 0.02) & (radius < RIM)] = 2
        values[(radius > RIM) & (radius < inner + 0.4 * WALL) & inside] = 3
    tags = mesh.meshtags(msh, 1, facets, values)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v, back = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    hole, top = (
        fem.locate_dofs_geometrical(V, lambda x, r=r: np.isclose(np.hypot(x[0], x[1]), r))
        for r in (HOLE, outer)
    )
    residual = ufl.derivative(stored(u), u, v)
    surfaces = {tag: ff.ContactSurface(msh, tags, tag) for tag in np.unique(values)}
    if kind == "two":
        obstacle = ff.DeformableObstacle(surfaces[2], method="node-to-face")
        contact = ff.Contact(surfaces[3], obstacle, ff.Frictionless())
    else:
        contact = ff.Contact(surfaces[1], ff.SelfContact(), ff.Frictionless())
    bcs = [fem.dirichletbc(fem.Function(V), hole), fem.dirichletbc(back, top)]
    problem = ff.FrictionalContactProblem(
        residual, u, bcs=bcs, contact=contact, petsc_options_prefix=f"belt_{kind}_"
    )
    X, found = V.tabulate_dof_coordinates()[:, :2], []
    for k in range(7):
        a = np.radians(-10.0 * max(k - 1, 0))
        turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
        closer = 1.0 - (0.004 + 0.01 * min(k, 1)) / RIM
        back.x.array[:] = (closer * X @ turn.T - X).ravel()
        assert problem.solve().certified
        forces = fem.assemble_vector(fem.form(residual)).array.reshape(-1, 2)
        found.append(forces[top].sum(axis=0))
    return np.array(found)


def test_nodes_slide_from_face_to_face_of_a_convex_body():
    """A node on one face is behind the plane of the next one; both walls are thin beside faces."""
    one, two = reactions("one"), reactions("two")
    assert one == pytest.approx(two, abs=1e-9 * np.max(abs(two)))
    assert np.max(abs(two)) > 3.0
