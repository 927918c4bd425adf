# SPDX-License-Identifier: MIT
"""What is made once, before the first step: stiffness, contacts, further equations."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, mesh

from ..base.errors import ContactInputError
from ..contact.checks import check_normals
from ..contact.contact import Contact
from ..contact.sides import check_met_once, check_sides
from ..equations.body_equation import BodyEquation, bodies_of
from ..equations.conditions import constrained
from ..equations.further_equation import FurtherEquation
from ..equations.numbering import contact_dofs
from ..equations.patches import felt_stiffness
from ..equations.stiffness import Stiffness
from ..obstacles.motion import Motion
from ..obstacles.rigid_body import RigidBody


def stiffness_of(tangent: Stiffness, V: fem.FunctionSpace) -> tuple[fem.Function, PETSc.Mat]:
    """Return the diagonal of the bulk stiffness (N/m), and the stiffness itself; collective."""
    matrix = tangent.assemble()
    diagonal = fem.Function(V)
    diagonal.x.array[: matrix.getLocalSize()[0]] = matrix.getDiagonal().array
    diagonal.x.scatter_forward()
    return diagonal, matrix


def set_up_contacts(
    contacts: Sequence[Contact],
    displacements: tuple[fem.Function, fem.Function],
    dt: fem.Constant,
    normal: str,
    bcs: Sequence[fem.DirichletBC],
    stiffness: fem.Function,
    matrix: PETSc.Mat,
) -> None:
    """Pair the nodes, set scales and prescribed directions of all contacts; collective.

    Args:
        contacts: The contacts.
        displacements: The displacement, and that of the last accepted step.
        dt: Length of the step (s).
        normal: Name of the normal complementarity function.
        bcs: Dirichlet conditions.
        stiffness: Diagonal of the bulk stiffness (N/m).
        matrix: The stiffness.

    Raises:
        ContactInputError: If a contact cannot be set up.
    """
    comm = stiffness.function_space.mesh.comm
    for k in contacts:
        k.bind(*displacements, dt, normal)
        check_normals(k)
        check_sides(k)
    check_met_once(contacts)
    nodes = contact_dofs(contacts, stiffness.function_space)
    felt = felt_stiffness(matrix, stiffness, nodes)
    for k in contacts:
        k.set_scale(stiffness, felt)
    lowest = min(np.min(k.scale.x.array, initial=np.inf) for k in contacts)
    if not comm.allreduce(lowest, MPI.MIN) > 0.0:
        raise ContactInputError(
            "The bulk residual has no positive stiffness at some contact node; check F, its "
            "sign (internal minus external forces) and the initial u."
        )
    held = constrained(stiffness.function_space, bcs)
    for k in contacts:
        k.hold(held)


@contextmanager
def unbound_on_error(contacts: Sequence[Contact]) -> Iterator[None]:
    """Leave the contacts as they were if what is inside fails, so that they can be used again."""
    kept = [(k, dict(vars(k))) for k in contacts]
    try:
        yield
    except BaseException:
        for part, attributes in kept:
            vars(part).clear()
            vars(part).update(attributes)
        raise


def rates_of(
    unknowns: Sequence[fem.Function], bodies: Sequence[RigidBody], contacts: Sequence[Contact]
) -> list[fem.Function]:
    """Return what keeps the rates of change of unknowns, motions and multipliers, zero at first."""
    given = unknowns[: len(unknowns) - len(bodies)]
    rates = [fem.Function(f.function_space, name=f"{f.name}_rate") for f in given]
    return [*rates, *(body.q_rate for body in bodies), *(k.c_rate for k in contacts)]


def claim_motions(contacts: Sequence[Contact], problem: object) -> list[Motion]:
    """Return the motions of all obstacles, each once, which belong to the problem now."""
    found = {id(k.obstacle.motion): k.obstacle.motion for k in contacts}
    motions = [motion for motion in found.values() if motion is not None]
    for motion in motions:
        motion.claim(problem)
    return motions


def further_equations(
    blocks: Sequence[ufl.Form],
    unknowns: Sequence[fem.Function],
    bcs: Sequence[fem.DirichletBC],
    stiffness: fem.Function,
    entity_maps: Sequence[mesh.EntityMap],
    contacts: Sequence[Contact],
) -> list[FurtherEquation | BodyEquation]:
    """Return the equations beside the momentum balance, those of rigid bodies last; collective."""
    comm = stiffness.function_space.mesh.comm
    stiffest = comm.allreduce(float(np.max(abs(stiffness.x.array), initial=0.0)), MPI.MAX)
    bodies = bodies_of(contacts)
    found: list[FurtherEquation | BodyEquation] = [
        FurtherEquation(block, unknown, unknowns, stiffest, bcs, entity_maps)
        for block, unknown in zip(blocks, unknowns[1 : len(unknowns) - len(bodies)], strict=False)
    ]
    for body in bodies:
        body.scale(stiffest)
        found.append(BodyEquation(body, [k for k in contacts if k.pairing.body is body]))
    return found
