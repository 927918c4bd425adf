# SPDX-License-Identifier: MIT
"""Refuses cells without volume, cells inverted in part, and cells folded on their neighbours."""

from mpi4py import MPI

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import mesh

from ..base.collective import largest_of_ranks
from ..base.errors import ContactInputError

Array = npt.NDArray[np.floating]
#: Volumes below this fraction of the product of the edges are rounding.
FLAT = 1e-13
#: The vertices joined to each vertex of a reference cell.
NEIGHBOURS: dict[str, list[tuple[int, ...]]] = {
    "triangle": [(1, 2), (2, 0), (0, 1)],
    "quadrilateral": [(1, 2), (3, 0), (0, 3), (2, 1)],
    "tetrahedron": [(1, 2, 3), (2, 0, 3), (0, 1, 3), (0, 2, 1)],
    "hexahedron": [
        (1, 2, 4),
        (0, 5, 3),
        (0, 3, 6),
        (1, 7, 2),
        (0, 6, 5),
        (1, 4, 7),
        (2, 7, 4),
        (3, 5, 6),
    ],
}


def check_cells(msh: mesh.Mesh) -> None:
    """Raise a ContactInputError, on all ranks, if a cell is flat, inverted or folded; collective.

    Cells of DOLFINx have no orientation: the volumes spanned at the vertices of one cell must
    have one sign, and two cells must lie on opposite sides of the facet between them.
    """
    tdim = msh.topology.dim
    owned = msh.topology.index_map(tdim).size_local
    x = msh.geometry.x[:, :tdim]
    nodes, neighbours = x[msh.geometry.dofmaps[0]], NEIGHBOURS[msh.basix_cell().name]
    corners = nodes[:, : len(neighbours)]
    broken = ~np.isfinite(corners[:owned]).all(axis=(1, 2))
    _refuse(msh, broken, "has a vertex whose coordinates are not finite")
    volumes = _corner_volumes(corners[:owned], neighbours)
    low, high = volumes.min(axis=0), volumes.max(axis=0)
    _refuse(msh, np.maximum(abs(low), abs(high)) <= FLAT, "has no volume")
    inverted = (low < -FLAT) & (high > FLAT)
    _refuse(msh, inverted, "is inverted in part: det J has both signs at its vertices")
    if corners.shape != nodes.shape:
        volumes = _curved_volumes(msh, nodes[:owned])
        turned = np.min(volumes, axis=0) * np.max(volumes, axis=0) <= 0.0
        _refuse(msh, turned, "is curved so much that det J has both signs in it")
    folded = _folded(msh, corners.mean(axis=1))[:owned]
    _refuse(msh, folded, "is folded on a neighbour: both on the same side")


def _corner_volumes(corners: Array, neighbours: list[tuple[int, ...]]) -> Array:
    """Return the volume spanned at each vertex over the product of its edges, one column a cell."""
    points = np.ascontiguousarray(corners.transpose(1, 2, 0))  # vertex, component, cell: faster
    result = np.empty((len(points), len(corners)))
    for vertex, others in enumerate(neighbours):
        edges = [points[other] - points[vertex] for other in others]
        lengths = np.sqrt(np.prod([np.einsum("ij,ij->j", e, e) for e in edges], axis=0))
        lengths[lengths == 0.0] = 1.0
        last = _perpendicular(*edges[:-1])
        result[vertex] = np.einsum("ij,ij->j", last, edges[-1]) / lengths
    return result


def _curved_volumes(msh: mesh.Mesh, nodes: Array) -> Array:
    """Return det J at the nodes of curved cells, one column a cell."""
    domain = msh.ufl_domain()
    assert domain is not None
    element = domain.ufl_coordinate_element().sub_elements[0]
    slopes = element.tabulate(1, element.basix_element.points)[1:]
    return np.linalg.det(np.einsum("tqk,ckd->qcdt", slopes, nodes))


def _perpendicular(a: Array, b: Array | None = None) -> Array:
    """Return the vector product of columns; of one in 2D, its normal to the left."""
    if b is None:
        return np.stack([-a[1], a[0]])
    return np.stack([a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)])


def _folded(msh: mesh.Mesh, centers: Array) -> npt.NDArray[np.bool_]:
    """Tell which cells, ghosts included, lie on the same side of a facet as their neighbour."""
    tdim = msh.topology.dim
    msh.topology.create_connectivity(tdim - 1, tdim)
    msh.topology.create_connectivity(tdim, tdim - 1)
    cells = msh.topology.connectivity(tdim - 1, tdim)
    interior = np.flatnonzero(np.diff(cells.offsets) == 2).astype(np.int32)
    pairs = cells.array[cells.offsets[interior][:, None] + np.arange(2)]
    nodes = mesh.entities_to_geometry(msh, tdim - 1, interior)[:, : _corners_of_facets(msh)]
    x = np.ascontiguousarray(msh.geometry.x[nodes, :tdim].transpose(1, 2, 0))
    normal = _facet_normals(x)
    middle = x.mean(axis=0)
    sides = [np.einsum("ij,ij->j", normal, centers[pair].T - middle) for pair in pairs.T]
    folded = np.zeros(len(centers), dtype=bool)
    folded[pairs[sides[0] * sides[1] > 0.0]] = True
    return folded


def _corners_of_facets(msh: mesh.Mesh) -> int:
    """Return how many vertices a facet has."""
    return len(basix.topology(msh.basix_cell())[msh.topology.dim - 1][0])


def _facet_normals(x: Array) -> Array:
    """Return normals (any length) of facets, the mean ones of quadrilaterals, as columns."""
    if len(x) == 2:
        return _perpendicular(x[1] - x[0])
    if len(x) == 3:
        return _perpendicular(x[1] - x[0], x[2] - x[0])
    return _perpendicular(x[3] - x[0], x[2] - x[1])  # the diagonals


def _refuse(msh: mesh.Mesh, bad: npt.NDArray[np.bool_], what: str) -> None:
    """Raise on all ranks if an owned cell is bad, naming the first and where it is."""
    found, tdim = np.flatnonzero(bad), msh.topology.dim
    message = None
    if len(found) > 0:
        number = int(msh.topology.original_cell_index[found[0]])
        middle = msh.geometry.x[msh.geometry.dofmaps[0][found[0]], :tdim].mean(axis=0)
        where = ", ".join(f"{value:.6g}" for value in middle)
        message = f"Cell {number} of the mesh (by the order of its making) at ({where}) {what}"
    messages = [m for m in msh.comm.allgather((message, len(found))) if m[0]]
    if messages:
        count = sum(m[1] for m in messages)
        raise ContactInputError(
            f"{messages[0][0]}; {count} such cells in all. Mend the mesh; contact is not solved "
            "on overlapping or empty cells."
        )


def extreme_sizes(msh: mesh.Mesh) -> tuple[float, float]:
    """Return the sizes of the smallest and of the largest cell (m); collective."""
    cells = np.arange(msh.topology.index_map(msh.topology.dim).size_local, dtype=np.int32)
    sizes = msh.h(msh.topology.dim, cells)
    smallest, largest = np.min(sizes, initial=np.inf), np.max(sizes, initial=0.0)
    return (
        float(msh.comm.allreduce(float(smallest), MPI.MIN)),
        float(msh.comm.allreduce(float(largest), MPI.MAX)),
    )


def extent(msh: mesh.Mesh) -> float:
    """Return the length of the longest side of the box about a mesh (m); collective."""
    x = msh.geometry.x
    ends = np.concatenate([np.max(a, axis=0, initial=-np.inf) for a in (x, -x)])
    high, low = np.split(largest_of_ranks(msh.comm, ends), 2)
    return float(np.max(high + low))
