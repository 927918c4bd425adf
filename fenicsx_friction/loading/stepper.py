# SPDX-License-Identifier: MIT
"""Load stepping: adaptive, transactional, with error control, audit and event log."""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NoReturn

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from rich.console import Console

from ..base.callbacks import check_callable
from ..base.collective import on_all_ranks
from ..base.errors import ContactInputError, StepFailed
from ..base.validators import flag, instance, instances
from ..increment.diagnosis import SMALLER_STEP
from ..increment.snapshot import ProblemSnapshot
from ..problem import FrictionalContactProblem
from ..system.report import StepReport
from .energy import EnergyAudit, EnergyBalance
from .events import EventLog, find_events
from .progress import step_progress
from .record import FailedAttempt, StepRecord
from .relaxation import ViscousRelaxation
from .step_size import StepSize, doubling_error
from .watch import NodeWatch

FAILURE_ADVICE = (
    "Smaller steps did not help. Where a body snaps or loses its hold there is no solution nearby: "
    "prescribe displacements there instead of forces, hold the body, or let it creep to its next "
    "equilibrium by LoadStepper(relaxation=ViscousRelaxation(u)). Where nodes cycle, refine "
    "the surface, lower mu (above about 3 there may be several solutions or none) or try "
    'StepSettings(corrector="ramp").'
)
INACCURATE_ADVICE = (
    "Tractions that jump do so in any step: allow a larger error, or a smaller smallest step."
)


class StepperFailed(StepFailed):
    """No step down to the smallest was accepted; the problem is at the last accepted one.

    Attributes:
        time: Where the last accepted step ended.
        failed: All attempts at the next one.
    """

    def __init__(
        self, message: str, report: object, time: float, failed: tuple[FailedAttempt, ...]
    ) -> None:
        super().__init__(message, report)
        self.time, self.failed = time, failed


class _Inaccurate(StepFailed):
    """The step-doubling error is beyond the tolerance."""

    def __init__(self, error: float, tolerance: float, report: object) -> None:
        super().__init__(
            f"The tractions of one step and of two half steps differ by {error:.2e}, relative "
            f"(tolerance {tolerance:.0e}).",
            report,
        )
        self.error = error


@dataclass(frozen=True)
class _Solved:
    """A solved step that has not been yielded yet."""

    time: float
    step: float
    report: StepReport
    states: tuple[ProblemSnapshot, ...] = ()
    error: float | None = None
    failed: tuple[FailedAttempt, ...] = ()
    relaxed: int = 0


class LoadStepper:
    """Takes a problem along a path of loads, step by step.

    Iteration makes the steps; a loop may stop, and another one continue::

        for record in LoadStepper(problem, loads, end=1.0, step=0.1):
            print(record.time, record.report.iterations)

    A step is cut when it fails or is not certified, and grows after easy ones. Nothing of a
    rejected step remains: loads are set back by ``loads(time)``, all else bit for bit. A path that
    starts at its end has no steps, so that one script serves to begin and to resume::

        file = Path("run.h5")
        start = ff.read_checkpoint(file, problem)["time"] if file.exists() else 0.0
        for record in LoadStepper(problem, loads, start=start, end=1.0, step=0.1, stops=[0.5]):
            ff.write_checkpoint(file, problem, {"time": record.time})

    An exception of ``loads`` or ``update`` on one rank is raised on all.

    Args:
        problem: The problem, in its state at ``start``.
        loads: Sets loads, boundary values and motions to those of a time. It must depend on nothing
            else. Time is pseudo-time unless a law depends on rates (``problem.dt``, s).
        end: Where the path ends.
        start: Where it starts.
        step: Size of the first step.
        smallest: Smallest step to be tried after a cut; a thousandth of ``step`` by default.
        largest: Largest step; by default ``step``, and with ``error`` the whole path if longer.
        stops: Times that steps must end at exactly, beside ``end``; those up to ``start`` are past.
        error: Control by step doubling: each step is made once whole and once in two halves, whose
            tractions may differ by this much, relative to the largest of the step. The halves are
            accepted.
        easy: Newton iterations of an easy step.
        history: Functions of the user that steps change, to be put back with a rejected step.
        update: Called after each solved step, rejected ones included, to change ``history``.
        audit: Audits each accepted step.
        events: File for the events, see :class:`~fenicsx_friction.loading.events.EventLog`.
        relaxation: Used where the smallest step fails. The problem's residual must contain its
            residual, see :class:`~fenicsx_friction.loading.relaxation.ViscousRelaxation`.
        progress: Show the progress on a terminal.

    Attributes:
        time: Where the last accepted step ended.

    Raises:
        ContactInputError: On all ranks, for an argument that is not possible.
    """

    def __init__(
        self,
        problem: FrictionalContactProblem,
        loads: Callable[[float], None],
        *,
        end: float,
        start: float = 0.0,
        step: float,
        smallest: float | None = None,
        largest: float | None = None,
        stops: Sequence[float] = (),
        error: float | None = None,
        easy: int = 12,
        history: Sequence[fem.Function] = (),
        update: Callable[[], None] | None = None,
        audit: EnergyAudit | None = None,
        events: str | os.PathLike[str] | None = None,
        relaxation: ViscousRelaxation | None = None,
        progress: bool = True,
    ) -> None:
        instance(problem, FrictionalContactProblem, "problem", "a FrictionalContactProblem")
        self._size = on_all_ranks(
            problem.comm,
            lambda: StepSize(start, end, step, smallest, largest, stops, error, easy),
        )
        check_callable(loads, "loads", "time")
        if update is not None:
            check_callable(update, "update")
        if audit is not None:
            instance(audit, EnergyAudit, "audit", "an EnergyAudit of the problem")
            if audit._problem is not problem:
                raise ContactInputError(
                    f"audit = {audit!r} is one of another problem; give EnergyAudit(problem, ...)."
                )
        self.problem, self.loads, self.time, self.end = problem, loads, float(start), float(end)
        self._start, self._update, self._audit = self.time, update, audit
        self._history = instances(history, fem.Function, "history", "fem.Functions")
        self._relaxation = relaxation
        if relaxation is not None:
            instance(relaxation, ViscousRelaxation, "relaxation", "a ViscousRelaxation(u)")
            relaxation.check(problem)
        flag(progress, "progress")
        self._log = None if events is None else EventLog(events, problem)
        self._watch = NodeWatch(problem)
        self._solved: list[_Solved] = []
        self._console = Console()
        self._shown = progress and problem.comm.rank == 0 and self._console.is_terminal

    def __iter__(self) -> Iterator[StepRecord]:
        """Make steps up to the end and yield their records."""
        bar = step_progress(self._console, self._start, self.end, shown=self._shown)
        with bar as show:
            while self._solved or not self._size.is_over(self.time):
                if not self._solved:
                    self._last = ProblemSnapshot(self.problem, self._history)
                    self._solved = self._solve(self._last)
                record = self._accept(self._solved.pop(0))
                show(record)
                yield record

    @property
    def next_step(self) -> float:
        """Size of the next step, stops aside."""
        return self._size.next

    def run(self) -> list[StepRecord]:
        """Make all steps and return their records."""
        return list(self)

    # -- one step of the path ----------------------------------------------------------------

    def _solve(self, last: ProblemSnapshot) -> list[_Solved]:
        """Try smaller and smaller steps; return the solved one, or its halves."""
        self._before = self.problem.accepted
        failed: tuple[FailedAttempt, ...] = ()
        while True:
            goal = self._size.goal(self.time)
            step = goal - self.time
            try:
                solved = self._attempt(goal, last)
            except StepFailed as failure:
                failed += (FailedAttempt(goal, step, str(failure).split(";")[0]),)
                self._go_back(last, together=True)
                if self._size.is_smallest(step):
                    if self._relaxation is None or isinstance(failure, _Inaccurate):
                        self._give_up(failure, failed)
                    return [replace(self._relax(goal, last, failed), failed=failed)]
                self._size.cut(step, failure.error if isinstance(failure, _Inaccurate) else None)
            except BaseException:
                self._go_back(last)
                raise
            else:
                iterations = [s.report.iterations for s in solved]
                self._size.adapt(step, iterations, solved[0].error, was_cut=bool(failed))
                return [replace(solved[0], failed=failed), *solved[1:]]

    def _attempt(self, goal: float, last: ProblemSnapshot) -> list[_Solved]:
        """Solve the step to ``goal``; with error control in two ways, and return its halves."""
        tolerance = self._size.tolerance
        before = self._tractions() if tolerance else []
        whole = self._advance(self.time, goal)
        if tolerance is None:
            return [whole]
        tractions = [before, self._tractions()]
        last.restore()
        halves = []
        for begin, end in pairwise((self.time, (self.time + goal) / 2.0, goal)):
            half = self._advance(begin, end)
            halves.append(replace(half, states=(ProblemSnapshot(self.problem, self._history),)))
            tractions.append(self._tractions())
        error = doubling_error(self.problem.comm, *tractions)
        if error > tolerance:
            raise _Inaccurate(error, tolerance, halves[-1].report)
        return [replace(half, error=error) for half in halves]

    def _advance(self, begin: float, end: float) -> _Solved:
        """Set the loads of ``end`` and solve."""
        problem = self.problem
        self._apply(end)
        problem.dt.value = np.asarray(end - begin)
        settings = problem.settings
        try:
            problem.settings = replace(settings, raise_on_uncertified=True)
            with self._watch.watching():
                report = problem.solve()
        finally:
            problem.settings = settings
        self._updated()
        return _Solved(end, end - begin, report)

    def _relax(
        self, goal: float, last: ProblemSnapshot, failed: tuple[FailedAttempt, ...]
    ) -> _Solved:
        """Relax the problem to its next equilibrium under the loads of the goal."""
        assert self._relaxation is not None
        states: list[ProblemSnapshot] = []

        def accepted() -> None:
            """Keep the increment, all of them for the audit."""
            self._updated()
            if self._audit is None:
                states.clear()
            states.append(ProblemSnapshot(self.problem, self._history))

        try:
            self._apply(goal)
            self.problem.dt.value = np.asarray(goal - self.time)
            with self._watch.watching():
                report, increments = self._relaxation.settle(self.problem, accepted)
        except StepFailed as error:
            self._go_back(last, together=True)
            self._give_up(error, failed)
        except BaseException:
            self._go_back(last)
            raise
        self._size.cut(failed[0].step)
        return _Solved(goal, goal - self.time, report, tuple(states), relaxed=increments)

    def _accept(self, solved: _Solved) -> StepRecord:
        """Put the problem at the end of a solved step, audit it and log its events."""
        try:
            energy = self._audited(solved)
        except BaseException:
            self._solved = []
            self._go_back(self._last)
            raise
        if solved.states:
            self._last = solved.states[-1]
        self.time = solved.time
        events = find_events(self.problem, self._before)
        self._before = self.problem.accepted
        if self._log is not None:
            self._log.write(events)
        return StepRecord(
            solved.time,
            solved.step,
            solved.report,
            energy,
            events,
            solved.error,
            solved.failed,
            solved.relaxed,
        )

    def _audited(self, solved: _Solved) -> EnergyBalance | None:
        """Restore the increments of a solved step in turn, if any; add up their energies."""
        if solved.states:
            self._apply(solved.time)
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

    def _apply(self, time: float) -> None:
        """Set the loads; an exception on one rank is one on all."""
        on_all_ranks(self.problem.comm, lambda: self.loads(time))

    def _updated(self) -> None:
        """Let the user change the history; an exception on one rank is one on all."""
        if self._update is not None:
            on_all_ranks(self.problem.comm, self._update)

    def _go_back(self, last: ProblemSnapshot, *, together: bool = False) -> None:
        """Set everything back to the last accepted step.

        Args:
            last: That step.
            together: Whether all ranks are here. Ctrl-C may have come on one rank only: then
                nothing may be collective.
        """
        try:
            if together:
                self._apply(self.time)
            else:
                self.loads(self.time)
        finally:
            last.restore()

    def _give_up(self, failure: StepFailed, failed: tuple[FailedAttempt, ...]) -> NoReturn:
        """Raise the failure of the path."""
        message = "\n".join(self._explain(failure, failed))
        raise StepperFailed(message, failure.report, self.time, failed) from failure

    def _tractions(self) -> list[npt.NDArray[np.floating]]:
        """Return the traction vectors of this rank's nodes in global axes (Pa)."""
        return [k.nodal_traction() for k in self.problem.contacts]

    def _explain(self, failure: StepFailed, failed: Sequence[FailedAttempt]) -> list[str]:
        """Say what was tried, what went wrong and what to do; collective."""
        inaccurate = isinstance(failure, _Inaccurate)
        return [
            f"No step from time {self.time:.10g} was accepted, down to {failed[-1].step:.3g} "
            f"(smallest = {self._size.smallest:.3g}). The problem is at its last accepted step, "
            f"{self.problem.num_steps}; loads were set back.",
            "Tried: " + "; ".join(f"step {f.step:.3g}: {f.reason}" for f in failed),
            *([] if inaccurate else self._watch.lines()),
            "The last attempt:",
            *(f"  {line}" for line in str(failure).splitlines() if line != SMALLER_STEP),
            INACCURATE_ADVICE if inaccurate else FAILURE_ADVICE,
        ]
