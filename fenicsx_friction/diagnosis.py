# SPDX-License-Identifier: MIT
"""Explain a failed step: where, in which state, which residual, what to try."""

from __future__ import annotations

import weakref
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import chain, groupby
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from .certificate import Certificate
    from .contact import Contact
    from .problem import FrictionalContactProblem
    from .report import StepReport
    from .substep import SubstepReport

STATE_NAMES = ("open", "stick", "slip")
NODES_NAMED = 5
#: Substeps of a failed step that are listed one by one.
SUBSTEPS_NAMED = 8
#: Newton iterations that are looked at for nodes that change state again and again.
WATCHED_ITERATIONS = 12
#: The advice that a load stepper follows by itself.
SMALLER_STEP = (
    "Try a smaller load step; for mu above about 3 the discrete problem may have several "
    "solutions or none."
)


def explain(problem: FrictionalContactProblem, report: StepReport) -> str:
    """Return a message on the uncertified state that the unknowns hold; collective."""
    certificate = report.certificate
    lines = [
        f"Step {report.step} has no certified solution: relative residual "
        f"{certificate.relative:.2e} (tolerance {certificate.tolerance:.0e}); normal map "
        f"{certificate.normal_map:.3e} Pa, tangential map {certificate.tangential_map:.3e} Pa, "
        f"equilibrium {certificate.equilibrium:.3e} N. The last accepted state was restored.",
        f"Dominant residual: {_dominant(certificate)}.",
        _substeps(report.substeps),
        *_worst_nodes(problem),
        *_advice(report),
    ]
    return "\n".join(lines)


def _substeps(substeps: Sequence[SubstepReport]) -> str:
    """List the first substeps and total the others, by kind and end."""
    first, others = substeps[:SUBSTEPS_NAMED], substeps[SUBSTEPS_NAMED:]
    text = ", ".join(f"{s.name} {s.iterations} it. {s.reason}" for s in first)
    counts = Counter(f"{s.name} {s.reason}" for s in others)
    more = ", ".join(f"{number} x {kind}" for kind, number in counts.most_common())
    return f"Substeps: {text}" + (f"; then {more}" if more else "")


def _worst_nodes(problem: FrictionalContactProblem) -> list[str]:
    """Name the contact nodes with the largest natural-map residuals."""
    rows = []
    for k, s in zip(problem.contacts, problem.nodal_states(), strict=True):
        normal, tangential = s.natural_map()
        worst = np.fmax(normal, tangential)
        states = s.states()
        for i in np.argsort(-worst)[:NODES_NAMED]:
            rows.append(
                (
                    float(worst[i]),
                    f"  {_node(k, i)}: {STATE_NAMES[states[i]]}, normal map {normal[i]:.3e} Pa, "
                    f"tangential map {tangential[i]:.3e} Pa, gap {s.gap[i]:.3e} m",
                )
            )
    gathered = sorted(chain.from_iterable(problem.comm.allgather(rows)), reverse=True)
    return ["Worst contact nodes:", *(text for _, text in gathered[:NODES_NAMED])]


def _advice(report: StepReport) -> list[str]:
    """Say what usually helps, from the reasons of the substeps."""
    reasons = {s.reason for s in report.substeps}
    advice = []
    certificate = report.certificate
    if certificate.pushed > 0.0:
        advice.append(
            f"Boundary conditions push held nodes {certificate.pushed:.3g} m into an obstacle."
        )
    if certificate.unphysical > certificate.tolerance:
        advice.append(
            "The friction limit or the dissipation is negative: a law must return a limit >= 0."
        )
    if not certificate.resolved:
        advice.append(
            "A body or contact carries forces too faint to be resolved: the rounding of its "
            f"displacements, coordinates and stresses leaves {certificate.resolution:.0e} of them. "
            "Begin nearer to the end of large motions, put the model near the origin, write small "
            "strains by grad(u) and not by I + grad(u)."
        )
    adrift = not certificate.resolved and not certificate.drowned
    if adrift or any("LINEAR" in reason for reason in reasons):
        advice.append(
            "A linear solve failed or displacements went out of bounds: is the body held, by bcs "
            "or by contact that touches?"
        )
    failures = Counter(s.failure for s in report.substeps if s.failure)
    advice += [f"The factorisation failed {n} times: {text}." for text, n in failures.items()]
    if any("NAN" in reason for reason in reasons):
        advice.append("The residual is not finite: look for NaN in loads, bcs, and inverted cells.")
    return [*advice, SMALLER_STEP]


def _node(contact: Contact, i: int) -> str:
    """Name the owned node ``i`` of a contact and where it is."""
    x = ", ".join(f"{value:.6g}" for value in contact.surface.x[i][: len(contact.c)])
    return f"node {contact.surface.nodes[i]} of '{contact.surface.name}' at ({x})"


def _dominant(certificate: Certificate) -> str:
    """Name the largest relative residual."""
    names = ("natural map", "unbalanced", "unphysical", "boundary")
    relative = {name: getattr(certificate, name.replace(" ", "_")) for name in names}
    name = max(relative, key=lambda n: np.nan_to_num(relative[n], nan=np.inf, posinf=np.inf))
    return f"{name}, {relative[name]:.2e} relative"


class NodeWatch:
    """Records the states of the nodes in each Newton iteration, to name those that cycle.

    Only the projection rows at ``eps = 0`` are looked at: their iterates have states.

    Args:
        problem: The problem to watch.
    """

    def __init__(self, problem: FrictionalContactProblem) -> None:
        # PETSc keeps what it calls: a strong reference would never be collected.
        self._problem = weakref.ref(problem)
        self._solver: PETSc.SNES | None = None
        self._watching = False
        self._states: deque[npt.NDArray[np.int8]] = deque(maxlen=WATCHED_ITERATIONS)
        self._failed: SubstepReport | None = None
        self._failed_states: list[npt.NDArray[np.int8]] = []

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Watch the substeps run inside the context; forget those watched before."""
        problem = self._problem()
        assert problem is not None
        if self._solver is not (solver := problem.projection.problem.solver):
            self._solver = solver
            solver.setMonitor(self._record)  # PETSc could only cancel all monitors, the user's too
        told = problem.monitor

        def tell(report: SubstepReport) -> None:
            self._finish(report)
            if told is not None:
                told(report)

        self._failed, self._failed_states, self._watching = None, [], True
        problem.monitor = tell
        try:
            yield
        finally:
            problem.monitor, self._watching = told, False

    def lines(self) -> list[str]:
        """Name the nodes that changed state again and again in the failed substep; collective."""
        problem = self._problem()
        if problem is None or self._failed is None:
            return []
        nodes = [(k, i) for k in problem.contacts for i in range(k.surface.num_owned)]
        rows = []
        for (k, i), states in zip(nodes, np.transpose(self._failed_states), strict=True):
            visited = [STATE_NAMES[state] for state, _ in groupby(states)]
            if len(visited) > 2:
                order = (-len(visited), problem.contacts.index(k), int(k.surface.nodes[i]))
                text = f"  {_node(k, i)}: {' -> '.join(visited[-5:])}"
                rows.append((order, f"{text}, {len(visited) - 1} changes"))
        gathered = sorted(chain.from_iterable(problem.comm.allgather(rows)))
        if not gathered:
            return []
        head = (
            f"Cycling nodes: {len(gathered)}, states in the last {len(self._failed_states)} Newton "
            f"iterations ({self._failed.name}, {self._failed.reason}):"
        )
        return [head, *(text for _, text in gathered[:NODES_NAMED])]

    def _record(self, snes: PETSc.SNES, it: int, norm: float) -> None:
        """Note the states of this rank's nodes: the Functions hold the iterate here; collective."""
        problem = self._problem()
        if not self._watching or problem is None:
            return
        if it == 0:
            self._states.clear()
        with np.errstate(all="ignore"):
            self._states.append(np.concatenate([s.states() for s in problem.nodal_states()]))

    def _finish(self, report: SubstepReport) -> None:
        """Keep the states of the first substep that cycled, or else of the first that failed."""
        if report.name != "projection" or report.eps > 0.0 or report.converged:
            return
        if self._failed is None or (report.reason == "CYCLE" and self._failed.reason != "CYCLE"):
            self._failed, self._failed_states = report, list(self._states)
