# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A brake pad gets hot
#
# SPDX-License-Identifier: MIT
#
# A pad is pressed on a disc that moves below it. The temperature $T$ of the pad is a further unknown.
# All of it is coupled: friction heats, heat expands the pad and so presses it harder, pressure lets
# heat through, and hot pads have less friction. On the contact, heat flows into the pad:
#
# $$
# k\\, \\partial_n T = \\eta\\, c_t \\cdot \\dot s - h(c_n)\\, (T - T_{disc}),
# $$
#
# $\\eta$ of the heat of friction, less what the gap conductance $h$ lets through to the disc, whose
# temperature is given. The tractions $(c_n, c_t)$ are `contact.c`, unknowns like the others, and may
# stand in any equation. The rows of heat are taken at the nodes (`surface.measure()`), as those of
# contact are: so the heat is the work of friction to the last digits.
#
# First a guided pad is pressed on a disc at rest. Its column has a closed form: resistances in
# series, of backing plate, pad and gap, whose pressure depends on the temperature. Then the pad is
# free at its sides, and brakes.
#
# ```
# ./container python3 demos/demo_thermal_brake.py
# ```

# +
import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff

WIDTH, HEIGHT, PRESS = 60e-3, 12e-3, 20e-6  # m, the last the way of the backing plate
E, NU, EXPANSION = 1e9, 0.25, 20e-6  # Pa, -, 1/K
CONDUCTIVITY, CAPACITY, PLATE = 2.0, 2.5e6, 200.0  # W/(m K), J/(m³ K), W/(m² K)
GAP, SHARE = 1e-3, 0.5  # W/(N K): conductance over pressure; of the heat of friction, to the pad
COLD, HOT, SPEED = 293.0, 400.0, 10.0  # K, K, m/s
# -

# ## The model


@dataclass
class Pad:
    """A pad in plane strain, and what moves or changes."""

    problem: ff.FrictionalContactProblem
    T: fem.Function
    disc: ff.RigidMotion
    plate: fem.Function
    last: list[fem.Function]
    dt: fem.Constant
    outside: fem.Constant
    flows: dict[str, fem.Form]

    def step(self, dt: float, speed: float) -> ff.StepReport:
        """Go on by a time (s) at a speed of the disc (m/s)."""
        self.dt.value = dt
        self.disc.translation.value[0] += dt * speed
        for old, new in zip(self.last, self.problem.unknowns, strict=True):
            old.x.array[:] = new.x.array
        return self.problem.solve()
