# SPDX-License-Identifier: MIT
"""What the Raous rectangle writes: contact line, points, zones, ``summary.json``."""

import csv
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.la import InsertMode

from fenicsx_friction import OPEN, SLIP, STICK, Contact, FrictionalContactProblem, StepReport
from fenicsx_friction.certificate.nodal_state import NodalState
from fenicsx_friction.verification.exact import ExactIncrement
from raous_options import Options

Array = npt.NDArray[np.float64]
STATE_NAMES = {OPEN: "open", STICK: "stick", SLIP: "slip"}
MM, MPA = 1e-3, 1e6
#: Slip and pressure below this fraction of the largest displacement and pressure are none.
ROUNDING = 1e-10

#: The points of the benchmark on the base (mm).
POINTS = {"A": 0.0, "B": 1.25, "C": 5.0, "D": 7.5, "E": 11.25, "R": 38.75}


@dataclass(frozen=True)
class ContactLine:
    """Nodal values on the base, ordered by ``x`` (SI units)."""

    x: Array
    gap: Array
    c_n: Array
    c_t: Array
    u_x: Array
    state: npt.NDArray[np.int8]

    def at(self, x: float) -> float:
        """Return ``u_x`` at ``x``, linear between the nodes."""
        return float(np.interp(x, self.x, self.u_x))

    def zones(self) -> dict[str, list[list[float]]]:
        """Return the intervals (mm) of each state, which meet halfway between nodes."""
        zones: dict[str, list[list[float]]] = {"open": [], "slip": [], "stick": []}
        limits = np.concatenate([self.x[:1], 0.5 * (self.x[1:] + self.x[:-1]), self.x[-1:]]) / MM
        first = 0
        for state, nodes in groupby(self.state.tolist()):
            last = first + len(list(nodes))
            zones[STATE_NAMES[state]].append([round(float(limits[k]), 9) for k in (first, last)])
            first = last
        return zones


@dataclass(frozen=True)
class Increment:
    """One accepted increment; ``line`` and ``exact`` are on rank 0 only.

    Attributes:
        factors: Lateral and top factor.
        report: The package's report of the step.
        line: The contact line.
        reaction: Force of the symmetry plane on the body (N per metre of depth).
        exact: The exact contact line, or ``None`` where none was found.
        scales: Largest exact traction (Pa) and displacement (m) of the history so far.
    """

    factors: tuple[float, float]
    report: StepReport
    line: ContactLine
    reaction: float
    exact: ContactLine | None
    scales: tuple[float, float]

    def deviation(self) -> dict[str, float | int] | None:
        """Return the largest differences from the exact solution."""
        if self.exact is None:
            return None
        ours = np.column_stack([self.line.c_n, self.line.c_t])
        exact = np.column_stack([self.exact.c_n, self.exact.c_t])
        traction = float(np.max(abs(ours - exact)))
        displacement = float(np.max(abs(self.line.u_x - self.exact.u_x)))
        return {
            "max_traction_deviation_Pa": traction,
            "max_traction_deviation_relative": _ratio(traction, self.scales[0]),
            "max_u_x_deviation_m": displacement,
            "max_u_x_deviation_relative": _ratio(displacement, self.scales[1]),
            "nodes_in_another_state": int(np.sum(self.line.state != self.exact.state)),
        }

    def summary(self) -> dict[str, object]:
        """Return the entries of ``summary.json`` for this increment."""
        (contact,) = self.report.contacts
        lateral, top = self.factors
        return {
            "step": self.report.step,
            "lateral_factor": lateral,
            "top_factor": top,
            "points": {
                name: {"x_mm": x, "u_x_m": self.line.at(x * MM)} for name, x in POINTS.items()
            },
            "zones_mm": self.line.zones(),
            "counts": {"open": contact.open, "stick": contact.stick, "slip": contact.slip},
            "certificate": {
                name: value if isinstance(value, bool) else plain(value)
                for name, value in self.report.certificate.as_dict().items()
            },
            "iterations": self.report.iterations,
            "substeps": [
                {
                    "name": s.name,
                    "xi": float(s.xi),
                    "eps_Pa": float(s.eps),
                    "iterations": int(s.iterations),
                    "reason": s.reason,
                    "accepted": bool(s.accepted),
                }
                for s in self.report.substeps
            ],
            "forces_N_per_m": {
                "contact_x": plain(contact.force[0]),
                "contact_y": plain(contact.force[1]),
                "symmetry_plane_x": plain(self.reaction),
            },
            "dissipation_J_per_m": contact.dissipation,
            "exact": self.deviation(),
        }


def gather_line(problem: FrictionalContactProblem, state: NodalState) -> ContactLine | None:
    """Collect the contact line on rank 0, given this rank's nodal values; collective."""
    (contact,) = problem.contacts
    u = problem.u.x.array.reshape(-1, 2)[contact.surface.parent_dofs(problem.u.function_space)]
    n = contact.surface.num_owned
    local = (contact.surface.x[:, 0], state.gap, state.c, u[:n], state.states())
    parts = problem.comm.gather(local, root=0)
    if parts is None:
        return None
    return _ordered(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def exact_line(contact: Contact, exact: ExactIncrement) -> ContactLine:
    """Return the exact increment in the form of a contact line; serial."""
    slips = abs(exact.slip[:, 0]) > ROUNDING * np.max(abs(exact.u))
    closed = exact.c[:, 0] > ROUNDING * np.max(exact.c[:, 0])
    state = np.where(closed, np.where(slips, SLIP, STICK), OPEN).astype(np.int8)
    return _ordered(contact.surface.x[:, 0], exact.gap, exact.c, exact.u, state)


def _ordered(x: Array, gap: Array, c: Array, u: Array, state: npt.NDArray[np.int8]) -> ContactLine:
    """Sort the nodes by ``x``."""
    o = np.argsort(x)
    return ContactLine(x[o], gap[o], c[o, 0], c[o, 1], u[o, 0], state[o])


def symmetry_reaction(problem: FrictionalContactProblem) -> float:
    """Return the force of the symmetry plane on the body (N per metre of depth)."""
    residual = fem.assemble_vector(fem.form(problem.bulk))
    residual.scatter_reverse(InsertMode.add)
    (bc,) = problem.bcs
    dofs, owned = bc.dof_indices()
    return float(problem.comm.allreduce(residual.array[dofs[:owned]].sum(), MPI.SUM))


def prepare(folder: Path) -> None:
    """Make the folder, without tables and pictures of an earlier run."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("summary.json", "contact_line.csv", "figure_*.png"):
        for path in folder.glob(name):
            path.unlink()


def write_summary(path: Path, options: Options, increments: Sequence[Increment]) -> None:
    """Write the last increment at the top level, all of them under ``steps``."""
    steps = [increment.summary() for increment in increments]
    text = json.dumps(
        {"settings": options.settings(), **steps[-1], "steps": steps}, indent=2, allow_nan=False
    )
    path.write_text(text + "\n")


def write_contact_lines(path: Path, increments: Iterable[Increment]) -> None:
    """Write the contact line of every increment."""
    with path.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["step", "x_mm", "gap_mm", "c_n_MPa", "c_t_MPa", "u_x_mm", "state"])
        for increment in increments:
            line = increment.line
            columns = (line.x / MM, line.gap / MM, line.c_n / MPA, line.c_t / MPA, line.u_x / MM)
            for *numbers, state in zip(*columns, line.state, strict=True):
                row = [f"{plain(number):.12g}" for number in numbers]
                table.writerow([increment.report.step, *row, STATE_NAMES[int(state)]])


def gather_cells(u: fem.Function) -> tuple[Array, Array] | None:
    """Collect corners and corner displacements of all cells on rank 0; collective."""
    V = u.function_space
    msh = V.mesh
    around = [0, 1, 3, 2]  # from tensor-product to cyclic order
    dofs = V.dofmap.list[: msh.topology.index_map(msh.topology.dim).size_local][:, around]
    local = (V.tabulate_dof_coordinates()[dofs][..., :2], u.x.array.reshape(-1, 2)[dofs])
    parts = msh.comm.gather(local, root=0)
    if parts is None:
        return None
    corners, displacements = (np.concatenate(column) for column in zip(*parts, strict=True))
    return corners, displacements


def _ratio(value: float, scale: float) -> float:
    """Return ``value / scale``, or ``value`` where the scale is zero."""
    return value / scale if scale > 0.0 else value


def plain(value: float) -> float:
    """Return a Python number, and zero for the underflow of a solver."""
    return 0.0 if abs(value) < 1e-40 else float(value)
