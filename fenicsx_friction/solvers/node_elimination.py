# SPDX-License-Identifier: MIT
"""Multipliers eliminated node by node from the matrix of Newton's method, approximately.

A closed node's row fixes a displacement and does not contain the multiplier, an open one's does the
opposite. With a small multiple of the multiplier added to each row, the multiplier follows from it,
``c = N^-1 (r - C u)``, and what it does to the balance of forces is a spring ``-B N^-1 C``: stiff
where the node is closed, none where it is open, across the direction of slip where it slips.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..equations.blocks import Blocks, Places, columns_of_laws

Array = npt.NDArray[np.floating]
Indices = npt.NDArray[np.int64]

#: The multiplier that is added to each row, relative: against a rigid obstacle, and against faces
#: of another body. A closed node's spring is as many times stiffer than the body as this is
#: smaller than one, and softer on fine contacts, whose rows have a smaller ``r_p``. With a plane,
#: 0.03 to 0.3 take about the same iterations. Springs between bodies couple nodes: a smoother that
#: goes from node to node follows stiff ones slowly (four times the iterations at 1e-2; at 0.2 twice
#: where they join two ranks).
ALONE, COUPLED = 0.1, 0.7


@dataclass(frozen=True)
class NodeBlocks:
    """The blocks of each node of a contact, of this rank.

    Attributes:
        q, c: Rows of displacements and multipliers, -1 for those that are left out.
        forces: Derivatives of the nodal forces by the multipliers.
        slopes: Derivatives of the rows of the law by the displacements.
        inverse: Inverse of the derivatives of these rows by the multipliers, made regular.
        roots: What the multipliers do to the balance of forces is symmetric and not negative: these
            times their transposed.
    """

    q: Indices
    c: Indices
    forces: Array
    slopes: Array
    inverse: Array
    roots: Array


def node_blocks(
    places: Blocks[Places], blocks: Blocks[Array], softness: Array, d: int
) -> NodeBlocks:
    """Eliminate the multipliers of a contact; its laws contain no further unknowns.

    Args:
        places: Numbers of the unknowns, the node's own displacements first; -1 for those that are
            left out.
        blocks: The blocks there.
        softness: ``r_p`` of each node relative to its stiffness over area, where this is less: the
            springs are to be stiffer than the body nevertheless.
        d: Multipliers of a node.
    """
    (c, columns), loaded = places.laws, places.levers[0].shape[1]
    stencil, multipliers, _ = columns_of_laws(places, blocks)
    q = columns[:, stencil]
    there = q >= 0
    forces = np.zeros((*q.shape, d))  # none on the rest of the stencil
    forces[:, :loaded] = np.where(there[:, :loaded, None], blocks.levers, 0.0)
    slopes = np.where(there[:, None, :], blocks.laws[:, :, stencil], 0.0)
    share = (ALONE if q.shape[1] == d else COUPLED) * softness[:, None]
    parts = (blocks.laws[:, :, multipliers], blocks.laws[:, :, :d], blocks.levers[:, :d])
    regular = _regular(*parts, share)
    try:
        inverse = np.linalg.inv(regular)
    except np.linalg.LinAlgError:  # one of them is singular
        inverse = np.linalg.pinv(regular)
    roots = _roots(-forces @ inverse, slopes.transpose(0, 2, 1))
    return NodeBlocks(q, c, forces, slopes, inverse, roots)


def _roots(a: Array, b: Array) -> Array:
    """Return roots of the positive parts of ``(a b^T + b a^T) / 2``, (nodes, rows, rank).

    The matrices have many rows and few columns: the products would be large.
    """
    columns = a.shape[2]
    across, small = np.linalg.qr(np.concatenate([a, b], axis=2))
    product = 0.5 * small[:, :, :columns] @ small[:, :, columns:].transpose(0, 2, 1)
    values, vectors = np.linalg.eigh(product + product.transpose(0, 2, 1))
    roots = across @ vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
    return np.asarray(roots)


def _regular(by_c: Array, by_own: Array, forces: Array, share: Array) -> Array:
    """Return derivatives of the rows by the multipliers with something added to the diagonal.

    What is added has the sign that makes the spring positive. The coupling of normal and tangential
    multipliers, which is not symmetric, is left out.
    """
    area = np.linalg.norm(forces, axis=1)  # of each multiplier
    size = np.where(area > 0.0, area, 1.0)
    diagonal = np.einsum("nii->ni", by_c) / size
    stiff = -np.einsum("nij,nji->ni", by_own, forces) / size
    largest = np.max(abs(stiff), axis=1, keepdims=True, initial=0.0)
    sign = np.sign(diagonal + stiff / np.where(largest > 0.0, largest, 1.0))
    regular = by_c.copy()
    regular[:, 0, 1:] = regular[:, 1:, 0] = 0.0
    i = np.arange(by_c.shape[1])
    regular[:, i, i] += share * size * np.where(sign == 0.0, 1.0, sign)
    return np.asarray(regular)
