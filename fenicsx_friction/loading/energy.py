# SPDX-License-Identifier: MIT
"""Energy audit: external work = stored energy + dissipation + defect, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from ..base.compilation import compiled
from ..base.domains import check_terminals
from ..base.errors import ContactInputError
from ..base.literals import lifted_form
from ..base.validators import instance
from ..equations.balance import assemble_owned
from ..problem import FrictionalContactProblem


@dataclass(frozen=True)
class EnergyBalance:
    """Energies of one accepted step (J, per unit depth in 2D).

    Attributes:
        external_work: Work of the loads and of the reactions at prescribed displacements.
        stored: Change of the stored energy.
        dissipation: Frictional work ``-sum area c_t . s`` with the tractions at the step's end.
        smallest_dissipation: The smallest frictional work of a node; negative would be unphysical.
        contact_work: Work of the contact forces on the body by the trapezoidal rule.
    """

    external_work: float
    stored: float
    dissipation: float
    smallest_dissipation: float
    contact_work: float

    def __add__(self, other: EnergyBalance) -> EnergyBalance:
        """Return the balance of both steps together."""
        return EnergyBalance(
            self.external_work + other.external_work,
            self.stored + other.stored,
            self.dissipation + other.dissipation,
            min(self.smallest_dissipation, other.smallest_dissipation),
            self.contact_work + other.contact_work,
        )

    @property
    def defect(self) -> float:
        """``external_work - stored - dissipation``: the error of the balance in finite steps.

        The law holds at the end of the step, but work is done along it. For a body with quadratic
        energy the defect is ``-contact_work - dissipation``. It vanishes with the step size. Where
        a body snaps, it is the energy set free.
        """
        return self.external_work - self.stored - self.dissipation


class EnergyAudit:
    """Audits the accepted steps of a problem; create it before the first step.

    Args:
        problem: The problem.
        stored: Stored energy, a UFL functional of ``u`` (J).
        loads: Virtual work of the external forces, a UFL linear form, or ``None`` without loads.
    """

    def __init__(
        self, problem: FrictionalContactProblem, stored: ufl.Form, loads: ufl.Form | None = None
    ) -> None:
        instance(problem, FrictionalContactProblem, "problem", "a FrictionalContactProblem")
        _check_form(problem, stored, "stored", 0, "the stored energy, a functional")
        if loads is not None:
            _check_form(
                problem, loads, "loads", 1, "the work of the loads, linear in a test function"
            )
        self._problem = problem
        form = compiled(fem.form, problem.comm)
        self._stored = form(lifted_form(stored))
        self._loads = None if loads is None else form(lifted_form(loads))
        self.restart()

    def restart(self) -> None:
        """Begin at the present state and loads; what came before is not audited; collective."""
        self._u, self._step = self._problem.u.x.array.copy(), self._problem.num_steps
        self._energy, self._forces, self._contact = self._evaluate()

    def kept(self) -> list[fem.Function]:
        """Return external and contact forces (N) at the state audited last, for a checkpoint."""
        V, found = self._problem.u.function_space, []
        for name, values in (("external_forces", self._forces), ("contact_forces", self._contact)):
            function = fem.Function(V, name=name)
            function.x.array[: len(values)] = values
            found.append(function)
        return found

    def resume(self, kept: Sequence[fem.Function]) -> None:
        """Begin at the present state, in which the forces were kept; collective.

        They do not follow from it: pairs of deformable bodies are those of the step before.
        """
        self.restart()
        owned = len(self._forces)
        self._forces, self._contact = (f.x.array[:owned].copy() for f in kept)

    def check(self, problem: FrictionalContactProblem) -> None:
        """Raise a ContactInputError unless it audits the problem."""
        if self._problem is not problem:
            raise ContactInputError(
                f"audit = {self!r} is one of another problem; give EnergyAudit(problem, ...)."
            )

    def update(self) -> EnergyBalance:
        """Balance the step accepted since the last call; collective.

        Raises:
            ContactInputError: If no step was accepted since.
        """
        if self._problem.num_steps <= self._step:
            raise ContactInputError(
                f"EnergyAudit.update(): no step was accepted since step {self._step}; call it "
                "after a solve() whose report is certified."
            )
        energy, forces, contact = self._evaluate()
        owned = len(forces)
        du = (self._problem.u.x.array - self._u)[:owned]
        nodal = np.concatenate(
            [-s.area * np.einsum("ij,ij->i", s.c[:, 1:], s.slip) for s in self._problem.accepted]
        )
        comm = self._problem.comm
        local = [(forces + self._forces) @ du / 2.0, np.sum(nodal)]
        local.append((contact + self._contact) @ du / 2.0)
        work, dissipation, contact_work = comm.allreduce(np.array(local), MPI.SUM)
        balance = EnergyBalance(
            external_work=float(work),
            stored=energy - self._energy,
            dissipation=float(dissipation),
            smallest_dissipation=comm.allreduce(float(np.min(nodal, initial=np.inf)), MPI.MIN),
            contact_work=float(contact_work),
        )
        self._u, self._step = self._problem.u.x.array.copy(), self._problem.num_steps
        self._energy, self._forces, self._contact = energy, forces, contact
        return balance

    def _evaluate(self) -> tuple[float, npt.NDArray[np.floating], npt.NDArray[np.floating]]:
        """Return stored energy, external and contact forces (owned dofs) at the current state."""
        comm = self._problem.comm
        energy = float(comm.allreduce(fem.assemble_scalar(self._stored), MPI.SUM))
        momentum, contact = self._problem.balance.momentum(), -self._problem.terms.momentum()
        forces = np.zeros_like(contact)
        held = self._problem.constrained_dofs
        held = held[held < len(forces)]
        # The residual at prescribed dofs is the reaction.
        forces[held] = momentum[held]
        if self._loads is not None:
            forces += assemble_owned(self._loads)
        return energy, forces, contact


def _check_form(
    problem: FrictionalContactProblem, form: Any, name: str, rank: int, cure: str
) -> None:
    """Raise a ContactInputError unless a form has a rank and belongs to the problem's mesh."""
    instance(form, ufl.Form, name, f"{cure}, as a UFL form")
    V, arguments = problem.u.function_space, form.arguments()
    if len(arguments) != rank or any(a.ufl_function_space() != V for a in arguments):
        raise ContactInputError(
            f"{name} is a form with {len(arguments)} test functions, or of another space than u's; "
            f"give {cure}."
        )
    for integral in form.integrals():
        check_terminals(integral.integrand(), [V.mesh], name)
