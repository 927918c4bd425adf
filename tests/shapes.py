"""Surfaces as nodes and faces, and rigid bodies to fall through."""

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import mesh

import fenicsx_friction as ff
from fenicsx_friction.surfaces.face_cells import FACE_CELLS


def outline(w=1.0, h=1.0, n=10):
    """Nodes and edges of the boundary of a rectangle, normals outwards."""
    side = np.linspace(0.0, 1.0, n, endpoint=False)
    zero = np.zeros(n)
    x = np.concatenate([side, zero + 1.0, 1.0 - side, zero])
    y = np.concatenate([zero, side, zero + 1.0, 1.0 - side])
    number = np.arange(4 * n)
    return np.column_stack([w * x, h * y]), np.column_stack([number, (number + 1) % (4 * n)])


def lid(kind, n=4):
    """Nodes and faces of the square [0, 1]² at z = 0, normals upwards."""
    msh = mesh.create_unit_square(MPI.COMM_SELF, n, n, getattr(mesh.CellType, kind))
    return msh.geometry.x.copy(), upward(msh.geometry.x, msh.geometry.dofmaps[0], FACE_CELLS[kind])


def upward(X, cells, cell):
    a, b, c = (X[cells[:, k]] for k in range(3))
    wrong = np.cross(b - a, c - a)[:, 2] < 0.0
    faces = cells.astype(np.int64).copy()
    faces[wrong] = faces[wrong][:, cell.reverse]
    return faces


#: What a block falls through, its middle at (0, 0) and 0.4 wide, and the same by its gap alone.
BALL, BAR = ff.RigidSphere((0.0, 0.0), 0.2), ff.RigidCylinder((0.0, 9.0, 0.0), (0, 1, 0), 0.2)


def ball(X):
    return ufl.sqrt(ufl.dot(X, X)) - 0.2


def steep(X):
    """No distance: its gradient is 25 and more."""
    return 50.0 * (ufl.dot(X, X) - 0.04)


def bar(X):
    return ufl.sqrt(X[0] ** 2 + X[2] ** 2) - 0.2
