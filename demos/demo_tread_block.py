# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A tread block of a tyre brakes on the road
#
# SPDX-License-Identifier: MIT
#
# A block of tread rubber, 24 × 20 × 9 mm with two sipes (slits of 1 mm, 4 mm deep), is pressed on a
# rigid road and dragged by its top, as a tyre does that brakes. Its three lamellae bend, lean on
# their leading edges and lift behind. Their rims slip first, in the end all does.
#
# Neo-Hookean rubber, E = 6 MPa, nu = 0.45, friction 0.3 (a wet road); forces in N, lengths in mm.
# The sipes do not close: the demo measures how wide they stay.
#
# The size of the model is what it shows: with three cells a millimetre it has 360 000
# displacements, and is solved with multigrid (docs/scaling.md).
#
# ```
# ./container python3 demos/demo_tread_block.py                      # one cell a mm, 20 s
# ./container python3 demos/demo_tread_block.py --cells 3 --steps 6  # docs/scaling.md, 8 minutes
# ./container mpirun -n 2 python3 demos/demo_tread_block.py --cells 3 --steps 6
# ```

# +
import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

import matplotlib
import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from deformable_output import Row, draw_configuration, draw_face, write_table

matplotlib.use("Agg")
import matplotlib.pyplot as plt

#: Length (the way the road goes), width and height (mm), and where the sipes are.
SIZE, SIPES, DEPTH = (24.0, 20.0, 9.0), ((7.0, 8.0), (16.0, 17.0)), 4.0
E, NU, MU = 6.0, 0.45, 0.3
#: How far the top goes down until time 1 (mm), and along until time 2.
DOWN, ALONG = 0.5, 1.5
#: Times of the pictures: pressed, braking, sliding.
SHOWN = (1.0, 1.5, 2.0)
# -


@dataclass
class Model:
    """The block on the road."""

    problem: ff.FrictionalContactProblem
    contact: ff.Contact
    top: fem.Function

    def load(self, now: float) -> None:
        """Press until 1, brake until 2."""
        place = ALONG * max(now - 1.0, 0.0), 0.0, -DOWN * min(now, 1.0)
        self.top.x.array[:] = np.tile(place, len(self.top.x.array) // 3)


# ## The mesh
#
# A box of hexahedra, without those in the sipes.


def block(cells: int, comm: MPI.Intracomm) -> tuple[mesh.Mesh, mesh.MeshTags]:
    """Return the mesh, and tags of its tread (1) and top (2)."""
    n = [round(cells * length) for length in SIZE]
    box = mesh.create_box(comm, [[0.0] * 3, SIZE], n, mesh.CellType.hexahedron)
    own = np.arange(box.topology.index_map(3).size_local, dtype=np.int32)
    x, _, z = mesh.compute_midpoints(box, 3, own).T
    in_sipe = np.any([(low < x) & (x < high) for low, high in SIPES], axis=0) & (z < DEPTH)
    msh = mesh.create_submesh(box, 3, own[~in_sipe])[0]
    msh.topology.create_connectivity(2, 3)
    faces = [
        mesh.locate_entities_boundary(msh, 2, lambda x, at=at: np.isclose(x[2], at))
        for at in (0.0, SIZE[2])
    ]
    values = np.repeat(np.array([1, 2], dtype=np.int32), [len(f) for f in faces])
    order = np.argsort(np.concatenate(faces))
    return msh, mesh.meshtags(msh, 2, np.concatenate(faces)[order], values[order])


def build(cells: int, comm: MPI.Intracomm = MPI.COMM_WORLD) -> Model:
    """State the problem."""
    msh, tags = block(cells, comm)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v, top = fem.Function(V, name="u"), ufl.TestFunction(V), fem.Function(V, name="top")
    density = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E, NU))
    energy = ff.bulk.stored_energy(density, ufl.dx, bbar=True)
    road = ff.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1, "tread"), road, ff.Coulomb(MU))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(energy, u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(top, fem.locate_dofs_topological(V, 2, tags.find(2)))],
        petsc_options_prefix="tread_",
        settings=ff.StepSettings(fallbacks=0),  # smaller steps are cheaper than other tries
    )
    return Model(problem, contact, top)


# ## Press and brake


def brake(model: Model, steps: int, output: Path) -> list[Row]:
    """Press, then brake, in as many steps each; return a row a step."""
    rows, fields = [], ff.ContactFields(model.problem)
    stepper = ff.LoadStepper(model.problem, model.load, end=2.0, step=1.0 / steps, stops=SHOWN[:-1])
    start = time.process_time()
    for record in stepper:
        report, totals = record.report, record.report.contacts[0]
        spent, start = time.process_time() - start, time.process_time()
        rows.append(
            {
                "time": record.time,
                "along_mm": ALONG * max(record.time - 1.0, 0.0),
                "normal_N": totals.force[2],
                "braking_N": -totals.force[0],
                "open": totals.open,
                "stick": totals.stick,
                "slip": totals.slip,
                "narrowest_sipe_mm": narrowest_sipe(model.problem.u),
                "newton": report.iterations,
                "krylov": report.krylov,
                "set_ups": report.set_ups,
                "cuts": len(record.failed),
                "certificate": report.certificate.relative,
                "cpu_s": spent,
            }
        )
        if any(np.isclose(record.time, t) for t in SHOWN):
            fields.update()
            draw(model, fields, record.time, output)
        if model.problem.comm.rank == 0:
            told = ("time", "normal_N", "braking_N", "open", "stick", "slip", "newton", "krylov")
            print(", ".join(f"{k} {rows[-1][k]:.5g}" for k in told), f"{spent:.1f} s", flush=True)
    return rows


def narrowest_sipe(u: fem.Function) -> float:
    """Return the smallest distance of two opposite nodes of the sipes (mm), on all ranks."""
    V = u.function_space
    n = V.dofmap.index_map.size_local
    places, values = V.tabulate_dof_coordinates()[:n], u.x.array.reshape(-1, 3)[:n]
    widths = []
    for sides in SIPES:
        moved = []
        for side in sides:
            wall = np.isclose(places[:, 0], side) & (places[:, 2] < DEPTH - 1e-6)
            parts = V.mesh.comm.allgather((places[wall], (places + values)[wall, 0]))
            x, now = (np.concatenate(p) for p in zip(*parts, strict=True))
            moved.append(now[np.lexsort(np.round(x[:, 1:], 6).T)])
        widths.append(np.min(moved[1] - moved[0]))
    return float(min(widths))


# ## Pictures and tables


def draw(model: Model, fields: ff.ContactFields, now: float, output: Path) -> None:
    """Draw the block, and the states and pressures of its tread, at a time."""
    title = f"braked by {ALONG * max(now - 1.0, 0.0):.1f} mm"
    picture = output / f"tread_{now:.1f}.png"
    draw_face(model.contact, fields, title, picture, units=("mm", "MPa"))
    draw_configuration(
        model.problem.u,
        output / f"block_{now:.1f}.png",
        component=0,
        title="u_x (mm)",
        limits=(0.0, ALONG),
        camera=((-12.0, -36.0, 10.0), (14.5, 8.0, 3.5), (0.0, 0.0, 1.0)),
        size=(1000, 520),
    )


def draw_history(rows: list[Row], path: Path) -> None:
    """Draw the force of braking, and how many nodes slip, against the way."""
    braking = [r for r in rows if r["time"] >= 1.0]
    way = [r["along_mm"] for r in braking]
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
    left.plot(way, [r["braking_N"] / r["normal_N"] for r in braking], ".-")
    left.axhline(MU, color="grey", linestyle="--", label="coefficient of friction")
    left.set_ylabel("braking force / normal force")
    left.legend(loc="lower right")
    for state in ("open", "stick", "slip"):
        right.plot(way, [r[state] for r in braking], ".-", label=state)
    right.set_ylabel("nodes of the tread")
    right.legend()
    for axis in (left, right):
        axis.set_xlabel("way of the top (mm)")
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=150)
    plt.close(figure)


# +
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the demo."""
    parser = argparse.ArgumentParser(description="A tread block brakes")
    parser.add_argument("--cells", type=int, default=1, help="cells a millimetre")
    parser.add_argument("--steps", type=int, default=8, help="steps of pressing, and of braking")
    parser.add_argument("--output", type=Path, default=Path("results/tread_block"))
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    model = build(options.cells)
    V = model.problem.u.function_space
    dofs = V.dofmap.index_map.size_global * V.dofmap.index_map_bs
    if V.mesh.comm.rank == 0:
        print(f"{dofs} displacements", flush=True)
    rows = brake(model, options.steps, options.output)
    if V.mesh.comm.rank == 0:
        write_table(rows, options.output / "history.csv")
        draw_history(rows, options.output / "history.png")
        print(
            f"{len(rows)} steps, {sum(r['cuts'] for r in rows):.0f} cuts, sipes at least "
            f"{min(r['narrowest_sipe_mm'] for r in rows):.2f} mm wide, certificates <= "
            f"{max(r['certificate'] for r in rows):.0e}. Tables and pictures in {options.output}"
        )


if __name__ == "__main__":
    main()
# -
