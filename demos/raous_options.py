# SPDX-License-Identifier: MIT
"""The command line of the Raous rectangle: options in the units of the paper, SI inside."""

import argparse
import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mpi4py import MPI

#: Side of the half block (m).
LENGTH = 0.04
COLUMNS = ("lateral_factor", "top_factor")
QUICK_MESH = (16, 8)
FULL_MESH = (32, 16)

DESCRIPTION = """\
Frictional contact of an elastic block with a rigid base (Raous et al. 1988): half of an
80 mm x 40 mm block in plane strain, pushed sideways and pressed on the base. Solves the
quasi-static history, certifies each increment against the unsmoothed Signorini-Coulomb law,
compares it with the exact discrete solution, and writes tables, ParaView fields and pictures."""

EPILOG = """\
The defaults are the problem of section 4.1 of the paper. A history for --path is a CSV file
with the header lateral_factor,top_factor and one increment a row; the pressures of a row are the
factors times --lateral-pressure and --top-pressure. Loading, unloading and holding are allowed:

  lateral_factor,top_factor
  0.5,1.0
  1.0,1.0
  0.2,1.0

The exit status is 0 if all increments were certified, 1 if one failed, 2 for wrong options."""


@dataclass(frozen=True)
class Options:
    """The options in SI units.

    Attributes:
        nx: Number of elements along the base.
        ny: Number of elements along the height.
        mu: Friction coefficient.
        E: Young's modulus (Pa).
        nu: Poisson's ratio.
        lateral_pressure: Pressure on x = 0 at factor 1 (Pa).
        top_pressure: Pressure on y = 40 mm at factor 1 (Pa).
        element: ``bbar`` or ``q1``.
        corrector: ``projection`` or ``ramp``.
        history: ``(lateral_factor, top_factor)`` of each increment.
        output: Folder of the results.
    """

    nx: int
    ny: int
    mu: float
    E: float
    nu: float
    lateral_pressure: float
    top_pressure: float
    element: str
    corrector: str
    history: tuple[tuple[float, float], ...]
    output: Path

    def pressures(self, factors: tuple[float, float]) -> tuple[float, float]:
        """Return the lateral and the top pressure (Pa) at these factors."""
        return factors[0] * self.lateral_pressure, factors[1] * self.top_pressure

    def settings(self) -> dict[str, object]:
        """Return the options for ``summary.json``, with the unit in the key."""
        return {
            "nx": self.nx,
            "ny": self.ny,
            "mu": self.mu,
            "E_Pa": self.E,
            "nu": self.nu,
            "lateral_pressure_Pa": self.lateral_pressure,
            "top_pressure_Pa": self.top_pressure,
            "element": self.element,
            "corrector": self.corrector,
            "history": [dict(zip(COLUMNS, row, strict=True)) for row in self.history],
        }


class Parser(argparse.ArgumentParser):
    """An argument parser that speaks once, not once a rank."""

    def _print_message(self, message: str, file: IO[str] | None = None) -> None:
        if MPI.COMM_WORLD.rank == 0:
            super()._print_message(message, file)


def parse_options(arguments: Sequence[str] | None = None) -> Options:
    """Read and check the command line; a mistake ends the program with status 2."""
    parser = _parser()
    given = parser.parse_args(arguments)
    if given.output.exists() and not given.output.is_dir():
        parser.error(f"argument --output: '{given.output}' is not a folder")
    default = QUICK_MESH if given.quick else FULL_MESH
    try:
        history = read_history(given.path) if given.path else proportional(given.steps)
    except OSError as error:
        parser.error(f"argument --path: cannot read '{given.path}': {error.strerror}")
    except (ValueError, csv.Error) as error:
        parser.error(f"argument --path: {error}")
    return Options(
        nx=given.nx or default[0],
        ny=given.ny or default[1],
        mu=given.mu,
        E=given.E * 1e9,
        nu=given.nu,
        lateral_pressure=given.lateral_pressure * 1e6,
        top_pressure=given.top_pressure * 1e6,
        element=given.element,
        corrector=given.corrector,
        history=history,
        output=given.output,
    )


def proportional(steps: int) -> tuple[tuple[float, float], ...]:
    """Return a history that takes both pressures to their full value in equal increments."""
    return tuple((k / steps, k / steps) for k in range(1, steps + 1))


def read_history(path: Path) -> tuple[tuple[float, float], ...]:
    """Read a load history.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is no history; the message names file and line.
    """
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = csv.reader(file, skipinitialspace=True)
        header = tuple(name.strip() for name in next(rows, []))
        if header != COLUMNS:
            raise ValueError(
                f"'{path}' must begin with the line '{','.join(COLUMNS)}', found "
                f"'{','.join(header)}'"
            )
        history = tuple(_factors(row, f"'{path}' line {rows.line_num}") for row in rows if row)
    if not history:
        raise ValueError(f"'{path}' has no increment below its header")
    return history


def _factors(row: list[str], where: str) -> tuple[float, float]:
    """Return the two factors of a row."""
    try:
        lateral, top = (float(entry) for entry in row)
    except ValueError:
        raise ValueError(f"{where}: expected two numbers, found '{','.join(row)}'") from None
    if not (math.isfinite(lateral) and math.isfinite(top)):
        raise ValueError(f"{where}: the factors must be finite, found '{','.join(row)}'")
    if top < 0.0:
        raise ValueError(f"{where}: top_factor = {top} would lift the block off the base")
    return lateral, top


def _parser() -> Parser:
    """Describe the options."""
    parser = Parser(
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )

    def add(name: str, unit: str, text: str, **more: object) -> None:
        parser.add_argument(name, metavar=unit, help=text, **more)  # type: ignore[arg-type]

    nx, ny = FULL_MESH
    any_value, positive = _number(), _number(above=0.0)
    add("--nx", "N", f"elements along the base (default {nx})", type=_count)
    add("--ny", "N", f"elements along the height (default {ny})", type=_count)
    add("--mu", "NUMBER", "friction coefficient (default 1)", type=_number(least=0.0), default=1.0)
    add("--E", "GPa", "Young's modulus in GPa (default 130)", type=positive, default=130.0)
    nu = _number(above=-1.0, below=0.5)
    add("--nu", "NUMBER", "Poisson's ratio (default 0.2)", type=nu, default=0.2)
    add(
        "--lateral-pressure",
        "MPa",
        "pressure on x = 0 in MPa, which pushes towards +x (default 150)",
        type=any_value,
        default=150.0,
    )
    add(
        "--top-pressure",
        "MPa",
        "pressure on y = 40 mm in MPa, which presses on the base (default 50)",
        type=positive,
        default=50.0,
    )
    parser.add_argument(
        "--element",
        choices=["bbar", "q1"],
        default="bbar",
        help="bilinear element with mean dilatation, or plain (default bbar)",
    )
    parser.add_argument(
        "--corrector",
        choices=["projection", "ramp"],
        default="projection",
        help="what follows the stick predictor: the natural map, or the paper's ramp of xi and "
        "the natural map as polish (default projection)",
    )
    add(
        "--steps",
        "N",
        "equal increments of both pressures from 0 to their full value (default 1)",
        type=_count,
        default=1,
    )
    add("--path", "FILE", "CSV file with the load history, in place of --steps", type=Path)
    add(
        "--output",
        "DIR",
        "folder of the results (default results/raous_rectangle)",
        type=Path,
        default=Path("results/raous_rectangle"),
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"a {QUICK_MESH[0]} x {QUICK_MESH[1]} mesh unless --nx, --ny say otherwise; all "
        "results are produced",
    )
    return parser


def _count(text: str) -> int:
    """Return a whole number of at least 1."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number >= 1")
    return value


def _number(
    *, above: float = -math.inf, below: float = math.inf, least: float = -math.inf
) -> Callable[[str], float]:
    """Return a reader of finite numbers within open or closed (``least``) bounds."""
    bounds = ((">", above), (">=", least), ("<", below))
    rule = " and".join(f" {sign} {bound:g}" for sign, bound in bounds if math.isfinite(bound))

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and above < value < below and value >= least):
            raise argparse.ArgumentTypeError(f"'{text}' is not a finite number{rule}")
        return value

    return read
