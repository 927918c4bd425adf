# SPDX-License-Identifier: MIT
"""Explain a failed step: where, in which state, which residual, what to try."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .problem import FrictionalContactProblem
    from .report import StepReport

STATE_NAMES = ("open", "stick", "slip")
NODES_NAMED = 5


def explain(problem: FrictionalContactProblem, report: StepReport) -> str:
    """Return a message on the uncertified state that the unknowns hold; collective."""
    certificate = report.certificate
    lines = [
        f"Step {report.step} has no certified solution: relative residual "
        f"{certificate.relative:.2e} (tolerance {certificate.tolerance:.0e}); normal map "
        f"{certificate.normal_map:.3e} Pa, tangential map {certificate.tangential_map:.3e} Pa, "
        f"equilibrium {certificate.equilibrium:.3e} N. The last accepted state was restored.",
        "Substeps: "
        + ", ".join(f"{s.name} {s.iterations} it. {s.reason}" for s in report.substeps),
        *_worst_nodes(problem),
        *_advice(report),
    ]
    return "\n".join(lines)


def _worst_nodes(problem: FrictionalContactProblem) -> list[str]:
    """Name the contact nodes with the largest natural-map residuals."""
    rows = []
    for k, s in zip(problem.contacts, problem.nodal_states(), strict=True):
        normal, tangential = s.natural_map()
        worst = np.fmax(normal, tangential)
        states = s.states()
        for i in np.argsort(-worst)[:NODES_NAMED]:
            x = ", ".join(f"{value:.6g}" for value in k.surface.x[i][: len(k.c)])
            rows.append(
                (
                    float(worst[i]),
                    f"  node {k.surface.nodes[i]} of '{k.surface.name}' at ({x}): "
                    f"{STATE_NAMES[states[i]]}, normal map {normal[i]:.3e} Pa, "
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
    loose = certificate.rounding > certificate.tolerance * certificate.force_scale
    if loose or any("LINEAR" in reason for reason in reasons):
        advice.append(
            "A linear solve failed or displacements went out of bounds: is the body held, by bcs "
            "or by contact that touches?"
        )
    if any("NAN" in reason for reason in reasons):
        advice.append("The residual is not finite: look for NaN in loads, bcs, and inverted cells.")
    advice.append(
        "Try a smaller load step; for mu above about 3 the discrete problem may have several "
        "solutions or none."
    )
    return advice
