# SPDX-License-Identifier: MIT
"""What the Raous rectangle says: progress and tables, on rank 0 only."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from mpi4py import MPI

from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from fenicsx_friction import SubstepReport
from raous_options import Options
from raous_results import MM, MPA, POINTS, Increment, plain

#: Mean of the codes that took part in the benchmark (code_aster SSNV128), u_x in 1e-5 m, ± 5 %.
BENCHMARK = {"A": 2.86, "B": 2.72, "C": 2.28, "D": 1.98, "E": 1.50}
PAPER = {"mu": 1.0, "E": 130e9, "nu": 0.2, "lateral_pressure": 150e6, "top_pressure": 50e6}
ELEMENTS = {"bbar": "B-bar", "q1": "Q1"}

console = Console(quiet=MPI.COMM_WORLD.rank != 0, highlight=False)


def say_problem(options: Options, ranks: int) -> None:
    """Print what is solved."""
    console.print(
        f"[bold]Raous rectangle[/bold]: {options.nx} × {options.ny} {ELEMENTS[options.element]} "
        f"elements, mu = {options.mu:g}, E = {options.E / 1e9:g} GPa, nu = {options.nu:g}, "
        f"pressures {options.lateral_pressure / MPA:g} and {options.top_pressure / MPA:g} MPa, "
        f"{len(options.history)} increment(s), {ranks} rank(s)"
    )


def track(history: Sequence[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """Yield the increments of a history behind a progress bar, or with a line each in a log."""
    if not console.is_terminal:
        for k, factors in enumerate(history, 1):
            console.print(f"Increment {k} of {len(history)}")
            yield factors
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=console) as progress:
        task = progress.add_task("Increments", total=len(history))
        for factors in history:
            yield factors
            progress.advance(task)


@contextmanager
def drawing() -> Iterator[Callable[[str], None]]:
    """Show which picture is being drawn."""
    with console.status("Pictures") as status:

        def tell(text: str) -> None:
            status.update(f"Drawing {text}")
            if not console.is_terminal:
                console.print(f"Drawing {text}")

        yield tell


def say_results(options: Options, increments: Sequence[Increment]) -> None:
    """Print the tables."""
    console.print(_increments(options, increments))
    last = increments[-1]
    console.print(_points(options, last))
    zones = (
        f"[bold]{name}[/bold] " + ", ".join(f"{a:.2f} – {b:.2f}" for a, b in intervals)
        for name, intervals in last.line.zones().items()
        if intervals
    )
    console.print("Zones on the base (mm, limits halfway between nodes): " + "; ".join(zones))
    substeps = " + ".join(_substep(s) for s in last.report.substeps)
    console.print(
        f"Newton iterations: {substeps} = {last.report.iterations} ({last.report.solver} solver)"
    )
    certificate = last.report.certificate
    console.print(
        f"Certificate: {certificate.relative:.1e} relative; penetration "
        f"{plain(certificate.penetration):.1e} m, outside the cone "
        f"{plain(certificate.cone):.1e} Pa, equilibrium {certificate.equilibrium:.1e} N"
    )
    deviation = last.deviation()
    console.print(
        "Exact solution: none found"
        if deviation is None
        else f"Deviation from the exact solution: {deviation['max_traction_deviation_Pa']:.1e} Pa "
        f"({deviation['max_traction_deviation_relative']:.1e} relative), "
        f"{deviation['max_u_x_deviation_m']:.1e} m"
    )


def say_files(folder: Path) -> None:
    """Print what was written."""
    names = sorted(path.name for path in folder.iterdir())
    console.print(f"Written to {folder}: {', '.join(names)}", soft_wrap=True)


def say_failure(message: str) -> None:
    """Print why the history ended early."""
    console.print("[bold red]Stopped early.[/bold red]")
    console.print(message, markup=False, soft_wrap=True)


def _increments(options: Options, increments: Sequence[Increment]) -> Table:
    """Return one row an increment."""
    title = "Increments (F: force of the base on the body; certificate relative)"
    table = Table(title=title, box=box.SIMPLE, padding=(0, 1, 0, 0))
    names = ("step", "lateral", "top", "open", "slip", "stick", "solves", "F_x", "F_y", "cert.")
    units = ("", "MPa", "MPa", "nodes", "nodes", "nodes", "", "kN/m", "kN/m", "")
    for name, unit in zip(names, units, strict=True):
        table.add_column(f"{name}\n{unit}", justify="right", no_wrap=True)
    for increment in increments:
        (contact,) = increment.report.contacts
        table.add_row(
            f"{increment.report.step}",
            f"{increment.factors[0] * options.lateral_pressure / MPA:.4g}",
            f"{increment.factors[1] * options.top_pressure / MPA:.4g}",
            f"{contact.open}",
            f"{contact.slip}",
            f"{contact.stick}",
            f"{increment.report.iterations}",
            *(f"{force / 1e3:.1f}" for force in contact.force),
            f"{increment.report.certificate.relative:.0e}",
        )
    return table


def _points(options: Options, last: Increment) -> Table:
    """Return one row a point."""
    title = f"Displacement of points on the base after step {last.report.step}"
    table = Table(title=title, box=box.SIMPLE)
    proportional = all(a == b for a, b in options.history)
    known = proportional and list(options.history) == sorted(options.history)
    known &= last.factors == (1.0, 1.0)
    known &= all(getattr(options, name) == value for name, value in PAPER.items())
    headers = ["point", "x (mm)", "u_x (1e-5 m)", "exact (1e-5 m)"]
    for header in headers + ["other codes ± 5 %"] * known:
        table.add_column(header, justify="right", no_wrap=True)
    for name, x in POINTS.items():
        exact = _hundredths(last.exact.at(x * MM)) if last.exact else "-"
        row = [name, f"{x:g}", _hundredths(last.line.at(x * MM)), exact]
        if known:
            row.append(f"{BENCHMARK[name]:.2f}" if name in BENCHMARK else "")
        table.add_row(*row)
    return table


def _hundredths(u_x: float) -> str:
    """Return a displacement in 1e-5 m, without the sign of a rounded zero."""
    return f"{round(u_x * 1e5, 8) + 0.0:.8f}"


def _substep(substep: SubstepReport) -> str:
    """Return a substep in a few words."""
    blend = f" (ξ = {substep.xi:g})" if substep.name == "slip" else ""
    return f"{substep.name}{blend} {substep.iterations}{'' if substep.accepted else ' rejected'}"
