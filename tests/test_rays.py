"""Lines meet faces of any shape where the faces are."""

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.obstacles.rays import cast
from fenicsx_friction.surfaces.lagrange_faces import LagrangeFaces

KINDS = [("triangle", k) for k in (1, 2, 3)]
KINDS += [("tetrahedron", k) for k in (1, 2)] + [("hexahedron", k) for k in (1, 2)]


def warped(kind, degree):
    """The upper faces of a block, and positions of their dofs that are a bit uneven."""
    comm, cell = MPI.COMM_SELF, getattr(mesh.CellType, kind)
    if kind == "triangle":
        msh = mesh.create_unit_square(comm, 3, 3, cell)
    else:
        msh = mesh.create_unit_cube(comm, 3, 3, 3, cell)
    d = msh.geometry.dim
    top = mesh.locate_entities_boundary(msh, d - 1, lambda x: np.isclose(x[d - 1], 1.0))
    tags = mesh.meshtags(msh, d - 1, top, np.full(len(top), 1, dtype=np.int32))
    V = fem.functionspace(msh, ("Lagrange", degree, (d,)))
    faces = LagrangeFaces(ff.ContactSurface(msh, tags, 1), V)
    uneven = np.random.default_rng(3).uniform(-0.02, 0.02, faces.X.shape)
    return faces, faces.X + uneven / degree


def rays(faces, x, number=200):
    """Lines through known places of faces, and how far before them they begin."""
    rng = np.random.default_rng(4)
    face = rng.integers(0, len(faces.dofs), number)
    eta = 0.1 + 0.3 * rng.random((number, faces.d - 1))
    along = rng.uniform(-0.3, 0.3, (number, faces.d))
    along[:, -1] = rng.choice([-1.0, 1.0], number)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    gap = rng.uniform(-0.5, 0.5, number)
    foot = np.einsum("pa,pad->pd", faces.shapes(eta), faces.at_dofs(x, face))
    return face, eta, along, gap, foot + gap[:, None] * along


@pytest.mark.serial
@pytest.mark.parametrize(("kind", "degree"), KINDS)
def test_lines_meet_faces_at_known_places(kind, degree):
    faces, x = warped(kind, degree)
    face, eta, along, gap, start = rays(faces, x)
    place, distance = cast(faces, x, face, start, along)
    assert np.allclose(place, eta, rtol=0.0, atol=1e-13)
    assert np.allclose(distance, gap, rtol=0.0, atol=1e-14)


@pytest.mark.serial
@pytest.mark.parametrize(("kind", "degree"), KINDS)
def test_monomials_are_the_shape_functions(kind, degree):
    faces, _ = warped(kind, degree)
    xi = np.random.default_rng(5).random((50, faces.d - 1))
    found = np.einsum("kp,tka->pta", faces.polynomials(xi.T), faces.polynomials.coefficients)
    assert np.allclose(found, faces.table(xi), rtol=0.0, atol=1e-12)


@pytest.mark.serial
@pytest.mark.parametrize(("kind", "degree"), [("triangle", 1), ("hexahedron", 1)])
def test_lines_along_a_face_do_not_meet_it(kind, degree):
    faces, _ = warped(kind, degree)
    along = faces.tangents(faces.X)[:1, 0]
    start = faces.X[faces.dofs[0]].mean(axis=0, keepdims=True) + 0.1 * np.eye(faces.d)[-1]
    place, _ = cast(faces, faces.X, np.zeros(1, dtype=int), start, along / np.linalg.norm(along))
    assert not np.any(abs(place) < 1e6)  # nowhere, or far away
