# SPDX-License-Identifier: MIT
"""Load stepping: adaptive, transactional, with error control, audit and event log."""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NoReturn

from dolfinx import fem

from ..base.callbacks import check_callable
from ..base.collective import on_all_ranks
from ..base.errors import StepFailed
from ..base.validators import flag, instance, instances
from ..increment.snapshot import ProblemSnapshot
from ..problem import FrictionalContactProblem
from .energy import EnergyAudit
from .events import EventLog, find_events
from .failures import Inaccurate, StepperFailed, explain
from .progress import find_terminal, step_progress
from .record import FailedAttempt, StepRecord
from .relaxation import ViscousRelaxation
from .results import Results
from .resumption import PathCheckpoint
from .step_size import StepSize
from .step_solver import SolvedStep, StepSolver


class LoadStepper:
    """Takes a problem along a path of loads, step by step.

    Iteration makes the steps; a loop may stop, and another one continue::

        for record in LoadStepper(problem, loads, end=1.0, step=0.1):
            print(record.time, record.report.iterations)

    A step is cut when it fails or is not certified, and grows after easy ones. Nothing of a
    rejected step remains: loads are set back by ``loads(time)``, all else bit for bit. A path that
    is at its end has no steps. With a checkpoint, one script serves to begin and to go on after an
    interrupt, as if there had been none::

        stepper = LoadStepper(problem, loads, end=1.0, step=0.1, checkpoint="run.h5")

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
        stops: Times that steps must end at exactly, beside ``end``; those that are past do nothing.
        error: Control by step doubling: each step is made once whole and once in two halves, whose
            tractions may differ by this much, relative to the largest of the step. The halves are
            accepted.
        easy: Newton iterations of an easy step.
        history: Functions of the user that steps change, to be put back with a rejected step.
        update: Called after each solved step, rejected ones included, to change ``history``.
        audit: Audits each accepted step.
        events: File for the events, see :class:`~fenicsx_friction.loading.events.EventLog`.
        results: Writes each step, see :class:`~fenicsx_friction.loading.results.Results`.
        relaxation: Used where the smallest step fails. The problem's residual must contain its
            residual, see :class:`~fenicsx_friction.loading.relaxation.ViscousRelaxation`.
        checkpoint: File that holds the state after each step, with ``error`` after each two halves.
            If it exists, problem, ``history`` and ``audit`` are filled from it, and the path goes
            on there with the size of step that was next. Beyond ``end`` it has no steps: paths may
            follow each other with one file.
        progress: Show the progress on a terminal, if rich is installed.

    Attributes:
        time: Where the last accepted step ended.

    Raises:
        ContactInputError: On all ranks, for an argument that is not possible.
        CheckpointError: On all ranks, if the checkpoint cannot be used, or at a step, written.
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
        results: Results | None = None,
        relaxation: ViscousRelaxation | None = None,
        checkpoint: str | os.PathLike[str] | None = None,
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
            instance(audit, EnergyAudit, "audit", "an EnergyAudit of the problem").check(problem)
        functions = instances(history, fem.Function, "history", "fem.Functions")
        if relaxation is not None:
            instance(relaxation, ViscousRelaxation, "relaxation", "a ViscousRelaxation(u)")
            relaxation.check(problem)
        if results is not None:
            instance(results, Results, "results", "Results(problem, folder)").check(problem)
        flag(progress, "progress")
        self.problem, self.time, self.end = problem, float(start), float(end)
        self._solver = StepSolver(problem, loads, update, functions, audit, relaxation)
        self._checkpoint = None
        if checkpoint is not None:
            self._checkpoint = PathCheckpoint(checkpoint, problem, functions, audit)
            self._resume(self._checkpoint)
        self._start = self.time
        self._log = None if events is None else EventLog(events, problem)
        self._results, self._solved = results, list[SolvedStep]()
        self._terminal = find_terminal() if progress and problem.comm.rank == 0 else None

    def __iter__(self) -> Iterator[StepRecord]:
        """Make steps up to the end and yield their records."""
        with step_progress(self._terminal, self._start, self.end) as show:
            while self._solved or not self._size.is_over(self.time):
                if not self._solved:
                    self._last = self._solver.snapshot()
                    self._solved = self._solve(self._last)
                record = self._accept(self._solved.pop(0))
                show(record)
                yield record

    @property
    def loads(self) -> Callable[[float], None]:
        """What sets the loads of a time."""
        return self._solver.loads

    @loads.setter
    def loads(self, loads: Callable[[float], None]) -> None:
        self._solver.loads = loads

    @property
    def next_step(self) -> float:
        """Size of the next step, stops aside."""
        return self._size.next

    def run(self) -> list[StepRecord]:
        """Make all steps and return their records."""
        return list(self)

    def _resume(self, checkpoint: PathCheckpoint) -> None:
        """Go on where the checkpoint was written, if there is one."""
        if (found := checkpoint.read(self._solver.apply, self.end)) is not None:
            self.time, size = found
            self._size.resume(self.time, size)

    def _solve(self, last: ProblemSnapshot) -> list[SolvedStep]:
        """Try ever smaller steps; return the solved one, or its halves."""
        self._before = self.problem.accepted
        failed: tuple[FailedAttempt, ...] = ()
        while True:
            goal = self._size.goal(self.time)
            step = goal - self.time
            try:
                solved = self._solver.attempt(self.time, goal, last, self._size.tolerance)
            except StepFailed as failure:
                failed += (FailedAttempt(goal, step, failure.message.split(";")[0]),)
                self._solver.go_back(self.time, last, together=True)
                if self._size.is_smallest(step):
                    # Relaxation finds a solution where none is near; an inaccurate step has one.
                    if self._solver.relaxation is None or isinstance(failure, Inaccurate):
                        self._give_up(failure, failed)
                    return [replace(self._relax(goal, last, failed), failed=failed)]
                self._size.cut(step, failure.error if isinstance(failure, Inaccurate) else None)
            except BaseException:
                self._solver.go_back(self.time, last)
                raise
            else:
                iterations = [s.report.iterations for s in solved]
                self._size.adapt(step, iterations, solved[0].error, was_cut=bool(failed))
                return [replace(solved[0], failed=failed), *solved[1:]]

    def _relax(
        self, goal: float, last: ProblemSnapshot, failed: tuple[FailedAttempt, ...]
    ) -> SolvedStep:
        """Make the step by relaxation; where that fails too, the path has."""
        try:
            solved = self._solver.relax(self.time, goal)
        except StepFailed as error:
            self._solver.go_back(self.time, last, together=True)
            self._give_up(error, failed)
        except BaseException:
            self._solver.go_back(self.time, last)
            raise
        self._size.cut(failed[0].step)
        return solved

    def _accept(self, solved: SolvedStep) -> StepRecord:
        """Put the problem at the end of a solved step, audit it and log its events."""
        try:
            energy = self._solver.audited(solved)
        except BaseException:
            self._solved = []
            self._solver.go_back(self.time, self._last)
            raise
        if solved.states:
            self._last = solved.states[-1]
        self.time = solved.time
        events = find_events(self.problem, self._before)
        self._before = self.problem.accepted
        if self._log is not None:
            self._log.write(events)
        if self._results is not None:
            self._results.write(self.time, solved.report, energy)
        if self._checkpoint is not None and not self._solved:
            self._checkpoint.write(self.time, self._size.next)
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

    def _give_up(self, failure: StepFailed, failed: tuple[FailedAttempt, ...]) -> NoReturn:
        """Raise the failure of the path; collective."""
        last = (
            f"No step from time {self.time:.10g} was accepted, down to {failed[-1].step:.3g} "
            f"(smallest = {self._size.smallest:.3g}). The problem is at its last accepted step, "
            f"{self.problem.num_steps}; loads were set back."
        )
        # The nodes of a step that was solved, but not closely enough, do not cycle.
        cycling = [] if isinstance(failure, Inaccurate) else self._solver.watch.lines()
        message = explain(failure, failed, last, cycling)
        raise StepperFailed(
            message, failure.report, self.time, failed, failure.background
        ) from failure
