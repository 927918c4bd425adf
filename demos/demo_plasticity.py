# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A ball is pressed into metal and withdrawn
#
# SPDX-License-Identifier: MIT
#
# A step of small-strain $J_2$ plasticity with linear hardening has an energy. Let $s$ be the
# deviatoric stress if nothing flowed in the step, $q = \sqrt{3/2}\, |s|$, and $Y + H \alpha$ the
# yield stress before the step. Then $\Delta\alpha = \langle q - Y - H \alpha \rangle / (3 G + H)$
# flows, and per volume
#
# $$
# W = \frac{|s|^2}{4 G} - \frac{3 G + H}{2} \Delta\alpha^2
#     + p\, \mathrm{tr}\, \varepsilon - \frac{p^2}{2 K} .
# $$
#
# The first derivative of $W$ is the stress of the radial return, the second the consistent tangent:
# UFL derives both. The plastic strain and $\alpha$ live at the quadrature points. They are the
# `history` of a `LoadStepper`, which lets `update` change them after a step and puts them back
# where the step is rejected.
#
# The ball of radius $R$ is rigid, the mesh the half-plane of a body of revolution. Hertz's theory
# holds up to first yield, which is on the axis below the surface. In the end the mean pressure is
# about 2.8 times the yield stress at the strain $0.2\, a / R$ (Tabor), $a$ being the radius of
# contact. The withdrawal is elastic. It begins with the slope $2 E^* a$ and leaves an imprint.
#
# ```
# ./container python3 demos/demo_plasticity.py
# ```

# +
import argparse
from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff

E, NU, Y, H = 200e9, 0.3, 200e6, 1e9  # Pa, -, Pa, Pa
R, MU = 10e-3, 0.2  # m, -
MODULUS = E / (1.0 - NU**2)  # E* (Pa)
LARGEST = 60.0  # of E* a / (Y R), fully plastic
WIDEST, DEEPEST = LARGEST * Y * R / MODULUS, 240.0  # radius (m); depth over that of first yield
# -

# ## The material
#
# Plastic flow keeps the volume. So that the cells can do so without locking, the mean stress $p$ is
# an unknown of its own, with one value a cell.


class Metal:
    """The material of a body of revolution, with its history."""

    def __init__(self, u: fem.Function, p: fem.Function) -> None:
        msh = u.function_space.mesh
        rule = {"degree": 2, "scheme": "default"}  # that of ff.bulk.stored_energy for Q1
        self.history = [
            fem.Function(fem.functionspace(msh, basix.ufl.quadrature_element(cell, shape, **rule)))
            for cell, shape in ((msh.basix_cell(), (3, 3)), (msh.basix_cell(), ()))
        ]
        plastic, alpha = self.history
        G, K = E / (2.0 * (1.0 + NU)), E / (3.0 * (1.0 - 2.0 * NU))
        e, hoop = ufl.sym(ufl.grad(u)), u[0] / ufl.SpatialCoordinate(msh)[0]
        strain = ufl.as_matrix([[e[0, 0], e[0, 1], 0], [e[1, 0], e[1, 1], 0], [0, 0, hoop]])
        s = 2.0 * G * ufl.dev(strain - plastic)
        q = ufl.sqrt(1.5 * ufl.inner(s, s) + (1e-9 * Y) ** 2)  # has a derivative at zero
        flow = ufl.max_value(q - Y - H * alpha, 0.0) / (3.0 * G + H)
        shear = ufl.inner(s, s) / (4.0 * G) - (3.0 * G + H) / 2.0 * flow**2
        mean = p * ufl.tr(strain) - p**2 / (2.0 * K)
        self.energy = ff.bulk.stored_energy((shear, mean), ufl.dx, axisymmetric=True)
        spent = ff.bulk.circumference(msh) * (Y * alpha + H / 2.0 * alpha**2)
        self.plastic_work = spent * ufl.dx(degree=2)
        points = plastic.function_space.element.interpolation_points
        self._new = [
            (fem.Function(f.function_space), fem.Expression(value, points))
            for f, value in ((plastic, plastic + flow * 1.5 / q * s), (alpha, alpha + flow))
        ]

    def update(self) -> None:
        """Let the flow of the step become history."""
        for new, expression in self._new:
            new.interpolate(expression)
        for f, (new, _) in zip(self.history, self._new, strict=True):
            f.x.array[:] = new.x.array


# ## The model
#
# Cells grow with the distance from the place where the metal yields first.


def hertz() -> tuple[float, float]:
    """Return the force (N) and the radius of contact (m) at first yield."""
    z = np.linspace(0.1, 1.0, 901)  # below the middle, over the radius of contact
    axial = -1.0 / (1.0 + z**2)
    radial = -(1.0 + NU) * (1.0 - z * np.arctan(1.0 / z)) - 0.5 * axial
    p0 = Y / np.max(abs(axial - radial))
    a = np.pi * p0 * R / (2.0 * MODULUS)
    return 2.0 / 3.0 * p0 * np.pi * a**2, a


def half_plane(first: float, growth: float) -> mesh.Mesh:
    """Return a mesh whose cells grow from a first size (m), faster beyond the contact."""
    places = [0.0]
    while places[-1] < 20.0 * WIDEST:
        near = min(places[-1], 1.2 * WIDEST)
        places.append(places[-1] + first + growth * near + 0.2 * (places[-1] - near))
    n = len(places) - 1
    corners = [(0.0, -1.0), (1.0, 0.0)]
    msh = mesh.create_rectangle(MPI.COMM_WORLD, corners, [n, n], mesh.CellType.quadrilateral)
    x = msh.geometry.x
    x[:, :2] = np.copysign(np.interp(abs(x[:, :2]), np.arange(n + 1) / n, places), (1.0, -1.0))
    return msh


def build(cells: float) -> tuple[ff.FrictionalContactProblem, Metal, ff.RigidMotion]:
    """Return the problem, its material, and the motion of the ball.

    Args:
        cells: Number of cells on the radius of contact at first yield.
    """
    msh = half_plane(hertz()[1] / cells, 0.12 / cells)
    places = (lambda x: x[1] < -19.0 * WIDEST, lambda x: x[0] == 0.0, lambda x: x[1] == 0.0)
    bottom, axis, top = (mesh.locate_entities_boundary(msh, 1, place) for place in places)
    V, P = fem.functionspace(msh, ("Lagrange", 1, (2,))), fem.functionspace(msh, ("DG", 0))
    u, p = fem.Function(V), fem.Function(P)
    metal = Metal(u, p)
    tags = mesh.meshtags(msh, 1, top, np.ones(len(top), dtype=np.int32))
    motion = ff.RigidMotion(msh)
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "metal", axisymmetric=True),
        ff.RigidSphere((0.0, R), R, motion=motion),
        ff.Coulomb(MU),
    )
    zero = fem.Constant(msh, 0.0)
    problem = ff.FrictionalContactProblem(
        [ufl.derivative(metal.energy, w) for w in (u, p)],
        [u, p],
        contact=contact,
        bcs=[
            fem.dirichletbc(zero, fem.locate_dofs_topological(V.sub(i), 1, side), V.sub(i))
            for i, side in ((0, axis), (1, bottom))
        ],
        petsc_options_prefix="plastic_",
    )
    return problem, metal, motion


# ## Press and withdraw


def depth(t: float) -> float:
    """Return the depth of the ball (m); it is withdrawn from time 1 on."""
    deep = 0.5 * (2.0 * DEEPEST) ** t if t < 1.0 else DEEPEST * (1.0 - 0.3 * (t - 1.0) ** 2)
    return deep * hertz()[1] ** 2 / R


def run(results: ff.Results, metal: Metal, motion: ff.RigidMotion) -> np.ndarray:
    """Return depth (m), force (N), radius of contact (m) and largest flow of the steps, in rows."""
    problem = results.problem
    (contact,) = problem.contacts

    def loads(t: float) -> None:
        motion.translation.value[1] = -depth(t)

    stepper = ff.LoadStepper(
        problem,
        loads,
        end=2.0,
        step=1.0 / 32.0,
        stops=[1.0],
        history=metal.history,
        update=metal.update,
        results=results,
    )
    columns = []
    for record in stepper:
        nodal, flowed = contact.nodal(), np.max(metal.history[1].x.array, initial=0.0)
        area = problem.comm.allreduce(np.sum(nodal.area[nodal.states() != ff.OPEN]))
        force, a = -record.report.contacts[0].force[1], np.sqrt(area / np.pi)
        columns.append((depth(record.time), force, a, problem.comm.allreduce(flowed, MPI.MAX)))
    return np.array(columns).T


# ## Results


def draw(folder: Path, way: np.ndarray, force: np.ndarray, a: np.ndarray) -> None:
    """Draw the mean pressure over the size of contact, the force, the imprint."""
    import matplotlib.pyplot as plt
    from matplotlib.collections import PolyCollection

    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
    pressed = slice(np.argmax(way) + 1)
    pressure = force[pressed] / (np.pi * a[pressed] ** 2)
    left.semilogx(MODULUS * a[pressed] / (Y * R), pressure / Y, "o", ms=4, label="steps")
    elastic, plastic = np.array([1.0, 6.0]), np.array([20.0, LARGEST])
    left.semilogx(elastic, 4.0 / (3.0 * np.pi) * elastic, "--", color="0.4", label="Hertz")
    tabor = 2.8 * (1.0 + H * 0.2 * plastic / MODULUS)
    left.semilogx(plastic, tabor, color="tab:red", label="Tabor")
    left.set(xlabel="E* a / (Y R)", ylabel="mean pressure / Y")
    left.legend()
    middle.plot(1e6 * way, force, ".-")
    middle.set(xlabel="depth of the ball (µm)", ylabel="force (N)")
    grid = ff.plot.fields(folder)
    corners = (grid.points + grid["displacement"])[grid.cells.reshape(-1, 5)[:, 1:], :2]
    cells = PolyCollection(1e3 * corners, array=grid["alpha"], edgecolor="0.3", linewidth=0.1)
    figure.colorbar(right.add_collection(cells), label=r"plastic strain $\alpha$")
    right.set(xlabel="r (mm)", ylabel="z (mm)", aspect="equal")
    right.set(xlim=(0.0, 2.4e3 * WIDEST), ylim=(-2.2e3 * WIDEST, 0.1e3 * WIDEST))
    figure.savefig(folder / "indentation.png", dpi=150)


def main(arguments: Sequence[str] | None = None) -> None:
    """Press, withdraw, compare with closed forms, and draw."""
    parser = argparse.ArgumentParser(description="A ball is pressed into metal and withdrawn.")
    parser.add_argument("--output", type=Path, default=Path("results/plasticity"))
    parser.add_argument("--cells", type=float, default=4.0, help="on the first radius of contact")
    given = parser.parse_args(arguments)
    problem, metal, motion = build(given.cells)
    results = ff.Results(problem, given.output, fields={"alpha": metal.history[1]})
    way, force, a, flowed = run(results, metal, motion)

    last, first = int(np.argmax(way)), int(np.argmax(flowed > 0.0))
    end = slice(last - 4, last + 1)  # the radius of contact grows by whole cells
    tabor = np.mean(force[end] / (np.pi * a[end] ** 2) / (Y + H * 0.2 * a[end] / R))
    slope = (force[last + 1] - force[last]) / (way[last + 1] - way[last])
    work = np.trapezoid(np.append(0.0, force), np.append(0.0, way))
    forms = [fem.assemble_scalar(fem.form(f)) for f in (metal.plastic_work, metal.energy)]
    plastic, elastic = problem.comm.allreduce(np.array(forms))
    left = problem.comm.allreduce(np.min(problem.u.x.array[1::2], initial=0.0), MPI.MIN)
    if problem.comm.rank == 0:
        friction = np.sum(ff.plot.table(given.output)["frictional_work"])
        below, above = force[first - 1 : first + 1] / hertz()[0]
        print(f"First flow between {below:.2f} and {above:.2f} of Hertz' force")
        print(f"Mean pressure over yield stress {tabor:.2f}")
        print(f"Slope of the withdrawal over 2 E* a {slope / (2.0 * MODULUS * a[last]):.3f}")
        print(f"Imprint {-1e6 * left:.2f} of {1e6 * way[last]:.2f} µm")
        print(f"Work {1e3 * work:.3f} mJ, plastic {plastic / work:.4f}, friction "
              f"{friction / work:.4f}, still elastic {elastic / work:.4f}")  # fmt: skip
        draw(given.output, way, force, a)


if __name__ == "__main__":
    main()
