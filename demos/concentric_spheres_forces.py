# SPDX-License-Identifier: MIT
"""Forces of the compressed concentric spheres: published ones, comparison and pictures.

As a script it draws tables of ``demo_concentric_spheres.py`` over published forces and over those
near the limit of fine meshes, and prints how far from the latter they are::

    ./container python3 demos/concentric_spheres_forces.py --mu 0 --output forces.png \\
        coarse=results/concentric_spheres/coarse_nodes_mu0/force.csv \\
        fine=results/concentric_spheres/fine_nodes_mu0/force.csv
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np

from deformable_output import Row, read_table

matplotlib.use("Agg")
import matplotlib.pyplot as plt

DATA = Path(__file__).with_name("data")
#: Displacements (mm) at which forces are compared.
COMPARED = (2.0, 3.0, 4.0, 5.0, 6.0, 7.5, 8.0, 8.5, 9.0, 9.5)
#: How the curves of codes and this package are told apart.
COLOURS = ("tab:blue", "tab:red", "tab:green", "tab:purple")
Curve = tuple[np.ndarray, np.ndarray]


def _column(file: str, name: str) -> Curve:
    """Return a force (N) over the displacement (mm) from a table, where it is known."""
    table = np.genfromtxt(DATA / file, delimiter=",", names=True, skip_header=1)
    known = np.isfinite(table[name])
    return table["u_mm"][known], table[name][known]


def published(mu: float) -> dict[str, Curve]:
    """Return published curves by code, for mu = 0 and 0.5."""
    prefix = {0.0: "mu0_", 0.5: "mu05_"}.get(mu)
    names = (DATA / "concentric_spheres_force.csv").read_text().splitlines()[1].split(",")
    chosen = [n for n in names if prefix and n.startswith(prefix)]
    return {n.removeprefix(str(prefix)): _column("concentric_spheres_force.csv", n) for n in chosen}


def fine(mu: float) -> Curve | None:
    """Return the curve of the fine mesh of the solids4foam collection, for mu = 0 and 0.5."""
    name = {0.0: "mu_0", 0.5: "mu_05"}.get(mu)
    return None if name is None else _column("concentric_spheres_solids4foam.csv", name)


def limit(mu: float) -> Curve | None:
    """Return the curve near the limit of fine meshes, for mu = 0, 0.5 and 2."""
    name = {0.0: "mu0", 0.5: "mu05", 2.0: "mu2"}.get(mu)
    return None if name is None else _column("concentric_spheres_limit.csv", name)


def draw_force(tables: Mapping[str, Sequence[Row]], mu: float, path: Path) -> None:
    """Draw forces over the displacement, with published ones and those near the limit."""
    figure, axes = plt.subplots(figsize=(7.5, 5.0), layout="constrained")
    codes = published(mu)
    if codes:
        u = np.linspace(0.5, 9.5, 181)
        forces = [np.interp(u, *curve, right=np.nan) for curve in codes.values()]
        spread = np.nanmin(forces, axis=0), np.nanmax(forces, axis=0)
        axes.fill_between(u, *spread, color="0.85", label="published, coarse meshes")
    for colour, (name, rows) in zip(COLOURS, tables.items(), strict=False):
        curve = ([row[key] for row in rows] for key in ("displacement_mm", "force_N"))
        axes.plot(*curve, ".-", ms=4.0, lw=1.2, color=colour, label=name)
    if (near := limit(mu)) is not None:
        axes.plot(*near, "k-", lw=1.8, label="axisymmetric, very fine")
    if (points := fine(mu)) is not None:
        axes.plot(*points, "o", mfc="none", color="k", label="solids4foam, 405/605 faces")
    axes.set_xlabel("displacement of the upper plane (mm)")
    axes.set_ylabel("force on the octant (N)")
    axes.set_title(f"Compressed concentric spheres, µ = {mu:g}")
    axes.set_ylim(0.0, 14.0 if mu > 1.0 else 7.0)
    axes.legend()
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def compare(tables: Mapping[str, Sequence[Row]], mu: float) -> list[str]:
    """Return lines of a table: forces (N), and how far they are from the limit (%)."""
    near, lines = limit(mu), []
    names = "".join(f"{name:>20}" for name in tables)
    lines.append(f"{'mm':>5}{'limit':>8}{names}")
    for u in COMPARED:
        right = np.nan if near is None else np.interp(u, *near)
        line = f"{u:5.1f}{right:8.3f}"
        for rows in tables.values():
            x, y = ([row[key] for row in rows] for key in ("displacement_mm", "force_N"))
            force = np.interp(u, x, y, right=np.nan)
            line += f"{force:12.3f} ({100.0 * (force / right - 1.0):+4.1f})"
        lines.append(line)
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare and draw tables."""
    parser = argparse.ArgumentParser(description="Forces of compressed concentric spheres")
    parser.add_argument("tables", nargs="+", metavar="NAME=TABLE")
    parser.add_argument("--mu", type=float, default=0.0)
    parser.add_argument("--output", type=Path, default=Path("results/concentric_spheres.png"))
    options = parser.parse_args(arguments)
    named = (text.split("=", 1) for text in options.tables)
    tables = {name: read_table(Path(path)) for name, path in named}
    options.output.parent.mkdir(parents=True, exist_ok=True)
    draw_force(tables, options.mu, options.output)
    print("\n".join(compare(tables, options.mu)))


if __name__ == "__main__":
    main()
