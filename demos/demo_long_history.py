# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A long history: steps, events, energies, restart
#
# SPDX-License-Identifier: MIT
#
# A pad is pressed on a rigid base and dragged to and fro, three times. A `LoadStepper` chooses the
# steps: it cuts those that fail and those whose halves differ too much, and leaves nothing of a
# rejected step behind. Beside it stand
#
# * an `EnergyAudit`: in each step, work of the loads = stored + friction + defect of the step,
# * an event log: which node opened, stuck or slipped, where and when,
# * a checkpoint: the script that is started again goes on as if it had not been interrupted.
#
# Once the pad slides, a cycle repeats itself: the force runs round a loop, whose area is the work
# that friction takes out in a cycle,
#
# $$
# \oint F\, \mathrm{d}x = \int_{\text{cycle}} \int_\Gamma -c_t \cdot \dot s .
# $$
#
# ```
# ./container python3 demos/demo_long_history.py --until 1.3   # interrupted here,
# ./container python3 demos/demo_long_history.py               # it goes on there
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

LENGTH, HEIGHT = 40e-3, 10e-3  # m
E, NU, MU = 10e6, 0.3, 0.5  # Pa, -, -
PRESSED, AMPLITUDE, CYCLES = 0.2e-3, 0.5e-3, 3  # m, m, -
# -

# ## The pad


def build() -> tuple[ff.FrictionalContactProblem, ufl.Form, fem.Function]:
    """Return the problem, the stored energy, and the displacement of the top."""
    msh = mesh.create_rectangle(
        MPI.COMM_WORLD, [(0.0, 0.0), (LENGTH, HEIGHT)], [40, 10], mesh.CellType.quadrilateral
    )
    bottom = mesh.locate_entities_boundary(msh, 1, lambda x: np.isclose(x[1], 0.0))
    tags = mesh.meshtags(msh, 1, bottom, np.ones(len(bottom), dtype=np.int32))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    energy = ff.bulk.stored_energy(ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU)), ufl.dx)
    held = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], HEIGHT))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "pad"),
        ff.RigidPlane((0.0, 0.0), (0.0, 1.0)),
        ff.Coulomb(MU),
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(energy, u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(top, held)],
        petsc_options_prefix="history_",
    )
    return problem, energy, top


# ## The path
#
# Loads are a function of time, and of nothing else: so a step can be tried again, and a run be
# resumed. Until time 1 the top goes down, then it goes to and fro.


def place(t: float) -> tuple[float, float]:
    """Return the displacement of the top (m) at a time."""
    return AMPLITUDE * np.sin(2.0 * np.pi * max(t - 1.0, 0.0)), -PRESSED * min(t, 1.0)


def stepper(folder: Path) -> ff.LoadStepper:
    """Return what makes the steps, from the last checkpoint if there is one.

    Steps end at each quarter of a cycle, where the motion turns. The tractions of a step and its
    two halves may differ by 2 %. The checkpoint follows the second half.
    """
    problem, energy, top = build()

    def loads(t: float) -> None:
        top.x.array[:] = np.tile(place(t), len(top.x.array) // 2)

    return ff.LoadStepper(
        problem,
        loads,
        end=1.0 + CYCLES,
        step=0.05,
        largest=0.05,
        error=0.02,
        stops=list(1.0 + np.arange(4 * CYCLES) / 4.0),
        audit=ff.EnergyAudit(problem, energy),
        events=folder / "events.csv",
        results=ff.Results(problem, folder),
        checkpoint=folder / "history.h5",
    )


# ## What came out
#
# All of it is in the folder of the results, whichever run wrote it.


def cycle(table: dict[str, np.ndarray], number: int) -> tuple[float, float]:
    """Return the work at the top in a cycle, and that of friction (J/m)."""
    chosen = (table["time"] >= number) & (table["time"] <= number + 1)
    x = np.array([place(t)[0] for t in table["time"][chosen]])
    force = -table["force_x"][chosen]
    return float(np.trapezoid(force, x)), float(np.sum(table["frictional_work"][chosen][1:]))


def draw(table: dict[str, np.ndarray], folder: Path) -> None:
    """Draw the loop, the states, and the energies since the beginning."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(12.0, 3.6), layout="constrained")
    time = table["time"]
    axes[0].plot([1e3 * place(t)[0] for t in time], -table["force_x"], ".-", ms=4)
    axes[0].set(xlabel="way of the top (mm)", ylabel="friction (N/m)")
    for state, colour in zip(("open", "stick", "slip"), ff.plot.COLOURS, strict=True):
        axes[1].step(time, table[state], where="pre", color=colour, label=state)
    axes[1].set(xlabel="time", ylabel="nodes")
    axes[1].legend()
    labels = {"external_work": "work", "stored": "stored", "dissipation": "friction"}
    for column, label in labels.items():
        axes[2].plot(time, np.cumsum(table[column]), label=label)
    axes[2].plot(time, np.cumsum(table["defect"]), "k--", lw=1.0, label="defect")
    axes[2].set(xlabel="time", ylabel="energy (J/m)")
    axes[2].legend()
    figure.savefig(folder / "history.png", dpi=150)


def main(arguments: Sequence[str] | None = None) -> None:
    """Go on with the path, up to an interrupt or its end."""
    parser = argparse.ArgumentParser(description="A pad is dragged to and fro.")
    parser.add_argument("--output", type=Path, default=Path("results/long_history"))
    parser.add_argument("--until", type=float, default=np.inf, help="interrupt after this time")
    given = parser.parse_args(arguments)
    given.output.mkdir(parents=True, exist_ok=True)
    path, cuts, changes = stepper(given.output), 0, 0
    start = path.time
    for record in path:
        cuts, changes = cuts + len(record.failed), changes + len(record.events)
        if record.time >= given.until:
            break
    if path.problem.comm.rank == 0:
        print(f"From time {start:.3f} to {path.time:.3f}: {path.problem.num_steps} steps since the "
              f"beginning, {cuts} cuts, {changes} nodes changed state")  # fmt: skip
        if path.time < path.end:
            return
        table = ff.plot.table(given.output)
        for number in range(1, CYCLES + 1):
            work, friction = cycle(table, number)
            print(f"Cycle {number}: area of the loop {1e3 * work:.3f} mJ/m, "
                  f"friction {1e3 * friction:.3f} mJ/m")  # fmt: skip
        draw(table, given.output)


if __name__ == "__main__":
    main()
