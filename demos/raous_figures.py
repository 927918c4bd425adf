# SPDX-License-Identifier: MIT
"""Raous' rectangle: what the paper's figures show, and where it is written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, mesh

import raous_pictures as pictures
import raous_results as results
import raous_terminal as terminal
from fenicsx_friction import laws
from fenicsx_friction.contact.slip_corrector import freeze_stick
from raous_options import LENGTH, Options

if TYPE_CHECKING:
    from demo_raous_rectangle import Block

LEVELS = (1.0, 0.9, 0.8, 0.7, 0.5, 0.3, 0.2, 0.1, 0.03, *(10.0**-k for k in range(2, 10)), 0.0)


def smoothed_ramp(y: np.ndarray, eps: float) -> np.ndarray:
    """Return ``<y>_eps`` at the points of the uniform grid ``y`` (Pa)."""
    line = mesh.create_interval(MPI.COMM_SELF, 1, (y[0], y[-1]))
    argument = ufl.SpatialCoordinate(line)[0]
    smoothing = fem.Constant(line, default_scalar_type(eps))
    points = np.linspace(0.0, 1.0, len(y))[:, None]
    expression = fem.Expression(laws.ramp(argument, smoothing), points, comm=MPI.COMM_SELF)
    return expression.eval(line, np.array([0], dtype=np.int32)).reshape(-1)


def draw_laws(options: Options, r_p: float) -> None:
    """Draw figures 2 and 3 for values of ``eps`` between 0 and half the top pressure."""
    y = np.linspace(-1.5, 1.5, 601) * options.top_pressure
    levels = [factor * options.top_pressure for factor in (0.4, 0.2, 0.1, 0.02, 0.0)]
    ramps = {eps: smoothed_ramp(y, eps) for eps in levels}
    pictures.draw_ramp(options.output / "figure_2_ramp.png", {e: (y, r) for e, r in ramps.items()})
    normal = {eps: (ramp / r_p, ramp - y) for eps, ramp in ramps.items()}
    pictures.draw_normal_law(options.output / "figure_3_normal_law.png", normal, r_p)


def ramp_levels(block: Block, options: Options) -> dict[float, results.ContactLine]:
    """Return the contact line after each value of ``xi`` that Newton's method reached."""
    problem, (contact,) = block.problem, block.problem.contacts
    block.load(options, (1.0, 1.0))
    forces = LENGTH * (abs(options.lateral_pressure) + options.top_pressure)
    problem.run(problem.stick, 1e-6 * forces, max_it=2)

    freeze_stick(contact, violated_only=False)
    lines: dict[float, results.ContactLine] = {}
    for xi in LEVELS:
        if problem.run(problem.slip, 1e-12 * forces, xi=xi).converged:
            lines[xi] = results.gather_line(problem, problem.nodal_states()[0])
    return lines


def write_results(
    options: Options,
    increments: Sequence[results.Increment],
    cells: tuple,
    r_p: float,
    ramps: Mapping[int, Block],
) -> None:
    """Write tables and pictures; rank 0 only.

    Args:
        options: Those of the command line.
        increments: The accepted increments.
        cells: Mesh and displacement of figure 5.
        r_p: Scale of figure 3 (Pa/m).
        ramps: Problems with the corrector of the paper, for each sign in eq. (12), for figure 7.
    """
    folder = options.output
    results.write_summary(folder / "summary.json", options, increments)
    results.write_contact_lines(folder / "contact_line.csv", increments)
    last = increments[-1]
    with terminal.drawing() as tell:
        tell("figures 2 and 3: smoothed ramp and normal law")
        draw_laws(options, r_p)
        tell("figure 5: deformed mesh and contact forces")
        pressures = options.pressures(last.factors)
        pictures.draw_deformed(folder / "figure_5_deformed.png", cells, last, pressures)
        tell("figure 6: contact stresses and exact solution")
        pictures.draw_stresses(folder / "figure_6_stresses.png", last, options.mu)
        tell("figure 7: convergence with ξ")
        levels = {sign: ramp_levels(block, options) for sign, block in ramps.items()}
        pictures.draw_convergence(folder / "figure_7_convergence.png", levels)
