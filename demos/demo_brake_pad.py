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
# A pad is pressed on a disc that moves below it. The temperature $T$ of the pad is a further
# unknown, and all is coupled: friction heats the pad, heat expands it and so presses it harder,
# pressure lets heat through the gap, and a hot pad has less friction. What flows into the pad is
#
# $$
# k\, \partial_n T = \eta\, c_t \cdot \dot s - h(c_n)\, (T - T_{disc}),
# $$
#
# a part $\eta$ of the power of friction, less what the conductance $h$ of the gap lets through to
# the disc. The tractions $(c_n, c_t)$ are `contact.c`. They are unknowns, and may stand in any
# equation. `surface.measure()` takes the heat at the nodes, as contact takes the work: so the one
# is the other to the last digits.
#
# First a guided pad is pressed on a disc at rest, which is a column with a closed form: the
# backing plate, the pad and the gap are resistances in series, and the pressure depends on the
# temperature. Then the pad is free at its sides, and brakes.
#
# ```
# ./container python3 demos/demo_brake_pad.py
# ```

# +
import argparse
from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff

WIDTH, HEIGHT, WAY = 60e-3, 12e-3, 20e-6  # m; the backing plate is pressed down by WAY
E, NU, EXPANSION = 1e9, 0.25, 10e-6  # Pa, -, 1/K
CONDUCTIVITY, CAPACITY = 2.0, 2.5e6  # W/(m K), J/(m³ K)
GAP, PLATE, SHARE = 3e-4, 500.0, 0.5  # h/c_n: W/(N K); plate: W/(m² K); of the heat of friction
COLD, HOT, SPEED, STEP = 293.0, 393.0, 0.3, 10.0  # K, K, m/s, s
# -

# ## The model


class Pad:
    """A pad in plane strain below a backing plate, on a cold disc."""

    def __init__(self, outside: float, *, guided: bool, cells: int = 8) -> None:
        msh = mesh.create_rectangle(
            MPI.COMM_WORLD,
            [(0.0, 0.0), (WIDTH, HEIGHT)],
            [5 * cells, cells],
            mesh.CellType.quadrilateral,
        )
        places = [(1, 0.0), (1, HEIGHT), (0, (0.0, WIDTH))]
        low, high, sides = (
            mesh.locate_entities_boundary(msh, 1, lambda x, i=i, at=at: np.isin(x[i], at))
            for i, at in places
        )
        facets, numbers = np.append(low, high), np.repeat([1, 2], [len(low), len(high)])
        order = np.argsort(facets)
        tags = mesh.meshtags(msh, 1, facets[order], numbers[order].astype(np.int32))
        V, W = (fem.functionspace(msh, ("Lagrange", 1, shape)) for shape in ((2,), ()))
        unknowns = u, T = fem.Function(V), fem.Function(W)
        self.last = u_last, T_last = fem.Function(V), fem.Function(W)
        T.x.array[:] = T_last.x.array[:] = COLD
        self.way, self.rate = fem.Constant(msh, 0.0), fem.Constant(msh, 0.0)

        surface, self.disc = ff.ContactSurface(msh, tags, 1, "pad"), ff.RigidMotion(msh)
        plane = ff.RigidPlane((0.0, 0.0), (0.0, 1.0), motion=self.disc)
        contact = ff.Contact(surface, plane, ff.Coulomb(0.4 - 0.0005 * (T - COLD)))
        material = ff.bulk.Elastic(E, NU)
        deviatoric, volumetric = ff.bulk.small_strain_energy(u, material)
        heated = 3.0 * material.bulk_modulus * EXPANSION * (T - COLD) * ufl.div(u)
        energy = ff.bulk.stored_energy((deviatoric, volumetric - heated), ufl.dx)

        def flows(q: ufl.core.expr.Expr) -> list[ufl.Form]:
            """Return what is stored, what goes to the plate and through the gap, what heats."""
            c_n, c_t = contact.c
            slid = self.way - (u[0] - u_last[0])
            on, above = surface.measure(), ufl.Measure("ds", msh, subdomain_data=tags)(2)
            return [
                CAPACITY * self.rate * (T - T_last) * q * ufl.dx,
                PLATE * (T - outside) * q * above,
                GAP * c_n * (T - COLD) * q * on,
                SHARE * self.rate * c_t * slid * q * on,
            ]

        v, q = ufl.TestFunction(V), ufl.TestFunction(W)
        stored, plate, gap, heat = flows(q)
        inside = CONDUCTIVITY * ufl.inner(ufl.grad(T), ufl.grad(q)) * ufl.dx
        top = fem.locate_dofs_topological(V, 1, high)
        bcs = [fem.dirichletbc(np.array([0.0, -WAY]), top, V)]
        if guided:
            dofs = fem.locate_dofs_topological(V.sub(0), 1, sides)
            bcs.append(fem.dirichletbc(fem.Constant(msh, 0.0), dofs, V.sub(0)))
        self.problem = ff.FrictionalContactProblem(
            [ufl.derivative(energy, u, v), stored + plate + gap + inside - heat],
            unknowns,
            contact=contact,
            bcs=bcs,
            petsc_options_prefix=f"pad{guided:d}_",
        )
        one = fem.Constant(msh, 1.0)
        self._totals = [fem.form(f, entity_maps=[surface.entity_map]) for f in flows(one)]

    def step(self, way: float, rate: float) -> ff.StepReport:
        """Move the disc (m) in a time (s) of 1 / rate, or wait without end at a rate of zero."""
        self.way.value, self.rate.value = way, rate
        self.disc.translation.value[0] += way
        for old, now in zip(self.last, self.problem.unknowns, strict=True):
            old.x.array[:] = now.x.array
        return self.problem.solve()

    def totals(self) -> np.ndarray:
        """Return what is stored, what goes to plate and disc, and what friction heats (W/m)."""
        own = [fem.assemble_scalar(form) for form in self._totals]
        return self.problem.comm.allreduce(np.array(own))

    def contact_values(self) -> tuple[np.ndarray, np.ndarray]:
        """Return pressures (Pa) and temperatures (K) at the nodes of this rank."""
        (contact,), T = self.problem.contacts, self.problem.unknowns[1]
        at = contact.surface.parent_dofs(T.function_space)[: contact.surface.num_owned]
        return contact.multipliers()[:, 0], T.x.array[at]


# ## A column at rest


def column() -> tuple[float, float]:
    """Return pressure (Pa) and temperature (K) at the contact of a guided pad at rest."""
    material = ff.bulk.Elastic(E, NU)
    K, G = material.bulk_modulus, material.shear_modulus
    pressure = E * WAY / HEIGHT
    for _ in range(200):
        flow = (HOT - COLD) / (1.0 / PLATE + HEIGHT / CONDUCTIVITY + 1.0 / (GAP * pressure))
        hot = COLD + flow / (GAP * pressure)
        mean = hot + flow * HEIGHT / CONDUCTIVITY / 2.0
        pressure = (K + 4.0 / 3.0 * G) * WAY / HEIGHT + 3.0 * K * EXPANSION * (mean - COLD)
    return pressure, hot


# ## Braking


def draw(folder: Path, rows: np.ndarray) -> None:
    """Draw the temperature, pressures before and after, and friction over time."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(15, 4), layout="constrained")
    grid = ff.plot.fields(folder)
    x, y = 1e3 * grid.points[:, 0], 1e3 * grid.points[:, 1]
    levels = axes[0].tricontourf(x, y, grid["temperature"], 20, cmap="inferno")
    figure.colorbar(levels, label="temperature (K)", format="%.0f", location="top")
    axes[0].set(xlabel="x (mm), the disc moves to the right", ylabel="y (mm)")
    for step, label in ((0, "cold"), (-1, "hot")):
        line = ff.plot.fields(folder, "pad", step)
        order = np.argsort(line.points[:, 0])
        x, pressure = line.points[order, 0], line["pressure"][order]
        axes[1].plot(1e3 * x, pressure / 1e6, ".-", label=label)
    axes[1].set(xlabel="x (mm)", ylabel="pressure (MPa)")
    axes[1].legend()
    axes[2].plot(rows[:, 0], rows[:, 1], color="tab:blue")
    axes[2].set(xlabel="time (s)", ylabel="friction force / normal force")
    hot = axes[2].twinx()
    hot.plot(rows[:, 0], rows[:, 2], "--", color="tab:red")
    hot.set(ylabel="hottest place, dashed (K)")
    figure.savefig(folder / "brake_pad.png", dpi=150)


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare the column with its closed form, then brake."""
    parser = argparse.ArgumentParser(description="A brake pad gets hot.")
    parser.add_argument("--output", type=Path, default=Path("results/brake_pad"))
    parser.add_argument("--steps", type=int, default=20)
    given = parser.parse_args(arguments)
    rest = Pad(HOT, guided=True)
    rest.step(0.0, 0.0)
    errors = [
        rest.problem.comm.allreduce(np.max(abs(found / right - 1.0), initial=0.0), MPI.MAX)
        for found, right in zip(rest.contact_values(), column(), strict=True)
    ]

    pad = Pad(COLD, guided=False)
    T = pad.problem.unknowns[1]
    results = ff.Results(pad.problem, given.output, fields={"temperature": T})
    results.write(0.0, pad.step(0.0, 0.0))
    rows, unbalanced = [], 0.0
    for k in range(1, given.steps + 1):
        report = pad.step(SPEED * STEP, 1.0 / STEP)
        results.write(k * STEP, report)
        *flows, heat = pad.totals()
        work = SHARE * report.contacts[0].dissipation / STEP
        unbalanced = max(unbalanced, abs(sum(flows) / work - 1.0), abs(heat / work - 1.0))
        force = report.contacts[0].force
        hottest = pad.problem.comm.allreduce(np.max(T.x.array), MPI.MAX)
        rows.append((k * STEP, force[0] / force[1], hottest, *flows, work))
    if pad.problem.comm.rank == 0:
        print(f"At rest {column()[0] / 1e6:.4f} MPa, {column()[1]:.3f} K at the contact;",
              f"errors {errors[0]:.0e}, {errors[1]:.0e}")  # fmt: skip
        print(f"Braking: friction {rows[0][1]:.4f}, in the end {rows[-1][1]:.4f}")
        stored, plate, gap, work = rows[-1][3:]
        print(f"Heat {work:.1f} W/m: stored {stored:.1f}, to the plate {plate:.1f}, "
              f"to the disc {gap:.1f}; never off by more than {unbalanced:.0e}")  # fmt: skip
        draw(given.output, np.array(rows))


if __name__ == "__main__":
    main()
