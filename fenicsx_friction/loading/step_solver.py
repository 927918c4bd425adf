# SPDX-License-Identifier: MIT
"""How one step of a load path is solved: at once, in two halves, or by relaxation."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.collective import on_all_ranks
from ..increment.background import background
from ..increment.report import StepReport
from ..increment.snapshot import ProblemSnapshot
from ..problem import FrictionalContactProblem
from .energy import EnergyAudit, EnergyBalance
from .failures import Inaccurate
from .record import FailedAttempt
from .relaxation import ViscousRelaxation
from .step_size import doubling_error
from .watch import NodeWatch


@dataclass(frozen=True)
class SolvedStep:
    """A solved step that is not handed out yet.

    Attributes:
        time: Where it ends.
        step: Its size.
        report: The report of the problem.
        states: States at the ends of its increments, the last at its own end; none where the
            problem is still there. Without an audit the last is enough.
        error: Relative step-doubling error, with error control.
        failed: The larger steps that were tried before.
        relaxed: Increments of viscous relaxation.
    """

    time: float
    step: float
    report: StepReport
    states: tuple[ProblemSnapshot, ...] = ()
    error: float | None = None
    failed: tuple[FailedAttempt, ...] = ()
    relaxed: int = 0


class StepSolver:
    """Solves single steps under the loads of the user; arguments as those of ``LoadStepper``.

    A method that raises leaves the problem and the loads somewhere on the way; see :meth:`go_back`.

    Attributes:
        watch: Watches the nodes of the last solve.
    """

    def __init__(
        self,
        problem: FrictionalContactProblem,
        loads: Callable[[float], None],
        update: Callable[[], None] | None,
        history: Sequence[fem.Function],
        audit: EnergyAudit | None,
        relaxation: ViscousRelaxation | None,
    ) -> None:
        self.problem, self.loads, self.relaxation = problem, loads, relaxation
        self._update, self._history, self._audit = update, history, audit
        self.watch = NodeWatch(problem)

    def attempt(
        self, begin: float, goal: float, last: ProblemSnapshot, tolerance: float | None
    ) -> list[SolvedStep]:
        """Solve the step to ``goal``; with error control in two ways, and return its halves.

        Args:
            begin: Where the step begins.
            goal: Where it ends.
            last: The state at its beginning, in which the problem is.
            tolerance: Tolerance of the step-doubling error, or ``None`` without error control.

        Raises:
            StepFailed: If a solve fails or is not certified, or the error is too large.
        """
        before = self._tractions() if tolerance else []
        whole = self._advance(begin, goal)
        if tolerance is None:
            return [whole]
        tractions = [before, self._tractions()]
        last.restore()
        halves = []
        for start, end in pairwise((begin, (begin + goal) / 2.0, goal)):
            half = self._advance(start, end)
            halves.append(replace(half, states=(self.snapshot(),)))
            tractions.append(self._tractions())
        error = doubling_error(self.problem.comm, *tractions)
        if error > tolerance:
            raise Inaccurate(error, tolerance, halves[-1].report, background(self.problem))
        return [replace(half, error=error) for half in halves]

    def relax(self, begin: float, goal: float) -> SolvedStep:
        """Let the problem creep to its next equilibrium under the loads of the goal."""
        assert self.relaxation is not None
        states: list[ProblemSnapshot] = []

        def accepted() -> None:
            """Keep the increment, all of them for the audit."""
            self._updated()
            if self._audit is None:
                states.clear()
            states.append(self.snapshot())

        self.apply(goal)
        self.problem.dt.value = np.asarray(goal - begin)
        with self.watch.watching():
            report, increments = self.relaxation.settle(self.problem, accepted)
        return SolvedStep(goal, goal - begin, report, tuple(states), relaxed=increments)

    def audited(self, solved: SolvedStep) -> EnergyBalance | None:
        """Go through the increments of a solved step again, if it has several, and add them up."""
        if solved.states:
            self.apply(solved.time)
        kept = None if self._audit is None else dict(vars(self._audit))
        balances = []
        try:
            for state in solved.states or (None,):
                if state is not None:
                    state.restore()
                if self._audit is not None:
                    balances.append(self._audit.update())
        except BaseException:
            if self._audit is not None and kept is not None:
                vars(self._audit).update(kept)
            raise
        return None if self._audit is None else sum(balances[1:], balances[0])

    def snapshot(self) -> ProblemSnapshot:
        """Keep the state of the problem and of the user's history."""
        return ProblemSnapshot(self.problem, self._history)

    def go_back(self, time: float, last: ProblemSnapshot, *, together: bool = False) -> None:
        """Set everything back to the last accepted step.

        Args:
            time: Where that step ended.
            last: Its state.
            together: Whether all ranks are here. Not so after Ctrl-C, which may have come on one
                rank only: nothing is collective then.
        """
        try:
            if together:
                self.apply(time)
            else:
                self.loads(time)
        finally:
            last.restore()

    def _advance(self, begin: float, end: float) -> SolvedStep:
        """Set the loads of ``end`` and solve."""
        problem = self.problem
        self.apply(end)
        problem.dt.value = np.asarray(end - begin)
        settings = problem.settings
        try:
            problem.settings = replace(settings, raise_on_uncertified=True)
            with self.watch.watching():
                report = problem.solve()
        finally:
            problem.settings = settings
        self._updated()
        return SolvedStep(end, end - begin, report)

    def apply(self, time: float) -> None:
        """Set the loads; an exception on one rank is one on all."""
        on_all_ranks(self.problem.comm, lambda: self.loads(time))

    def _updated(self) -> None:
        """Let the user change the history; an exception on one rank is one on all."""
        if self._update is not None:
            on_all_ranks(self.problem.comm, self._update)

    def _tractions(self) -> list[npt.NDArray[np.floating]]:
        """Return the traction vectors of this rank's nodes in global axes (Pa)."""
        return [k.nodal_traction() for k in self.problem.contacts]
