# SPDX-License-Identifier: MIT
"""Motions of whole bodies that conditions, given values and springs of their own do not hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..contact.contact import Contact
from ..obstacles.rigid_body import RigidBody
from .floating import FloatingBodies

Array = npt.NDArray[np.floating]
#: What :meth:`.FloatingBodies.moved` returns of each body.
Moves = Mapping[int, tuple[Array, float]]

#: Motions (relative to the length of the mesh; rad) that are not rounding.
MOVED = 1e-6
#: A body may go so many times further than bodies deform where nothing holds it, but not further
#: than half the mesh, or than twice what they deform.
FURTHER, HALF, TWICE = 10.0, 0.5, 2.0


@dataclass(frozen=True)
class LooseMotion:
    """One motion of one body: by the length of the mesh, or a turn that moves points so far.

    Attributes:
        owner: The body, in words.
        name: The component.
        unit: What a motion by one is (m; rad).
        values: The motion as values of the local dofs of each unknown.
        virtual: The same as shares of the rows, which are forces (N): virtual work is theirs.
        moved: How far the body has gone in the step.
        spared: How far it may go where nothing holds it.
        deformable: Whether it deforms.
    """

    owner: str
    name: str
    unit: float
    values: list[Array]
    virtual: list[Array]
    moved: float
    spared: float
    deformable: bool


def name_of(surfaces: Sequence[str]) -> str:
    """Return how a deformable body is called, by its contact surfaces."""
    named = "', '".join(surfaces)
    return f"the body with the surface '{named}'" if surfaces else "a body without contact"


def spared_of(deformed: float) -> float:
    """Return how far bodies may go where nothing holds them, by what they deform in a step."""
    return max(MOVED, min(FURTHER * deformed, max(HALF, TWICE * deformed)))


def without_springs(body: RigidBody) -> npt.NDArray[np.bool_]:
    """Tell which components of a rigid body are free and have no spring."""
    return np.asarray(body.released & (body.spring.value == 0.0))


def of_rigid(
    body: RigidBody, state: Sequence[fem.Function], i: int, start: Array, deformed: float
) -> Iterator[LooseMotion]:
    """Yield the motions of a rigid body.

    Args:
        body: The body.
        state: All unknowns.
        i: Which of them is its motion.
        start: This one at the start of the step.
        deformed: Largest change of shape of a deformable body in the step, over the length.
    """
    size = body.length * body.unit
    moved = (body.q.x.array - start) / size
    for j in np.flatnonzero(without_springs(body)):
        values, virtual = ([np.zeros_like(f.x.array) for f in state] for _ in range(2))
        values[i][j], virtual[i][j] = size[j], body.length
        yield LooseMotion(
            f"rigid body '{body.name}'",
            body.names[j],
            float(size[j]),
            values,
            virtual,
            float(moved[j]),
            spared_of(deformed),
            deformable=False,
        )


def of_floating(
    floating: FloatingBodies,
    state: Sequence[fem.Function],
    moves: Moves,
    contacts: Sequence[Contact],
    *,
    undeformed: bool,
) -> Iterator[LooseMotion]:
    """Yield the motions of those deformable bodies without conditions that have moved; collective.

    Args:
        floating: The bodies.
        state: All unknowns, the displacement first.
        moves: How far they have gone in the step.
        contacts: The contacts, for the names of the surfaces.
        undeformed: Whether turns are those about where the bodies were at first.
    """
    others = [np.zeros_like(f.x.array) for f in state[1:]]
    for body in floating.bodies:
        moved, rest = moves[body]
        spared = spared_of(rest)
        if np.all(abs(moved) <= spared):
            continue  # it holds what cannot move without it
        shapes, units = floating.motions(body, undeformed=undeformed)
        owner = name_of(floating.surfaces_of(body, contacts))
        for j, name in enumerate(floating.names):
            values = [shapes[:, j], *others]
            yield LooseMotion(
                owner,
                name,
                float(units[j]),
                values,
                values,
                float(moved[j]),
                spared,
                deformable=True,
            )
