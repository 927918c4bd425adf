# SPDX-License-Identifier: MIT
"""Explain a failed step: where, in which state, which residual, what to try."""

from collections import Counter
from collections.abc import Sequence
from itertools import chain

import numpy as np

from ..certificate.certificate import Certificate
from ..certificate.nodal_state import STATE_NAMES
from ..obstacles.rigid_body import RigidBody
from ..solvers.report import SubstepReport
from ..surfaces.naming import NODES_NAMED, describe
from .report import StepReport
from .system import ContactSystem

#: Substeps of a failed step that are listed one by one.
SUBSTEPS_NAMED = 8
#: Advice that a load stepper follows by itself.
SMALLER_STEP = (
    "Try a smaller load step; for mu above about 3 the discrete problem may have several "
    "solutions or none."
)


def explain(system: ContactSystem, report: StepReport, wrong: Sequence[str] = ()) -> str:
    """Return a message on the uncertified state that the unknowns hold; collective.

    Args:
        system: The system.
        report: The report of the state.
        wrong: What is wrong with a state that solves the equations: then the cause.
    """
    if wrong:
        text = "\n".join(wrong)
        return (
            f"Step {report.step} has no certified solution: {text}\n"
            "This state solves all equations, but is no solution. The last accepted state was "
            f"restored.\n{_substeps(report.substeps)}"
        )
    certificate = report.certificate
    faint = certificate.excess <= 1.0 and not certificate.resolved
    lines = [
        f"Step {report.step} has no certified solution: "
        f"{'forces are too faint to be resolved; ' if faint else ''}relative residual "
        f"{certificate.relative:.2e} (tolerance {certificate.tolerance:.0e}); normal map "
        f"{certificate.normal_map:.3e} Pa, tangential map {certificate.tangential_map:.3e} Pa, "
        f"equilibrium {certificate.equilibrium:.3e} N. The last accepted state was restored.",
        f"Dominant residual: {_dominant(certificate)}.",
        _substeps(report.substeps),
        *_worst_nodes(system),
        *_advice(report, system.bodies),
    ]
    return "\n".join(lines)


def explain_not_finite(system: ContactSystem, forces: float) -> str:
    """Return a message on a residual that is not finite at the start of a step; collective."""
    found = f"The residual at the start of step {system.num_steps + 1} is {forces}: "
    laws = system.projection.law.kernels
    for k, law in zip(system.contacts, laws, strict=True):
        values = [law.values(), *law.derivatives()]
        finite = [np.isfinite(v).all(axis=tuple(range(1, v.ndim))) for v in values]
        bad = ~np.all(finite, axis=0)
        nodes = [describe(k.surface, i) for i in np.flatnonzero(bad)[:1]]
        if first := list(chain.from_iterable(system.comm.allgather(nodes))):
            return (
                f"{found}at {first[0]}, {type(k.friction).__name__} or its derivative is not "
                "finite, such as sqrt(pressure) at pressure 0; give it a finite slope."
            )
    return (
        f"{found}look for NaN in loads, boundary values and material fields, and for inverted "
        "cells."
    )


def _substeps(substeps: Sequence[SubstepReport]) -> str:
    """List the first substeps and total the others, by kind and end."""
    first, others = substeps[:SUBSTEPS_NAMED], substeps[SUBSTEPS_NAMED:]
    text = ", ".join(f"{s.name} {s.iterations} it. {s.reason}" for s in first)
    counts = Counter(f"{s.name} {s.reason}" for s in others)
    more = ", ".join(f"{number} x {kind}" for kind, number in counts.most_common())
    return f"Substeps: {text}" + (f"; then {more}" if more else "")


def _worst_nodes(system: ContactSystem) -> list[str]:
    """Name the contact nodes with the largest natural-map residuals."""
    rows = []
    for k, s in zip(system.contacts, system.nodal_states(), strict=True):
        normal, tangential = s.natural_map()
        worst = np.fmax(normal, tangential)
        states = s.states()
        for i in np.argsort(-worst)[:NODES_NAMED]:
            rows.append(
                (
                    float(worst[i]),
                    f"  {describe(k.surface, i)}: {STATE_NAMES[states[i]]}, "
                    f"normal map {normal[i]:.3e} Pa, "
                    f"tangential map {tangential[i]:.3e} Pa, gap {s.gap[i]:.3e} m",
                )
            )
    gathered = sorted(chain.from_iterable(system.comm.allgather(rows)), reverse=True)
    return ["Worst contact nodes:", *(text for _, text in gathered[:NODES_NAMED])]


def _advice(report: StepReport, bodies: Sequence[RigidBody]) -> list[str]:
    """Say what usually helps, from the reasons of the substeps."""
    reasons = {s.reason for s in report.substeps}
    advice = []
    certificate = report.certificate
    if certificate.pushed > 0.0:
        advice.append(
            f"Boundary conditions push held nodes {certificate.pushed:.3g} m into an obstacle."
        )
    solved = report.substeps and report.substeps[-1].converged  # else it says nothing of the law
    if solved and certificate.unphysical > certificate.tolerance:
        advice.append(
            "The friction limit or the dissipation is negative: a law must return a limit >= 0."
        )
    adrift = not certificate.resolved and not certificate.drowned
    if not certificate.resolved:
        lost = "Newton's method has lost a body that contact hardly holds, or a" if adrift else "A"
        advice.append(
            f"{lost} body or contact carries forces too faint to be resolved: the rounding of its "
            f"displacements, coordinates and stresses leaves {certificate.resolution:.0e} of them. "
            "Begin nearer to the end of large motions, put the model near the origin, write small "
            "strains by grad(u) and not by I + grad(u)."
        )
    if adrift or any("LINEAR" in reason for reason in reasons):
        advice.append(
            "A linear solve failed or displacements went out of bounds: is the body held, by bcs "
            "or by contact that touches?"
        )
    advice += [
        f"Rigid body '{body.name}' is free in {', '.join(body.free)}: does contact, friction "
        "or a spring hold these?"
        for body in bodies
        if body.free
    ]
    failures = Counter(s.failure for s in report.substeps if s.failure)
    advice += [f"The linear solver failed {n} times: {text}." for text, n in failures.items()]
    if any("NAN" in reason for reason in reasons):
        advice.append("The residual is not finite: look for NaN in loads, bcs, and inverted cells.")
    return [*advice, SMALLER_STEP]


def _dominant(certificate: Certificate) -> str:
    """Name the largest relative residual."""
    names = ("natural map", "unbalanced", "unphysical", "boundary")
    relative = {name: getattr(certificate, name.replace(" ", "_")) for name in names}
    name = max(relative, key=lambda n: np.nan_to_num(relative[n], nan=np.inf, posinf=np.inf))
    return f"{name}, {relative[name]:.2e} relative"
