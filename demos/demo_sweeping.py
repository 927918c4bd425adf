# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # The sweeping test
#
# SPDX-License-Identifier: MIT
#
# A rubber block is pressed on a rubber base, swept over it by its top and swept back (section 4.2
# of the paper). The paper's figure with geometry and data is lost; the ones here are in its spirit:
# a block of 1.0 × 0.5 × 0.5 m on a base of 3.0 × 0.8 × 0.5 m, neo-Hookean, E = 1 Pa, nu = 0.3,
# pressed by 0.15 m until t = 1, swept by 0.25 m until t = 2 and back until t = 3, with mu = 0.2, 1,
# 2, 20.
#
# ```
# ./container python3 demos/demo_sweeping.py
# ./container python3 demos/demo_sweeping.py --mu 0.2 --steps 8
# ```

# +
import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

import matplotlib
import numpy as np
import ufl
from dolfinx import fem

import fenicsx_friction as ff
from deformable_output import draw_configuration, draw_face, write_table

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "meshes"))
import block_on_base as geometry
from from_gmsh import mesh_with_tags

matplotlib.use("Agg")
import matplotlib.pyplot as plt

E, NU, DEPTH, SWEEP = 1.0, 0.3, 0.15, 0.25
#: Times of the pictures: pressed, beginning and end of the sweep, just turned, back.
SHOWN = (1.0, 1.1, 2.0, 2.1, 3.0)
# -


@dataclass
class Model:
    """The block on the base."""

    problem: ff.FrictionalContactProblem
    contact: ff.Contact
    top: fem.Function

    def load(self, time: float) -> None:
        """Press until 1, sweep until 2 and back until 3."""
        way = SWEEP * np.interp(time, [0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 1.0, 0.0])
        down = -DEPTH * min(time, 1.0)
        self.top.x.array[:] = np.tile([way, 0.0, down], len(self.top.x.array) // 3)


# ## The model
#
# The block's lower face is the finer one: its nodes meet the faces of the base.


def build(mu: float, comm: MPI.Intracomm = MPI.COMM_WORLD, refinement: int = 1) -> Model:
    """Mesh the bodies and state the problem."""
    data = mesh_with_tags(lambda: geometry.build(refinement), comm)
    msh, tags, tag = data.mesh, data.facet_tags, geometry.TAGS
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v, top = fem.Function(V, name="u"), ufl.TestFunction(V), fem.Function(V, name="top")
    density = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E, NU))
    held = [fem.locate_dofs_topological(V, 2, tags.find(tag[n])) for n in ("top", "bottom")]
    bcs = [fem.dirichletbc(top, held[0]), fem.dirichletbc(fem.Function(V), held[1])]
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, tag["block contact"], "block"),
        ff.DeformableObstacle(ff.ContactSurface(msh, tags, tag["base contact"], "base")),
        ff.Coulomb(mu),
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=contact,
        bcs=bcs,
        petsc_options_prefix=f"sweep_{mu:g}_",
    )
    return Model(problem, contact, top)


# ## Press, sweep, reverse
#
# The monitored node is the middle of the block's contact face.


def sweep(model: Model, steps: int, output: Path | None = None) -> list[dict[str, float]]:
    """Take the block through the three phases in ``steps`` steps each; return a row a step."""
    rows, fields = [], ff.ContactFields(model.problem)
    stepper = ff.LoadStepper(
        model.problem, model.load, end=3.0, step=1.0 / steps, stops=[t for t in SHOWN if t < 3.0]
    )
    for record in stepper:
        contact = record.report.contacts[0]
        monitored = _displacement_at(model.problem.u, (1.0, 0.4, 0.5))
        rows.append(
            {
                "time": record.time,
                "tangential_N": -contact.force[0],
                "normal_N": contact.force[2],
                "monitored_x_m": monitored[0],
                "monitored_z_m": monitored[2],
                "open": contact.open,
                "stick": contact.stick,
                "slip": contact.slip,
                "iterations": record.report.iterations,
                "cuts": len(record.failed),
                "certificate": record.report.certificate.relative,
            }
        )
        if output is not None and any(np.isclose(record.time, t) for t in SHOWN):
            fields.update()
            picture = output / f"states_{record.time:.1f}.png"
            draw_face(model.contact, fields, f"t = {record.time:.1f}", picture, units=("m", "Pa"))
            draw_configuration(
                model.problem.u,
                output / f"configuration_{record.time:.1f}.png",
                component=0,
                title="u_x (m)",
                limits=(-0.1, SWEEP),
                camera=((1.5, -5.0, 2.2), (1.5, 0.4, 0.45), (0.0, 0.0, 1.0)),
                size=(1000, 500),
            )
    return rows


def _displacement_at(u: fem.Function, place: Sequence[float]) -> np.ndarray:
    """Return the displacement of the block's contact node nearest to a place, on all ranks."""
    V = u.function_space
    x = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
    distance = np.linalg.norm(x - np.asarray(place), axis=1)
    best = int(np.argmin(distance)) if len(x) else -1
    local = (distance[best], tuple(u.x.array.reshape(-1, 3)[best])) if len(x) else (np.inf, ())
    return np.array(min(V.mesh.comm.allgather(local))[1])


# ## Pictures and tables


def draw_histories(results: dict[float, list[dict[str, float]]], path: Path) -> None:
    """Draw reactions and the monitored displacement against time, a line for each mu."""
    figure, axes = plt.subplots(1, 3, figsize=(13.0, 4.0), layout="constrained")
    titles = {
        "normal_N": "normal reaction (N)",
        "tangential_N": "tangential reaction (N)",
        "monitored_z_m": "vertical displacement of the monitored node (m)",
    }
    for mu, rows in results.items():
        for axis, key in zip(axes, titles, strict=True):
            axis.plot([r["time"] for r in rows], [r[key] for r in rows], ".-", label=f"µ = {mu:g}")
    for axis, title in zip(axes, titles.values(), strict=True):
        axis.set_xlabel("t")
        axis.set_title(title, fontsize=10)
        axis.grid(alpha=0.3)
    axes[0].legend()
    figure.savefig(path, dpi=150)
    plt.close(figure)


# +
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the demo."""
    parser = argparse.ArgumentParser(description="The sweeping test")
    parser.add_argument("--mu", type=float, nargs="+", default=[0.2, 1.0, 2.0, 20.0])
    parser.add_argument("--steps", type=int, default=10, help="steps of each phase")
    parser.add_argument("--refinement", type=int, default=1)
    parser.add_argument("--output", type=Path, default=Path("results/sweeping"))
    options = parser.parse_args(arguments)
    root, results = MPI.COMM_WORLD.rank == 0, {}
    for mu in options.mu:
        output = options.output / f"mu{mu:g}"
        output.mkdir(parents=True, exist_ok=True)
        model = build(mu, refinement=options.refinement)
        rows = results[mu] = sweep(model, options.steps, output)
        if root:
            write_table(rows, output / "history.csv")
            turn = min(rows, key=lambda r: abs(r["time"] - 2.0))
            print(
                f"mu {mu:g}: {len(rows)} steps, "
                f"{sum(r['iterations'] for r in rows) / len(rows):.1f} linear solves a step, "
                f"{sum(r['cuts'] for r in rows)} cuts; at the full sweep T "
                f"{turn['tangential_N']:.4f} N, N {turn['normal_N']:.4f} N, stick {turn['stick']}, "
                f"slip {turn['slip']}; certificates <= {max(r['certificate'] for r in rows):.0e}",
                flush=True,
            )
    if root:
        draw_histories(results, options.output / "histories.png")
        print(f"Tables and pictures in {options.output}")


if __name__ == "__main__":
    main()
# -
