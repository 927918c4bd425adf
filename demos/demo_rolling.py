# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A driven wheel: rolling, and spinning above the limit
#
# SPDX-License-Identifier: MIT
#
# A rigid wheel of radius $R$ carries an axle load $P$ on an elastic ground. It is a `RigidBody`:
# its motion is an unknown, found with the displacement of the ground. First it rolls freely: it is
# moved along, and turns by itself, by nearly $x / R$, without a moment. Then it is held at its axle
# and driven by a growing moment $M$. Friction holds it, with tractions that slip first at the ends
# of the contact, until they are $\mu$ times the pressure everywhere: $M = \mu P R$, as all of them
# have the arm $R$. Above that nothing balances the moment: the step fails, and says so.
#
# ```
# ./container python3 demos/demo_rolling.py
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

R, P, MU = 0.3, 20e3, 0.4  # m, N per metre of width, -
E, NU = 10e6, 0.4  # Pa, of the ground: rubber
ROLLED, STEPS = 0.04, 8  # m
# -

# ## The model
#
# The cells of the ground are smaller towards the contact. Everything that is special stands in
# three lines: the body, the obstacle that it moves, and the contact.


def build(refinement: int = 1) -> tuple[ff.FrictionalContactProblem, ff.RigidBody]:
    """Return the problem, and the wheel, which touches the ground."""
    msh = mesh.create_rectangle(
        MPI.COMM_WORLD,
        [(-1.0, -1.0), (1.0, 0.0)],
        [96 * refinement, 24 * refinement],
        mesh.CellType.quadrilateral,
    )
    x = msh.geometry.x
    x[:, 0] = 0.3 * np.sign(x[:, 0]) * abs(x[:, 0]) ** 2.5 + 0.1 * x[:, 0]
    x[:, 1] *= 0.3 * abs(x[:, 1])
    top = mesh.locate_entities_boundary(msh, 1, lambda x: np.isclose(x[1], 0.0))
    tags = mesh.meshtags(msh, 1, np.sort(top), np.ones(len(top), dtype=np.int32))

    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    energy = ff.bulk.stored_energy(ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU)), ufl.dx)
    bottom = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], -0.3))

    wheel = ff.RigidBody(msh, center=(0.0, R), name="wheel")
    tread = ff.RigidSphere((0.0, R), R, motion=wheel)
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1, "ground"), tread, ff.Coulomb(MU))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(energy, u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(np.zeros(2), bottom, V)],
        petsc_options_prefix="rolling_",
        settings=ff.StepSettings(fallbacks=1),  # of a wheel that spins there is nothing to find
    )
    wheel.given.value[1] = -1e-3  # into contact; then the load takes over
    problem.solve()
    wheel.free = ("y", "rz")
    wheel.force.value[:] = (0.0, -P)
    return problem, wheel


# ## Rolling, then driving


def roll(results: ff.Results) -> ff.BodyReport:
    """Roll the wheel along; return where it is then."""
    problem = results.problem
    (wheel,) = problem.bodies
    results.write(0.0, problem.solve())
    for k in range(1, STEPS + 1):
        wheel.given.value[0] = ROLLED * k / STEPS
        report = problem.solve()
        results.write(float(k), report)
    return report.bodies[0]


def drive(results: ff.Results) -> float:
    """Drive the wheel until it spins; return the moment (N m/m) that it stood."""
    problem = results.problem
    (wheel,) = problem.bodies
    report = None
    for share in (0.25, 0.5, 0.75, 0.9, 0.95, 0.98, 1.02):
        wheel.moment.value[:] = share * MU * P * R
        try:
            report = problem.solve()
        except ff.StepFailed as failure:
            told = [line for line in str(failure).splitlines() if "Rigid body" in line]
            if problem.comm.rank == 0:
                print(f"At {share:.2f} mu P R the wheel spins. {' '.join(told)}")
            break
        results.write(STEPS + 1.0 + share, report)
    assert report is not None
    return -report.bodies[0].moment[0]


# ## The pictures


def draw(folder: Path) -> None:
    """Draw the ground below the driven wheel: tractions, and the deformed body."""
    line = ff.plot.contact_line(folder, "ground")
    line.set_xlim(-0.06 + ROLLED, 0.06 + ROLLED)
    line.set_title("Driven wheel, shortly before it spins")
    line.figure.savefig(folder / "tractions.png", dpi=150)
    ff.plot.deformed(folder, factor=5.0, file=folder / "ground.png").close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Roll, drive, and draw."""
    parser = argparse.ArgumentParser(description="A driven wheel on elastic ground.")
    parser.add_argument("--output", type=Path, default=Path("results/rolling"))
    parser.add_argument("--refinement", type=int, default=1)
    given = parser.parse_args(arguments)
    problem, _ = build(given.refinement)
    results = ff.Results(problem, given.output)
    rolled = roll(results)
    moment = drive(results)
    if problem.comm.rank == 0:
        x, angle = rolled.translation[0], rolled.rotation[0]
        print(f"Rolled {x:.3f} m: turned by {angle:.4f} rad, -x/R = {-x / R:.4f} rad; "
              f"horizontal force {rolled.force[0]:.1f} N/m")  # fmt: skip
        print(f"Driven: stood {moment:.0f} N m/m of mu P R = {MU * P * R:.0f} N m/m")
        draw(given.output)


if __name__ == "__main__":
    main()
