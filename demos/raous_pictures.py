# SPDX-License-Identifier: MIT
"""The pictures of the Raous rectangle, after figures 2, 3, 5, 6 and 7 of the paper; rank 0 only."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from raous_results import MM, MPA, ContactLine, Increment

Array = npt.NDArray[np.float64]
Curves = Mapping[float, tuple[Array, Array]]

NORMAL, TANGENT, EXACT, LIMIT, LOAD = "#1f4e9c", "#c8501e", "#202020", "#8a8a8a", "#4a4a4a"
SYMBOLS = {1: "+", -1: "−"}
SIGNS = {1: "as printed", -1: "the package's default"}
ROUNDING = 1e-9  # tractions below (MPa) are rounding, as after complete unloading
CAPTION = "Tangential stress for values of the blend ξ, in one increment to the full load"
ZONES = {"open": "#f2f2f2", "slip": "#fdeee3", "stick": "#e6eef9"}
STYLE = {
    "savefig.dpi": 200,
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#d9d9d9",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "figure.constrained_layout.use": True,
}


def draw_ramp(path: Path, curves: Curves) -> None:
    """Figure 2: the smoothed ramp against its argument (Pa), for each ``eps`` (Pa)."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(6.0, 4.2))
        for (eps, (x, y)), colour in zip(curves.items(), _shades(len(curves)), strict=True):
            axes.plot(x / MPA, y / MPA, color=colour, label=_eps_label(eps))
            axes.plot(0.0, eps / MPA, "o", color=colour, ms=4.5, clip_on=False)
        axes.set(
            xlabel=r"$x$ (MPa)",
            ylabel=r"$\langle x \rangle_\varepsilon$ (MPa)",
            title=r"Smoothed ramp, eq. (13); dots: $\langle 0\rangle_\varepsilon = \varepsilon$",
        )
        axes.margins(x=0.0)
        axes.legend(loc="upper left")
        _save(figure, path)


def draw_normal_law(path: Path, curves: Curves, r_p: float) -> None:
    """Figure 3: normal traction (Pa) against gap (m), for each ``eps`` (Pa)."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(6.0, 4.2))
        for (eps, (gap, c_n)), colour in zip(curves.items(), _shades(len(curves)), strict=True):
            width = 1.6 if eps > 0.0 else 3.0
            axes.plot(gap * 1e6, c_n / MPA, color=colour, lw=width, label=_eps_label(eps))
        gap, c_n = curves[0.0]
        axes.set(
            xlabel=r"gap $g$ ($\mathrm{\mu m}$)",
            ylabel="normal traction $c_n$ (MPa)",
            xlim=(0.0, 0.8e6 * np.max(gap)),
            ylim=(0.0, 0.8 * np.max(c_n) / MPA),
            title=r"Normal law $\langle r_p g - c_n\rangle_\varepsilon = r_p g$ "
            rf"with $r_p$ = {_scientific(r_p)} Pa/m",
        )
        axes.legend(loc="upper right")
        _save(figure, path)


def draw_deformed(
    path: Path, cells: tuple[Array, Array], last: Increment, pressures: tuple[float, float]
) -> None:
    """Figure 5: magnified deformation, loads, and the traction of the base on the body.

    Args:
        path: File to write.
        cells: Corners and corner displacements of the cells (m).
        last: The increment to show.
        pressures: Lateral and top pressure of the increment (Pa).
    """
    corners, displacements = cells[0] / MM, cells[1] / MM
    length = float(np.max(corners))
    largest = float(np.max(abs(displacements)))
    magnify = _round_down(0.15 * length / largest) if largest > 1e-9 * length else 1.0
    with plt.rc_context({**STYLE, "axes.grid": False}):
        figure, axes = plt.subplots(figsize=(7.0, 6.6))
        box = np.array([[0, 0], [0, length], [length, length], [length, 0]])
        axes.plot(*box.T, "--", color=LIMIT, lw=1.0)
        axes.axhline(0.0, color=LOAD, lw=1.2)
        deformed = corners + magnify * displacements
        colours = {"facecolor": "#edf0f4", "edgecolor": "#66707d"}
        axes.add_collection(PolyCollection(deformed, lw=0.5, zorder=2, **colours))
        _draw_tractions(figure, axes, last.line, magnify, length)
        _draw_loads(axes, length, pressures)
        axes.set_aspect("equal")
        axes.set(
            xlim=(-0.2 * length, 1.09 * length),
            ylim=(-0.2 * length, 1.18 * length),
            xlabel="$x$ (mm)",
            ylabel="$y$ (mm)",
            title=f"Deformation magnified {magnify:g} times (dashed: undeformed),\n"
            "and the traction of the base on the body",
        )
        _save(figure, path)


def draw_stresses(path: Path, last: Increment, mu: float) -> None:
    """Figure 6: contact stresses, the exact ones on the same mesh, and their difference."""
    line, exact = last.line, last.exact
    x = line.x / MM
    with plt.rc_context(STYLE):
        figure, (axes, below) = plt.subplots(
            2, 1, figsize=(7.2, 6.4), sharex=True, height_ratios=(3, 1)
        )
        limit = mu * line.c_n / MPA
        axes.fill_between(x, -limit, limit, color=LIMIT, alpha=0.25, lw=0)
        axes.plot(x, -limit, color=LIMIT, lw=0.8, ls=":")
        axes.plot(x, limit, color=LIMIT, lw=0.8, ls=":", label=r"$\pm\mu\,c_n$")
        axes.plot(x, -line.c_t / MPA, color=TANGENT, label=r"$\sigma_t = -c_t$")
        axes.plot(x, -line.c_n / MPA, color=NORMAL, label=r"$\sigma_n = -c_n$")
        axes.axhline(0.0, color=LOAD, lw=0.8)
        if exact is not None:
            marks = {"ls": "", "marker": "o", "ms": 4.0, "mfc": "none", "mec": EXACT, "mew": 0.8}
            marks["clip_on"] = False
            axes.plot(exact.x / MM, -exact.c_t / MPA, label="exact on this mesh", **marks)
            axes.plot(exact.x / MM, -exact.c_n / MPA, **marks)
            _draw_difference(below, x, line, exact)
        else:
            below.text(0.5, 0.5, "no exact solution found", transform=below.transAxes, ha="center")
        axes.set(ylabel="stress on the base (MPa)", xlim=(x[0], x[-1]))
        figure.legend(loc="outside lower center", ncols=4)
        below.set(xlabel="$x$ (mm)", ylabel="difference (Pa)")
        _shade_zones((axes, below), line)
        _save(figure, path)


def draw_convergence(path: Path, levels: Mapping[int, Mapping[float, ContactLine]]) -> None:
    """Figure 7: tangential stress for values of ``xi``, and its error, for both signs in (12).

    Args:
        path: File to write.
        levels: The contact lines for each sign and each ``xi``.
    """
    with plt.rc_context(STYLE):
        figure, panels = plt.subplot_mosaic(
            [["+", "-"], ["error", "error"]], figsize=(8.6, 7.2), height_ratios=(1.15, 1)
        )
        panels["-"].sharey(panels["+"])
        for sign, panel in ((1, panels["+"]), (-1, panels["-"])):
            _draw_levels(panel, levels[sign])
            panel.set_title(f"sign {SYMBOLS[sign]} in eq. (12), {SIGNS[sign]}")
        panels["+"].set_ylabel(r"$\sigma_t$ (MPa)")
        handles, labels = panels["+"].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=6, title=CAPTION)
        _draw_errors(panels["error"], levels)
        _save(figure, path)


def _draw_levels(axes: Axes, lines: Mapping[float, ContactLine]) -> None:
    """Draw the tangential stress for some values of ``xi``."""
    shown = [xi for xi in (0.9, 0.7, 0.5, 0.2, 0.1, 0.0) if xi in lines]
    for xi, colour in zip(shown, _shades(len(shown)), strict=True):
        line = lines[xi]
        axes.plot(line.x / MM, -line.c_t / MPA, color=colour, label=rf"$\xi = {xi:g}$")
    axes.set_xlabel("$x$ (mm)")
    axes.margins(x=0.0)


def _draw_errors(axes: Axes, levels: Mapping[int, Mapping[float, ContactLine]]) -> None:
    """Draw the largest error of the tangential stress against ``xi``."""
    for sign, colour, marker in ((1, TANGENT, "o"), (-1, NORMAL, "s")):
        lines = levels[sign]
        errors = {
            xi: float(np.max(abs(line.c_t - lines[0.0].c_t)))
            for xi, line in lines.items()
            if xi > 0.0 and 0.0 in lines
        }
        shown = {xi: error for xi, error in errors.items() if error > 0.0}
        style = {"marker": marker, "mfc": "none", "ms": 6 + sign, "color": colour}
        if shown:
            axes.loglog(list(shown), list(shown.values()), label=f"sign {SYMBOLS[sign]}", **style)
    axes.set(xlabel=r"$\xi$", ylabel=r"$\max_x\,|\sigma_t(\xi) - \sigma_t(0)|$ (Pa)")
    if axes.lines:
        axes.set_xlim(2.0, 0.5 * min(xi for lines in levels.values() for xi in lines if xi > 0.0))
        axes.legend(loc="upper right")
    else:
        axes.text(0.5, 0.5, "no difference", transform=axes.transAxes, ha="center")


def _draw_tractions(
    figure: Figure, axes: Axes, line: ContactLine, magnify: float, length: float
) -> None:
    """Draw the tractions as arrows that end at the deformed nodes, coloured by their size."""
    size = np.hypot(line.c_t, line.c_n) / MPA
    on = size > max(1e-9 * float(np.max(size)), ROUNDING)
    x, y = (line.x + magnify * line.u_x) / MM, magnify * line.gap / MM
    largest = float(np.max(size[on], initial=0.0)) or 1.0
    arrows = axes.quiver(
        x[on], y[on], line.c_t[on] / MPA, line.c_n[on] / MPA, size[on],
        pivot="tip", angles="xy", scale_units="xy", scale=largest / (0.15 * length),
        cmap="plasma_r", width=0.0042, headwidth=3.5, headlength=4.5, headaxislength=4, zorder=3,
        clim=(0.0, largest),
    )  # fmt: skip
    figure.colorbar(arrows, ax=axes, shrink=0.7, pad=0.02, label="contact traction $|c|$ (MPa)")


def _draw_loads(axes: Axes, length: float, pressures: tuple[float, float]) -> None:
    """Draw the pressures on the flank and on the top."""
    lateral, top = (pressure / MPA for pressure in pressures)
    arrow = {"arrowstyle": "-|>", "color": LOAD, "lw": 1.0, "shrinkA": 0.0, "shrinkB": 0.0}
    for s in np.linspace(0.08, 0.92, 8) * length:
        ends = [(-0.09 * length, s), (-0.015 * length, s)]
        start, end = ends if lateral >= 0.0 else ends[::-1]
        if lateral != 0.0:
            axes.annotate("", xy=end, xytext=start, arrowprops=arrow)
        if top != 0.0:
            axes.annotate("", (s, 1.015 * length), (s, 1.09 * length), arrowprops=arrow)
    text = {"ha": "center", "va": "center", "color": LOAD}
    axes.text(-0.13 * length, 0.5 * length, f"{lateral:g} MPa", rotation=90, **text)
    axes.text(0.5 * length, 1.13 * length, f"{top:g} MPa", **text)
    axes.plot([length, length], [0.0, 1.1 * length], "-.", color=LOAD, lw=0.9)
    axes.text(1.045 * length, 0.5 * length, "symmetry, $u_x = 0$", rotation=90, **text)


def _draw_difference(axes: Axes, x: Array, line: ContactLine, exact: ContactLine) -> None:
    """Draw the differences from the exact tractions on a logarithmic scale."""
    least = 1e-18 * max(float(np.max(abs(exact.c_n))), 1.0)  # nothing below is worth a decade
    for difference, colour in ((line.c_t - exact.c_t, TANGENT), (line.c_n - exact.c_n, NORMAL)):
        shown = abs(difference) > least
        axes.semilogy(x[shown], abs(difference[shown]), ".-", lw=0.8, ms=5, color=colour)


def _shade_zones(panels: Sequence[Axes], line: ContactLine) -> None:
    """Shade the zones of contact and name them in the first panel."""
    for name, intervals in line.zones().items():
        for first, last in intervals:
            for axes in panels:
                axes.axvspan(first, last, color=ZONES[name], lw=0, zorder=0)
            if last - first > 0.05 * (line.x[-1] - line.x[0]) / MM:
                where = panels[0].get_xaxis_transform()
                panels[0].text(
                    0.5 * (first + last), 1.01, name, transform=where, ha="center", va="bottom"
                )


def _shades(count: int) -> Array:
    """Return colours from light to dark."""
    return plt.get_cmap("viridis_r")(np.linspace(0.12, 1.0, count))


def _eps_label(eps: float) -> str:
    """Return the label of a curve for one ``eps`` (Pa)."""
    return rf"$\varepsilon$ = {eps / MPA:g} MPa" if eps > 0.0 else r"$\varepsilon$ = 0"


def _scientific(value: float) -> str:
    """Return a number with two digits and a power of ten, in mathtext."""
    mantissa, exponent = f"{value:.1e}".split("e")
    return rf"${mantissa}\times 10^{{{int(exponent)}}}$"


def _round_down(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten below ``value``."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value)


def _save(figure: Figure, path: Path) -> None:
    """Write and close a figure."""
    figure.savefig(path)
    plt.close(figure)
