"""The contact element of a node and a face: values, exact derivatives, objectivity."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

from fenicsx_friction.obstacles.pair_kernel import PairGeometry, PairKernel
from fenicsx_friction.surfaces.face_cells import FACE_CELLS, blend, normals, project, shape_matrix

CORNERS = {
    "interval": [[0.0, 0.0], [1.0, 0.2]],
    "triangle": [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.2, 0.9, 0.3]],
    "quadrilateral": [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.1, 0.9, 0.3], [1.2, 1.1, -0.2]],
}
#: In the face, on an edge, at a corner and beyond an edge.
PLACES = {"interval": [[0.3], [0.0], [1.0], [1.1]]}
PLACES["triangle"] = PLACES["quadrilateral"] = [[0.3, 0.4], [0.0, 0.5], [0.0, 0.0], [-0.1, 0.3]]


def elements(kind):
    """Return a kernel and one element at each of the places, a bit off the face."""
    cell, rng = FACE_CELLS[kind], np.random.default_rng(1)
    face, xi = np.array(CORNERS[kind]), np.array(PLACES[kind])
    n, d = len(xi), face.shape[1]
    faces = np.tile(face, (n, 1, 1))
    x = blend(shape_matrix(cell, xi), faces) + 0.05 * normals(cell, faces, xi)
    old = faces + 0.1 * rng.standard_normal(faces.shape)
    z = np.concatenate([x[:, None], faces, old], axis=1)
    hint = np.tile(np.eye(d)[0], (n, 1))
    old_xi, offset = rng.uniform(0.0, 1.0, xi.shape), 0.02 * rng.standard_normal(n)
    return PairKernel(MPI.COMM_SELF, cell, d, n), PairGeometry(z, xi, old_xi, offset, hint)


@pytest.mark.parametrize("kind", FACE_CELLS)
def test_projection_finds_the_foot_of_the_perpendicular(kind):
    _, geometry = elements(kind)
    cell = FACE_CELLS[kind]
    found = project(cell, geometry.z[:, 1 : 1 + cell.nodes], geometry.z[:, 0])
    assert found == pytest.approx(geometry.xi, abs=1e-12)


@pytest.mark.parametrize("kind", FACE_CELLS)
def test_element_has_the_gap_and_the_normal_it_was_made_with(kind):
    kernel, geometry = elements(kind)
    values, d, cell = kernel.values(geometry), geometry.z.shape[2], FACE_CELLS[kind]
    assert values[:, 0] == pytest.approx(0.05 - geometry.offset)
    expected = normals(cell, geometry.z[:, 1 : 1 + cell.nodes], geometry.xi)
    assert values[:, d : 2 * d] == pytest.approx(expected, abs=1e-13)
    assert values[:, -cell.nodes :] == pytest.approx(shape_matrix(cell, geometry.xi), abs=1e-13)


@pytest.mark.parametrize("kind", FACE_CELLS)
def test_derivatives_of_the_element_are_those_of_the_projection(kind):
    """Central differences with the projection found anew, on faces, edges, corners, beyond."""
    kernel, geometry = elements(kind)
    cell, h = FACE_CELLS[kind], 1e-6

    def values(z):
        xi = project(cell, z[:, 1 : 1 + cell.nodes], z[:, 0], geometry.xi)
        return kernel.values(replace(geometry, z=z, xi=xi))

    n, points, d = geometry.z.shape
    exact = kernel.derivatives(geometry).reshape(n, -1, points, d)
    for point in range(points):
        for axis in range(d):
            step = np.zeros_like(geometry.z)
            step[:, point, axis] = h
            difference = (values(geometry.z + step) - values(geometry.z - step)) / (2.0 * h)
            assert difference == pytest.approx(exact[:, :, point, axis], abs=1e-8)


def turned(z, angle=0.7):
    """Turn positions (in the plane of the first two axes) and shift them."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(z.shape[-1])
    R[:2, :2] = [[c, -s], [s, c]]
    return z @ R.T + 3.0, R


@pytest.mark.parametrize("kind", FACE_CELLS)
def test_a_common_rigid_motion_neither_opens_nor_slides(kind):
    """The old point moves with the face: gap and slip stay, the frame turns with it."""
    kernel, geometry = elements(kind)
    z, R = turned(geometry.z)
    before, d = kernel.values(geometry), z.shape[2]
    hint = geometry.hint @ R.T
    after = kernel.values(replace(geometry, z=z, hint=hint))
    assert after[:, :d] == pytest.approx(before[:, :d], abs=1e-12)
    frame = slice(d, d + d * (d - 1))
    turned_before = before[:, frame].reshape(len(z), d - 1, d) @ R.T
    assert after[:, frame] == pytest.approx(turned_before.reshape(len(z), -1), abs=1e-12)
