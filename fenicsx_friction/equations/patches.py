# SPDX-License-Identifier: MIT
"""What contact nodes feel of the bulk when the nodes beside them give way.

The diagonal of the stiffness holds all other nodes. In a nearly incompressible body, to move one
node among held ones changes volumes, against the bulk modulus; but if its neighbours give way, the
material flows round it, against the shear modulus, which may be smaller by thousands.
"""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import any_rank, largest_of_ranks

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]

#: The diagonal counts as far too stiff from this many times what a node feels. Compressible bodies
#: (nu up to 0.4, P1 to P3, Q1, Q2, MINI, cells up to ten times longer than wide) stay below.
TOO_STIFF = 5.0
#: So many nodes of a rank are looked at first, and the others only if one of them is too stiff.
FIRST = 50
#: Nodes whose neighbours are taken out of the matrix at once.
CHUNK = 500


def felt_stiffness(matrix: PETSc.Mat, diagonal: fem.Function, dofs: Indices) -> fem.Function:
    """Return the stiffness (N/m) that nodes feel, where the diagonal is far more; collective.

    It is the mean diagonal of the stiffness of the node when the nodes with which it shares a cell
    may move, and all others are held; elsewhere it is the diagonal.

    Args:
        matrix: Stiffness of the bulk (N/m), without conditions.
        diagonal: Its diagonal.
        dofs: The owned dofs of the nodes, all of each node, ascending.
    """
    felt, V = diagonal.copy(), diagonal.function_space
    comm, bs = V.mesh.comm, V.dofmap.index_map_bs
    values, nodes = felt.x.array.reshape(-1, bs), dofs[::bs] // bs
    stiffest_first = nodes[np.argsort(-values[nodes].mean(axis=1), kind="stable")]
    first = stiffest_first[:: max(-(-len(nodes) // FIRST), 1)]
    for part in (first, np.setdiff1d(nodes, first)):
        found = _given_way(matrix, part, bs, comm)
        soft = TOO_STIFF * found < values[part].mean(axis=1)
        values[part[soft]] = found[soft, None]
        if not any_rank(comm, bool(np.any(soft))):
            break
    felt.x.scatter_forward()
    return felt


def _given_way(matrix: PETSc.Mat, nodes: Indices, bs: int, comm: MPI.Intracomm) -> Array:
    """Return the mean stiffness of owned nodes whose neighbours may move; collective."""
    (chunks,) = largest_of_ranks(comm, np.array([float(-(-len(nodes) // CHUNK))]))
    parts = [_of_chunk(matrix, part, bs) for part in np.array_split(nodes, max(int(chunks), 1))]
    return np.concatenate(parts)


def _of_chunk(matrix: PETSc.Mat, nodes: Indices, bs: int) -> Array:
    """Return the same for some nodes: their rows tell the neighbours; collective."""
    first = matrix.getOwnershipRange()[0]
    own = first + bs * nodes[:, None] + np.arange(bs)
    beside = [np.unique(np.concatenate([matrix.getRow(int(i))[0] for i in row])) for row in own]
    every = np.unique(np.concatenate([*beside, np.zeros(0, dtype=PETSc.IntType)]))
    rows = PETSc.IS().createGeneral(every.astype(PETSc.IntType), comm=PETSc.COMM_SELF)
    (local,) = matrix.createSubMatrices([rows], [rows])
    csr = local.getValuesCSR()
    at = np.full(len(every), -1)
    found = [
        _schur_mean(_dense(csr, np.searchsorted(every, patch), at), np.searchsorted(patch, mine))
        for patch, mine in zip(beside, own, strict=True)
    ]
    local.destroy()
    rows.destroy()
    return np.array(found, dtype=float)


def _dense(csr: tuple[Indices, Indices, Array], chosen: Indices, at: Indices) -> Array:
    """Return some rows and columns of a sparse matrix; ``at`` is -1 before and after."""
    starts, columns, values = csr
    counts = starts[chosen + 1] - starts[chosen]
    ends = np.cumsum(counts)
    entries = np.arange(ends[-1]) + np.repeat(starts[chosen] - ends + counts, counts)
    at[chosen] = np.arange(len(chosen))
    place = at[columns[entries]]
    at[chosen] = -1
    dense = np.zeros((len(chosen), len(chosen)))
    row, there = np.repeat(np.arange(len(chosen)), counts), place >= 0
    dense[row[there], place[there]] = values[entries[there]]
    return dense


def _schur_mean(stiffness: Array, mine: Indices) -> float:
    """Return the mean diagonal of the Schur complement, infinite where there is no sense in it."""
    others = np.delete(np.arange(len(stiffness)), mine)
    coupling = stiffness[np.ix_(others, mine)]
    try:
        moved = np.linalg.solve(stiffness[np.ix_(others, others)], coupling)
    except np.linalg.LinAlgError:
        return np.inf
    schur = stiffness[np.ix_(mine, mine)] - stiffness[np.ix_(mine, others)] @ moved
    least = np.finfo(float).eps ** 0.5 * np.trace(stiffness[np.ix_(mine, mine)])
    found = float(np.trace(schur))
    return found / len(mine) if np.isfinite(found) and found > least else np.inf
