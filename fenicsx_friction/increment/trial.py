# SPDX-License-Identifier: MIT
"""One try to solve a step in one way: from its start to the certificate."""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

from dolfinx import fem

from ..base.log import tell
from ..equations.conditions import missed_values
from ..equations.forces import MISSED
from ..solvers.report import SubstepReport
from . import snapshot
from .adrift import bodies_adrift
from .correctors import Attempt, correct, newton_tolerance, polish
from .crossed import crossed_nodes
from .extrapolation import extrapolate
from .rebalance import NOT_BALANCED, rebalance
from .report import StepReport
from .searching import search
from .system import ContactSystem
from .totals import totals_of_bodies

#: Searches for the faces that nodes meet, each but the last followed by a solve.
MAX_SEARCHES = 12


class Way(NamedTuple):
    """A way to solve a step.

    Attributes:
        attempt: The attempt; ``None`` for the present state as it is.
        condensed: Whether to solve on the boundary.
        forces: 2-norm of the forces of the step (N).
        linear_solver: What solves the linear systems of the whole system.
    """

    attempt: Attempt | None
    condensed: bool
    forces: float
    linear_solver: str = "direct"


class Outcome(NamedTuple):
    """What a try has led to; the unknowns hold the state.

    Attributes:
        report: The report.
        wrong: What is wrong with a state that solves all equations.
        converged: Whether Newton's method converged.
    """

    report: StepReport
    wrong: list[str]
    converged: bool

    @property
    def unbalanced(self) -> bool:
        """Whether a bulk that is not linear found no balance."""
        return any(s.reason == NOT_BALANCED for s in self.report.substeps[-1:])


class Trials:
    """Tries to solve a step, each from its start.

    Args:
        system: The system.
        changed: What tries change, beside the pairs.

    Attributes:
        system: As given.
        substeps: The reports of all substeps so far.
        tried: The attempts so far, and whether on the boundary.
    """

    def __init__(self, system: ContactSystem, changed: Sequence[fem.Function]) -> None:
        self.system, self._changed, self._kept = system, changed, snapshot.save(changed)
        self.substeps: list[SubstepReport] = []
        self.tried: list[tuple[Attempt, bool]] = []
        self._made, self._set_ups = system.solvers.factorisations, system.solvers.full.set_ups

    @property
    def start(self) -> snapshot.Snapshot:
        """The unknowns and multipliers at the start of the step."""
        return self._kept[: len(self.system.state)]

    @property
    def factorisations(self) -> int:
        """How often the bulk was factored so far."""
        return self.system.solvers.factorisations - self._made

    @property
    def set_ups(self) -> int:
        """How often the levels of multigrid were made so far."""
        return self.system.solvers.full.set_ups - self._set_ups

    def restore(self) -> None:
        """Put the start back, and the exact rows."""
        self.system.set_smoothing(xi=0.0, eps=0.0)
        snapshot.restore(self._changed, self._kept)

    def make(self, way: Way) -> Outcome | None:
        """Solve in one way and certify; ``None`` if the start is none, or not its own solution."""
        system, attempt = self.system, way.attempt
        self.restore()
        if attempt is not None:
            _close(system, again=bool(self.substeps))
        elif missed_values(system.unknowns, system.bcs) > MISSED:
            return None
        if way.condensed and not system.solvers.prepared():
            return None
        converged = False
        if not way.condensed:
            system.solvers.full.take_linear_solver(way.linear_solver)
        with system.solvers.use(condensed=way.condensed):
            if attempt is not None:
                if attempt.onward and not extrapolate(system):
                    return None
                self.tried.append((attempt, way.condensed))
                found = _solve(system, attempt, way)
                self.substeps += found
                converged = found[-1].converged
                if way.condensed and not converged and found[-1].reason != NOT_BALANCED:
                    return None  # it need not be known what the inside of the bulk does
            elif not system.projection.is_solved(newton_tolerance(system)) or _meets_others(system):
                return None  # else contact did not change and the state is its own solution
        if way.condensed and not (converged and system.solvers.relinearises):
            system.solvers.recover()
        report, wrong = self._judge("condensed" if way.condensed else "full")
        return Outcome(report, wrong, converged)

    def _judge(self, solver: str) -> tuple[StepReport, list[str]]:
        """Certify a state; say what is wrong with it although it solves all equations."""
        system = self.system
        certificate = system.certify()
        adrift = bodies_adrift(system, self.start) if certificate.solved else []
        crossed = crossed_nodes(system) if certificate.solved and not adrift else []
        contacts = system.contact_reports()
        report = StepReport(
            system.num_steps + 1,
            system.settings.corrector,
            tuple(self.substeps),
            contacts,
            replace(certificate, crossed=len(crossed), adrift=len(adrift)),
            self.factorisations,
            solver,
            "direct" if solver == "condensed" else system.solvers.full.linear_solver,
            self.set_ups,
            bodies=totals_of_bodies(system.bodies, system.contacts, contacts),
        )
        return report, adrift or crossed


def _close(system: ContactSystem, *, again: bool) -> None:
    """Close what touches, before conditions move anything; ``again`` after another attempt."""
    for k in system.contacts:
        if again:  # an attempt before has changed the pairs
            k.anchor()
        k.close_touching()


def _meets_others(system: ContactSystem) -> bool:
    """Tell whether nodes meet other faces by now, as those of a tool that has moved; collective."""
    if not search(system.contacts):
        return False
    for k in system.contacts:
        k.anchor()
    return True


def _solve(system: ContactSystem, attempt: Attempt, way: Way) -> list[SubstepReport]:
    """Solve in one way and follow what the nodes meet.

    Where an iteration costs a factor of the bulk, the first solve need not be exact: most often
    some node meets another face after it.
    """
    roughly = not way.condensed and any(k.pairing.deformable for k in system.contacts)
    with _scaled(system, attempt.r_factor):
        substeps = correct(system, attempt, way.forces, roughly=roughly)
        if substeps[-1].converged:
            substeps += rebalance(system, attempt)
        if substeps[-1].converged:
            substeps += _settle(system, attempt, roughly=roughly)
    return substeps


def _settle(system: ContactSystem, attempt: Attempt, *, roughly: bool) -> list[SubstepReport]:
    """Search again for what the nodes meet, and solve again, until nothing changes.

    The certificate is for the result of the last search. After a rough solve comes another one
    even if nothing has changed.
    """
    reports: list[SubstepReport] = []
    for k in system.contacts:
        k.pairing.begin_search()
    for searched in range(MAX_SEARCHES):
        again = roughly
        changed = search(system.contacts)
        if not (changed or again) or searched == MAX_SEARCHES - 1:
            break
        if changed:
            tell(system.comm, logging.DEBUG, "search %d: nodes meet other faces", searched + 1)
        roughly = again and changed and searched == 0
        reports.append(polish(system, attempt, roughly=roughly))
        if reports[-1].converged:
            reports += rebalance(system, attempt)
        if not reports[-1].converged or (reports[-1].iterations == 0 and not again):
            break  # what has changed makes no difference
    return reports


@contextmanager
def _scaled(system: ContactSystem, factor: float) -> Iterator[None]:
    """Solve with ``r_p`` multiplied by ``factor``."""
    kept = [k.r.x.array.copy() for k in system.contacts]
    for k in system.contacts:
        k.scale_r(factor)
    try:
        yield
    finally:
        for k, values in zip(system.contacts, kept, strict=True):
            k.r.x.array[:] = values
