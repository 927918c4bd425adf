# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A friction law of your own
#
# SPDX-License-Identifier: MIT
#
# A rubber pad of 100 mm × 10 mm is pressed on a rigid base and dragged forth and back by its top.
# Its friction weakens with the way it has slid, and with the temperature. The demo
#
# 1. writes that law in UFL, in a few lines; Jacobian and certificate follow by themselves,
# 2. drags the pad cold and warm, and compares the force with a closed form,
# 3. writes a law that the certificate cannot know, and shows what the report says then.
#
# ```
# ./container python3 demos/demo_custom_friction_law.py
# ./container mpirun -n 2 python3 demos/demo_custom_friction_law.py --quick
# ```

# +
import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from mpi4py import MPI

import matplotlib
import numpy as np
import ufl
from dolfinx import fem, mesh
from scipy.optimize import brentq

import fenicsx_friction as ff

matplotlib.use("Agg")
import matplotlib.pyplot as plt

LENGTH, HEIGHT, PRESSED = 0.1, 0.01, 1e-4  # m
E = 10e6  # Pa; Poisson's ratio is 0, so that
PRESSURE = E * PRESSED / HEIGHT  # Pa
STIFFNESS = E / 2.0 / HEIGHT  # Pa/m, of the pad in shear
STATIC, KINETIC, DISTANCE, MELTING = 0.6, 0.3, 1e-3, 400.0  # -, -, m, K above the cold
VISCOSITY, SPEED = 2e7, 1e-3  # Pa s/m, m/s
# -

# ## The law
#
# A law states the largest tangential traction, its *limit*, in UFL. It may use the pressure, and of
# `sliding` the slip of the step, its rate, the accumulated path, the tangents and the position;
# beside them any Function, here a temperature $T$ on the pad:
#
# $$
# \tau_{\max} = \bigl(\mu_k + (\mu_s - \mu_k)\, e^{-\text{path}/d}\bigr)
#               \bigl(1 - T/T_m\bigr)\, p .
# $$
#
# The rest is that of Coulomb: no slip below the limit, slip against the traction at it. The path
# includes the present step, so that the weakening is implicit; UFL derives the Jacobian.


class Weakening(ff.FrictionLaw):
    """Coulomb friction that weakens with the path of slip and with the temperature."""

    def __init__(self, temperature: fem.Function) -> None:
        self.temperature = temperature

    def limit(self, pressure, sliding):
        mu = KINETIC + (STATIC - KINETIC) * ufl.exp(-sliding.path / DISTANCE)
        return mu * (1.0 - self.temperature / MELTING) * pressure


# A law that is no cone overrides `row` instead: the residual that vanishes where the law holds. An
# oil film resists in proportion to the slip rate, $c_t = -\eta\, s/\Delta t$ while in contact; the
# row is told where by its limit. (As a *limit*, `VISCOSITY * sliding.rate`, the very same law would
# be certified: prefer limits.)


class OilFilm(ff.FrictionLaw):
    """A linear viscous film, for steps of ``dt`` seconds."""

    def __init__(self, dt: float) -> None:
        self.resistance = VISCOSITY / dt

    def limit(self, pressure, sliding):
        return pressure

    def row(self, s, c_t, limit, r, eps):
        return c_t + ufl.conditional(ufl.gt(limit, 0.0), self.resistance, 0.0) * s


# ## The pad
#
# The top is moved, the bottom is the contact surface. Nothing here knows the law.


class Pad:
    """The pad, its temperature, and the problem of dragging it."""

    def __init__(self, make_law: Callable[[fem.Function], ff.FrictionLaw], nx: int) -> None:
        self.mesh = mesh.create_rectangle(
            MPI.COMM_WORLD,
            [[0.0, 0.0], [LENGTH, HEIGHT]],
            [nx, max(nx // 10, 2)],
            mesh.CellType.quadrilateral,
        )
        V = fem.functionspace(self.mesh, ("Lagrange", 1, (2,)))
        u, v, self.top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
        self.temperature = fem.Function(fem.functionspace(self.mesh, ("Lagrange", 1)))
        bottom = mesh.locate_entities_boundary(self.mesh, 1, lambda x: np.isclose(x[1], 0.0))
        tags = mesh.meshtags(self.mesh, 1, np.sort(bottom), 1)
        held = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], HEIGHT))
        energy = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, 0.0))
        contact = ff.Contact(
            ff.ContactSurface(self.mesh, tags, 1),
            ff.RigidPlane((0.0, 0.0), (0.0, 1.0)),
            make_law(self.temperature),
        )
        self.problem = ff.FrictionalContactProblem(
            ufl.derivative(ff.bulk.stored_energy(energy, ufl.dx), u, v),
            u,
            contact=contact,
            bcs=[fem.dirichletbc(self.top, held)],
            petsc_options_prefix="pad_",
        )

    def drag(self, path: np.ndarray) -> tuple[np.ndarray, ff.StepReport]:
        """Move the top along ``path`` (m); return the friction forces (N/m) and the last report."""
        forces = []
        for x in path:
            self.top.x.array[:] = np.tile([x, -PRESSED], len(self.top.x.array) // 2)
            report = self.problem.solve()
            forces.append(-report.contacts[0].force[0])
        return np.array(forces), report


# ## The closed form
#
# Away from its edges the pad is a column in shear, $\tau = k\,(x - a)$ with the displacement $a$ of
# its bottom and $k = G/h$. A step of weakening friction that slips by $\delta$ solves
# $k\,(x - a \mp \delta) = \pm\tau_{\max}(\text{path} + \delta)$, one equation for $\delta$.
# Temperature varies linearly along the pad, and the mean of the columns is taken.


def weakening_column(path: np.ndarray, temperature: float) -> np.ndarray:
    """Return the shear tractions (Pa) of a column of the pad."""
    bottom = slid = 0.0
    tractions = []
    for x in path:
        trial = STIFFNESS * (x - bottom)

        def excess(slip: float, trial: float = trial, slid: float = slid) -> float:
            mu = KINETIC + (STATIC - KINETIC) * np.exp(-(slid + slip) / DISTANCE)
            return abs(trial) - STIFFNESS * slip - mu * (1.0 - temperature / MELTING) * PRESSURE

        slip = brentq(excess, 0.0, abs(trial) / STIFFNESS) if excess(0.0) > 0.0 else 0.0
        bottom, slid = bottom + np.sign(trial) * slip, slid + slip
        tractions.append(STIFFNESS * (x - bottom))
    return np.array(tractions)


def oil_column(path: np.ndarray, dt: float) -> np.ndarray:
    """Return the shear tractions (Pa) of a column on the oil film."""
    bottom, rate, tractions = 0.0, VISCOSITY / dt, []
    for x in path:
        bottom += STIFFNESS * (x - bottom) / (STIFFNESS + rate)
        tractions.append(STIFFNESS * (x - bottom))
    return np.array(tractions)


# ## Run
#
# `check_jacobian` compares the derived Jacobians with finite differences, at nodes that are open,
# stick and slip: a good first test of a new law.


def tell(name: str, report: ff.StepReport, pad: Pad, error: float) -> None:
    """Print what is known of a run."""
    certificate, jacobian = report.certificate, ff.check_jacobian(pad.problem)
    if pad.mesh.comm.rank == 0:
        print(f"{name}: {report.step} steps, force within {100 * error:.1f} % of the closed form")
        print(
            f"  certificate: certified {certificate.certified}, solved {certificate.solved}, "
            f"certifiable {certificate.certifiable}, relative residual {certificate.relative:.0e}"
        )
        print(f"  Jacobian against finite differences: {jacobian.error:.0e}")


def run(nx: int, steps: int) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Drag the pad with each law; return path (m), force and closed form (N/m) of each run."""
    forth = np.linspace(0.0, 4e-3, steps + 1)[1:]
    path = np.concatenate([forth, np.linspace(4e-3, 2e-3, steps // 2 + 1)[1:]])
    curves = {}
    for name, warmth in (("cold", 0.0), ("0 to 200 K along the pad", 200.0)):
        pad = Pad(Weakening, nx)
        pad.temperature.interpolate(lambda x, warmth=warmth: warmth * x[0] / LENGTH)
        forces, report = pad.drag(path)
        columns = [weakening_column(path, warmth * t) for t in (np.arange(50) + 0.5) / 50.0]
        closed = LENGTH * np.mean(columns, axis=0)
        curves[name] = path, forces, closed
        tell(name, report, pad, np.max(abs(forces - closed)) / np.max(closed))
    dt = path[0] / SPEED
    pad = Pad(lambda temperature: OilFilm(dt), nx)
    forces, report = pad.drag(path)
    closed = LENGTH * oil_column(path, dt)
    curves["oil film"] = path, forces, closed
    tell("oil film", report, pad, np.max(abs(forces - closed)) / np.max(closed))
    return curves


def draw(file: Path, curves: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]) -> None:
    """Draw force over displacement, lines for the package and circles for the closed form."""
    figure, axes = plt.subplots(figsize=(7.0, 4.4), layout="constrained")
    for (name, (x, force, closed)), colour in zip(
        curves.items(), ("#1f4e9c", "#c8501e", "#6a8f3c"), strict=True
    ):
        x, force, closed = (np.concatenate([[0.0], values]) for values in (x, force, closed))
        axes.plot(x * 1e3, force, color=colour, label=name)
        axes.plot(x * 1e3, closed, "o", ms=3.5, mfc="none", mec=colour, mew=0.8)
    axes.axhline(0.0, color="#8a8a8a", lw=0.8)
    axes.grid(color="#d9d9d9", lw=0.6)
    axes.set(
        xlabel="displacement of the top (mm)",
        ylabel="friction force (N per metre of depth)",
        title="A pad dragged forth and back; circles: closed form",
    )
    axes.legend(frameon=False, loc="lower left")
    figure.savefig(file, dpi=200)
    plt.close(figure)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demo; return its exit status."""
    parser = argparse.ArgumentParser(description="Friction laws of one's own.")
    parser.add_argument("--output", type=Path, default=Path("results/custom_friction_law"))
    parser.add_argument("--quick", action="store_true", help="coarse mesh, few steps")
    options = parser.parse_args(arguments)
    nx, steps = (20, 20) if options.quick else (60, 60)
    curves = run(nx, steps)
    if MPI.COMM_WORLD.rank == 0:
        options.output.mkdir(parents=True, exist_ok=True)
        draw(options.output / "force.png", curves)
        print(f"Written: {options.output / 'force.png'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

# ## What to look at
#
# * The force rises elastically to nearly $\mu_s N$ = 6 kN/m, falls to $\mu_k N$ = 3 kN/m while the
#   pad slides, and turns round when it is dragged back; there it is weak, because the path is long.
# * The warm pad slips first at its hot end, and carries on average three quarters of the force.
# * What separates lines from circles is the pad's edges, which a column does not know.
# * The oil film is *solved*, to rounding, and *not certified*: no cone, no projection, nothing to
#   compare the rows with but the rows. `report.certified` is false, and no exception is raised.
