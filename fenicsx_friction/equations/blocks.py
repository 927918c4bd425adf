# SPDX-License-Identifier: MIT
"""The derivatives of a contact's equations: small dense blocks, and where they are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from ..contact.contact import Contact
from ..obstacles.reaction import body_blocks, body_slopes
from ..obstacles.rigid_pairing import RigidPairing
from ..surfaces.nodal_kernel import NodalKernel

Array = npt.NDArray[np.floating]
Part = TypeVar("Part")
#: Entries at the rows and at the columns of blocks, one row a block.
Places = tuple[npt.NDArray, npt.NDArray]


@dataclass(frozen=True)
class Blocks(Generic[Part]):
    """Something that each kind of blocks of a contact has: their values, or their places.

    Attributes:
        laws: Rows of the laws by the stencil, the multipliers and further unknowns; one a node.
        levers: Balance of forces at the stencil by the multipliers; one a node.
        turning: Balance of forces by displacements, as forces turn and move with the surfaces.
        body: Balance of forces by the motion of a rigid body that carries loads; its own balance by
            the multipliers, the stencil and its motion. Rows of laws depend on this last.
    """

    laws: Part
    levers: Part
    turning: list[Part]
    body: list[Part]

    def __iter__(self) -> Iterator[Part]:
        """Go through all kinds."""
        yield from (self.laws, self.levers, *self.turning, *self.body)

    def stiff(self) -> list[Part]:
        """Return those of forces by displacements and motions."""
        return [*self.turning, *(self.body[i] for i in (0, 2, 3) if self.body)]

    def by_multipliers(self) -> list[Part]:
        """Return those of forces by the multipliers: on the nodes, and on a rigid body."""
        return [self.levers, *self.body[1:2]]


def columns_of_laws(at: Blocks[Places], blocks: Blocks[Array]) -> tuple[slice, slice, slice]:
    """Return which columns of the laws' rows are of stencil, multipliers and a rigid body.

    Args:
        at: Places of the blocks of a contact whose laws depend on no further unknowns.
        blocks: Their values.
    """
    c, columns = at.laws
    motion = blocks.body[0].shape[2] if blocks.body else 0
    end = columns.shape[1] - motion
    first = end - c.shape[1]
    return slice(first), slice(first, end), slice(end, end + motion)


#: Places and values of the blocks of a contact, and the softness of its nodes.
Coupling = tuple[Blocks[Places], Blocks[Array], Array]


def derivatives_of(k: Contact, kernel: NodalKernel) -> Blocks[Array]:
    """Return the blocks of a contact: (blocks, rows, columns); collective."""
    k.pairing.update()
    slopes, weight_slopes = k.pairing.derivatives()
    by_field, by_c, *by_others = kernel.derivatives()
    n, d, area = len(slopes), k.pairing.side.d, k.nodal_area()[:, None, None]
    levers, by_body, of_body = k.pairing.levers(), [], []
    if isinstance(k.pairing, RigidPairing) and k.pairing.body is not None:
        by_body = [by_field @ body_slopes(k.pairing)]
        of_body = body_blocks(k.pairing, k.pairing.body)
    return Blocks(
        np.concatenate([by_field @ slopes, by_c, *by_others, *by_body], axis=2) * area,
        -levers.reshape(n, d, levers.shape[2] * d).transpose(0, 2, 1) * area,
        [-turned for turned in k.pairing.turning(slopes, weight_slopes)],
        of_body,
    )
