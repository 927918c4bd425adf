# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Shrink fit and pull-out
#
# SPDX-License-Identifier: MIT
#
# A hub is shrunk on a hollow shaft, then the shaft is pulled out. Both are bodies of revolution:
# the mesh is a half-plane, forces are those of full rings. The bodies are meshed apart, with the
# same radius; the interference $\delta$ is a `clearance` that is made smaller step by step. Far
# from the ends of the hub the pressure is Lamé's,
#
# $$
# p = \frac{\delta}{a} \left[ \frac{1}{E} \left( \frac{b^2 + a^2}{b^2 - a^2}
#     + \frac{a^2 + c^2}{a^2 - c^2} \right) \right]^{-1},
# $$
#
# with the radii $c < a < b$ of bore, fit and hub. Both are held at one end while they are joined,
# so that friction locks a force in. While the shaft is pulled, slip spreads from one end of the
# hub to the other; then the force stays, at $\mu$ times the integral of the pressure.
#
# ```
# ./container python3 demos/demo_shrink_fit.py
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

BORE, FIT, OUTER = 0.01, 0.02, 0.04  # m
SHAFT, HUB = (-0.03, 0.07), (0.0, 0.04)  # m, along the axis
E, NU, MU, INTERFERENCE, PULL = 210e9, 0.3, 0.2, 20e-6, 60e-6  # Pa, -, -, m, m
# -

# ## Two bodies in one mesh
#
# Each body is a rectangle with named sides; `join_meshes` keeps the names.


def ring(radii: tuple[float, float], ends: tuple[float, float], size: float) -> ff.NamedMesh:
    """Return the half-plane of a ring, with names for its sides."""
    numbers = [round(np.ptp(side) / size) for side in (radii, ends)]
    corners = [(r, z) for r, z in zip(radii, ends, strict=True)]
    msh = mesh.create_rectangle(MPI.COMM_WORLD, corners, numbers, mesh.CellType.quadrilateral)
    places = [(0, radii[0]), (0, radii[1]), (1, ends[0]), (1, ends[1])]
    sides = [
        mesh.locate_entities_boundary(msh, 1, lambda x, i=i, at=at: np.isclose(x[i], at))
        for i, at in places
    ]
    tags = np.repeat(np.arange(1, 5, dtype=np.int32), [len(side) for side in sides])
    facets, first = np.unique(np.concatenate(sides), return_index=True)
    names = {name: (1, (k,)) for k, name in enumerate(("inside", "outside", "low", "high"), 1)}
    return ff.NamedMesh(msh, None, mesh.meshtags(msh, 1, facets, tags[first]), names)


def build(
    size: float,
) -> tuple[ff.FrictionalContactProblem, fem.Constant, fem.Constant]:
    """Return the problem, the clearance, and the displacement of the shaft's end."""
    shaft, hub = ring((BORE, FIT), SHAFT, size), ring((FIT, OUTER), HUB, size)
    model = ff.join_meshes({"shaft": shaft, "hub": hub})
    V = fem.functionspace(model.mesh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU), axisymmetric=True)
    energy = ff.bulk.stored_energy(density, ufl.dx, axisymmetric=True)
    clearance, pulled = fem.Constant(model.mesh, 0.0), fem.Constant(model.mesh, 0.0)
    ends = [model.facets(name) for name in ("hub/high", "shaft/high")]
    dofs = [fem.locate_dofs_topological(V.sub(1), 1, facets) for facets in ends]
    held = fem.dirichletbc(fem.Constant(model.mesh, 0.0), dofs[0], V.sub(1))
    drawn = fem.dirichletbc(pulled, dofs[1], V.sub(1))
    contact = ff.Contact(
        model.surface("hub/inside", axisymmetric=True),
        ff.DeformableObstacle(
            model.surface("shaft/outside", axisymmetric=True), clearance=clearance
        ),
        ff.Coulomb(MU),
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(energy, u, v),
        u,
        contact=contact,
        bcs=[held, drawn],
        petsc_options_prefix="shrink_",
    )
    return problem, clearance, pulled


# ## Shrink, then pull


def lame() -> float:
    """Return the pressure (Pa) of a long fit."""
    hub = (OUTER**2 + FIT**2) / (OUTER**2 - FIT**2)
    shaft = (FIT**2 + BORE**2) / (FIT**2 - BORE**2)
    return E * INTERFERENCE / FIT / (hub + shaft)


def main(arguments: Sequence[str] | None = None) -> None:
    """Shrink, pull, and draw."""
    parser = argparse.ArgumentParser(description="A hub is shrunk on a shaft, which is pulled.")
    parser.add_argument("--output", type=Path, default=Path("results/shrink_fit"))
    parser.add_argument("--size", type=float, default=1e-3, help="of the cells (m)")
    given = parser.parse_args(arguments)
    problem, clearance, pulled = build(given.size)
    results = ff.Results(problem, given.output)
    for k in range(1, 5):
        clearance.value = -INTERFERENCE * k / 4.0
        results.write(k / 4.0, problem.solve())
    (contact,) = problem.contacts
    z, pressure = contact.surface.x[:, 1], contact.nodal().c[:, 0]
    middle = pressure[abs(z - np.mean(HUB)) < 0.3 * np.ptp(HUB)]
    for k in range(1, 13):
        pulled.value = PULL * k / 12.0
        report = problem.solve()
        results.write(1.0 + k / 12.0, report)
    nodal = contact.nodal()
    sums = [np.sum(middle), len(middle), np.sum(nodal.area * nodal.c[:, 0])]
    total, count, normal = problem.comm.allreduce(np.array(sums))
    if problem.comm.rank == 0:
        print(f"Pressure in the middle {total / count / 1e6:.1f} MPa, Lamé {lame() / 1e6:.1f} MPa")
        force = report.contacts[0].force[1]
        print(f"Pulled out by {force / 1e3:.2f} kN = {force / normal:.4f} of the normal force")
        line = ff.plot.contact_line(given.output, "hub/inside", 3)
        line.axhline(lame(), color="tab:green", linestyle=":", label="Lamé")
        line.legend()
        line.figure.savefig(given.output / "pressure.png", dpi=150)
        axial = ff.plot.curve(given.output, "force_y", lambda t: 1e3 * PULL * max(t - 1.0, 0.0))
        axial.set(xlabel="way of the shaft (mm)", ylabel="axial force on the hub (N)")
        axial.figure.savefig(given.output / "pull_out.png", dpi=150)


if __name__ == "__main__":
    main()
