"""Cells that no body can have are named; distorted ones that it can have are not."""

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
from dolfinx import mesh

import fenicsx_friction as ff
from fenicsx_friction.surfaces.cells import check_cells

CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
cells = pytest.mark.parametrize("cell", CELLS)


def lattice(cell, n=3):
    d, kind = CELLS[cell], getattr(mesh.CellType, cell)
    make = mesh.create_unit_square if d == 2 else mesh.create_unit_cube
    return make(MPI.COMM_WORLD, *[n] * d, kind)


def move(msh, frm, to):
    """Move the node at one place to another, on all ranks that have it."""
    at = np.all(np.isclose(msh.geometry.x[:, : len(frm)], frm), axis=1)
    assert msh.comm.allreduce(int(np.sum(at))) > 0
    msh.geometry.x[at, : len(to)] = to


def refused(match):
    return pytest.raises(ff.ContactInputError, match=match)


@pytest.mark.mpi
@cells
def test_distorted_but_sound_cells_pass(cell):
    """Sheared by ten, stretched by 1e6, far away, warped, mirrored."""
    msh = lattice(cell)
    d, x = CELLS[cell], msh.geometry.x
    x[:, :d] += 0.07 * np.sin(17.0 * x.sum(axis=1)[:, None] + np.arange(d))
    x[:, 0] += 10.0 * x[:, d - 1]
    check_cells(msh)
    x[:, d - 1] *= -1e-6
    check_cells(msh)
    x[:, :d] += 1000.0
    check_cells(msh)


@pytest.mark.mpi
@cells
def test_a_folded_node_is_found(cell):
    """An inner node is moved across the cells on its one side."""
    msh = lattice(cell)
    d = CELLS[cell]
    move(msh, [1 / 3] * d, [0.9, *[1 / 3] * (d - 1)])
    with refused(r"Cell \d+ of the mesh .* at \(.*(inverted in part|folded on a neighbour)"):
        check_cells(msh)


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
def test_a_cell_turned_over_as_a_whole_is_found(cell):
    """Both layers of nodes of a strip exchange their places: no cell has two signs of det J."""
    d = CELLS[cell]
    make = mesh.create_rectangle if d == 2 else mesh.create_box
    high = [3.0] + [1.0] * (d - 1)
    kind = getattr(mesh.CellType, cell)
    msh = make(MPI.COMM_WORLD, [[0.0] * d, high], [3] + [1] * (d - 1), kind)
    x = msh.geometry.x
    first, second = np.isclose(x[:, 0], 1.0), np.isclose(x[:, 0], 2.0)
    x[first, 0], x[second, 0] = 2.0, 1.0
    with refused("folded on a neighbour"):
        check_cells(msh)


@pytest.mark.mpi
@cells
def test_a_flat_cell_is_found(cell):
    msh = lattice(cell, 1)
    msh.geometry.x[:, CELLS[cell] - 1] = 0.0
    with refused("has no volume"):
        check_cells(msh)


@pytest.mark.mpi
@cells
def test_a_node_without_coordinates_is_found(cell):
    msh = lattice(cell, 2)
    move(msh, [0.5] * CELLS[cell], [float("nan")])
    with refused("coordinates are not finite"):
        check_cells(msh)


def test_a_quadrilateral_with_two_nodes_at_one_place_passes():
    """Collapsed to a triangle it still has a volume, as meshers make it at tips."""
    domain = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    check_cells(mesh.create_mesh(MPI.COMM_SELF, np.array([[0, 1, 2, 3]]), domain, x))
    x[3] = [-0.5, -0.5]
    bad = mesh.create_mesh(MPI.COMM_SELF, np.array([[0, 1, 2, 3]]), domain, x)
    with refused(r"Cell 0 .* at \(0.125, 0.125\) is inverted in part"):
        check_cells(bad)


@pytest.mark.mpi
def test_facets_without_area_are_named():
    """The contact nodes coincide: it is the mesh that is named, not the loads."""
    from models import tagged_facets

    msh = lattice("quadrilateral", 2)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0))
    msh.geometry.x[np.isclose(msh.geometry.x[:, 1], 0.0), 0] = 0.5
    with refused(r"Contact surface 'floor': the facets at node \(0.5, 0, 0\) have no area"):
        ff.ContactSurface(msh, tags, 1, "floor")
