# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A block that lifts, slips and sticks: Raous' rectangle
#
# SPDX-License-Identifier: MIT
#
# An elastic block of 80 mm × 40 mm rests on a rigid base with dry friction. Pressure on its two
# flanks and on its top pushes the flanks inwards and the block onto the base. Next to the flank
# the block lifts off, farther inside it slips, and near the middle it sticks. The test is due to
# Raous, Chabrand and Lebon (1988); it is a benchmark of the French GRECO group and of code_aster
# (SSNV128), and the first example of
#
# > P. Areias, F. Queirós de Melo, J. Carrilho Lopes, *Combined sticking: a new approach for
# > finite-amplitude Coulomb frictional contact*, Int. J. Mech. Mater. Des. (2019), section 4.1,
#
# whose equation numbers are used below. The demo
#
# 1. states the problem and its discrete equations,
# 2. builds it in DOLFINx: an ordinary UFL residual, and one `Contact` beside it,
# 3. solves a load history with a *stick predictor* and a *slip corrector*, certifies each
#    increment, and compares it with the exact discrete solution,
# 4. writes tables, ParaView fields, and the paper's figures 2, 3, 5, 6 and 7.
#
# ```
# ./container python3 demos/demo_raous_rectangle.py --help
# ./container python3 demos/demo_raous_rectangle.py
# ./container mpirun -n 2 python3 demos/demo_raous_rectangle.py --steps 4
# ```
#
# ## The problem
#
# By symmetry half of the block is enough: $\Omega = (0, L)^2$ with $L = 40$ mm, plane strain,
# $E = 130$ GPa, $\nu = 0.2$, and
#
# $$
# \nabla\cdot\sigma(u) = 0 \text{ in } \Omega, \qquad
# \sigma n = (p_\mathrm{lateral}, 0) \text{ on } x = 0, \qquad
# \sigma n = (0, -p_\mathrm{top}) \text{ on } y = L, \qquad
# u_x = 0 \text{ on } x = L,
# $$
#
# with $p_\mathrm{lateral} = 150$ MPa and $p_\mathrm{top} = 50$ MPa. On the base $y = 0$ let
# $g = u_y$ be the gap, and $c = (c_n, c_t)$ the traction of the base *on the body*: $c_n \ge 0$
# in compression, $c_t$ along $+x$. In terms of stress, $\sigma_n = \sigma_{yy} = -c_n$ and
# $\sigma_t = \sigma_{xy} = -c_t$; the base resists a push along $+x$, so that $c_t < 0$ and
# $\sigma_t > 0$ here. The laws of Signorini and Coulomb, eqs. (3)-(5), are, with $\mu = 1$,
#
# $$
# g \ge 0, \quad c_n \ge 0, \quad g\, c_n = 0, \qquad
# |c_t| \le \mu c_n, \quad
# \mu c_n\, \Delta u_t + |\Delta u_t|\, c_t = 0 ,
# $$
#
# where $\Delta u_t$ is the slip of the increment. Friction depends on the history: the increments
# matter, their speed does not.

# +
import sys
from collections.abc import Sequence
from typing import NamedTuple

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, mesh

import raous_figures as figures
import raous_results as results
import raous_terminal as terminal
from fenicsx_friction import (
    Contact,
    ContactSurface,
    Coulomb,
    FrictionalContactProblem,
    Results,
    RigidPlane,
    StepFailed,
    StepSettings,
    bulk,
)
from raous_exact import Exact
from raous_options import LENGTH, Options, parse_options

BASE, FLANK, TOP, SYMMETRY = 1, 2, 3, 4
# -

# ## Mesh and tags
#
# The paper's 512 quadrilaterals are taken to be 32 × 16, so that its points A to E are nodes.


def create_block(comm: MPI.Intracomm, nx: int, ny: int) -> tuple[mesh.Mesh, mesh.MeshTags]:
    """Return the mesh of the half block and the tags of its four sides."""
    msh = mesh.create_rectangle(
        comm,
        [np.zeros(2), np.full(2, LENGTH)],
        [nx, ny],
        cell_type=mesh.CellType.quadrilateral,
    )
    fdim = msh.topology.dim - 1
    sides = {
        BASE: lambda x: np.isclose(x[1], 0.0),
        FLANK: lambda x: np.isclose(x[0], 0.0),
        TOP: lambda x: np.isclose(x[1], LENGTH),
        SYMMETRY: lambda x: np.isclose(x[0], LENGTH),
    }
    facets = {tag: mesh.locate_entities_boundary(msh, fdim, on) for tag, on in sides.items()}
    entities = np.concatenate(list(facets.values()))
    values = np.concatenate([np.full(len(f), tag, np.int32) for tag, f in facets.items()])
    order = np.argsort(entities)
    return msh, mesh.meshtags(msh, fdim, entities[order], values[order])


# ## Forms
#
# The bulk is any UFL residual in $u$; here it is the derivative of the elastic energy
#
# $$
# \Psi(u) = \int_\Omega G\, \bigl(\varepsilon:\varepsilon - \tfrac13 (\mathrm{tr}\,\varepsilon)^2
# \bigr)\,dx + \int_{\bar\Omega} \tfrac K2 (\mathrm{tr}\,\varepsilon)^2\,dx
# $$
#
# less the work of the pressures. $\bar\Omega$ stands for one integration point a cell, which on
# rectangles is the B-bar element of the paper (Simo, Taylor and Pister, 1985); with
# `--element q1` it has four points like the first term.
#
# ## Contact
#
# Contact is collocated: one equation for $c_n$ and one for $c_t$ at each node of the base. Inside
# a step the package solves, with Newton's method on $(u, c)$ and equilibrium in each,
#
# * the **stick predictor** (14): $\Delta u_t = 0$ at nodes in contact, and the smoothed
#   complementarity $\langle r_p g - c_n\rangle_\varepsilon = r_p g$, whose ramp (13)
#   $\langle x\rangle_\varepsilon = x + \tfrac1\alpha\log(1 + e^{-\alpha x})$,
#   $\alpha = \log 2/\varepsilon$, tends to $\max(x, 0)$ (figures 2 and 3);
# * with `--corrector ramp` the **slip corrector** (15):
#   $c_t |w| + \mu c_n w = 0$ with $w = (1-\xi)\,\Delta u_t \mp \xi V_0\, c^s_t/|c^s_t|$, eq. (12),
#   $c^s$ being the stick traction and $\xi$ going from 1 to 0 (figure 7). The paper prints `+`; the
#   package takes `-`, with which $\xi = 1$ is the radial return of the stick force;
# * the **natural map** $c_t = P_{\mu c_n}(c_t - r_p\,\Delta u_t)$ and
#   $c_n = \max(c_n - r_p g, 0)$, with the projection $P$ on the friction interval. It contains
#   neither $\varepsilon$ nor $\xi$ and holds if and only if the laws above hold.
#
# By default (`--corrector projection`) the natural map follows the predictor at once. Whatever the
# corrector, an increment is accepted only if its **certificate**, the residuals of natural map and
# equilibrium in plain NumPy, is below $10^{-9}$ of the largest traction and force.
#
# The node $(L, 0)$ belongs to the base and to the symmetry plane. As its $u_x$ is prescribed, its
# $c_t$ would have no work to do: the package finds this from the boundary condition and sets
# $c_t = 0$ there; the reaction of the symmetry plane carries the force.


class Block(NamedTuple):
    """The contact problem and the constants that load it."""

    problem: FrictionalContactProblem
    lateral: fem.Constant
    top: fem.Constant

    def load(self, options: Options, factors: tuple[float, float]) -> None:
        """Set the pressures of an increment."""
        self.lateral.value, self.top.value = options.pressures(factors)


def create_problem(
    comm: MPI.Intracomm, options: Options, prefix: str, settings: StepSettings | None = None
) -> Block:
    """Return the frictional contact problem of the block, unloaded."""
    msh, tags = create_block(comm, options.nx, options.ny)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V, name="displacement"), ufl.TestFunction(V)

    lateral = fem.Constant(msh, default_scalar_type(0.0))
    top = fem.Constant(msh, default_scalar_type(0.0))
    ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
    density = bulk.small_strain_energy(u, bulk.Elastic(options.E, options.nu))
    energy = bulk.stored_energy(density, ufl.Measure("dx", msh), bbar=options.element == "bbar")
    F = ufl.derivative(energy, u, v) - lateral * v[0] * ds(FLANK) + top * v[1] * ds(TOP)

    V_x = V.sub(0)
    dofs = fem.locate_dofs_topological(V_x, msh.topology.dim - 1, tags.find(SYMMETRY))
    bcs = [fem.dirichletbc(default_scalar_type(0.0), dofs, V_x)]

    base = ContactSurface(msh, tags, BASE, name="base")
    plane = RigidPlane(point=(0.0, 0.0), normal=(0.0, 1.0))
    problem = FrictionalContactProblem(
        F,
        u,
        contact=Contact(base, plane, Coulomb(options.mu)),
        bcs=bcs,
        petsc_options_prefix=prefix,
        settings=settings or StepSettings(corrector=options.corrector),
    )
    return Block(problem, lateral, top)


# ## Solve
#
# A step is: set the loads, `solve`, read the report. Nothing uncertified is ever accepted: if no
# certified solution is found, `solve` raises `StepFailed`, which names the worst nodes, and
# restores the last accepted state.
#
# The exact solution comes from another way of solving: the stiffness is condensed on the nodes of
# the base, and the increment solved as a second-order-cone complementarity problem, as Kanno,
# Martins and Pinto da Costa (2006) do. On the same mesh it has the same solution, so that the
# difference is an error of the algorithm alone. It lives on rank 0, on a mesh of its own.


def solve_history(
    block: Block, exact: Exact | None, options: Options
) -> tuple[list[results.Increment], str]:
    """Solve increment by increment; return the accepted ones and why it ended early, if it did."""
    problem = block.problem
    increments: list[results.Increment] = []
    files = Results(problem, options.output)
    for factors in terminal.track(options.history):
        block.load(options, factors)
        try:
            report = problem.solve()
        except StepFailed as failure:
            return increments, str(failure)
        files.write(report.step, report)
        increments.append(
            results.Increment(
                factors,
                report,
                results.gather_line(problem, problem.accepted[0]),
                results.symmetry_reaction(problem),
                exact.advance(options, factors) if exact else None,
                exact.scales if exact else (0.0, 0.0),
            )
        )
    return increments, ""


# ## Figures 2, 3 and 7
#
# The curves of figures 2 and 3 are values of the package's own UFL function, compiled like the
# contact equations. With $y = r_p g - c_n$ the normal equation says
# $r_p g = \langle y\rangle_\varepsilon$: each curve of figure 3 is traced by $y$, without solving
# for $c_n$.
#
# For figure 7 the demo takes the corrector into its own hands. All closed nodes get slip rows,
# as the paper prints it, the normal law is exact ($\varepsilon = 0$), and $\xi$ passes through
# given values in one increment from zero to the full load. At finite $\xi$ a sticking node creeps
# by $\xi V_0/(1-\xi)$: along the stick force with the sign `-`, against it with `+`. The error of
# the tangential stress is therefore proportional to $\xi$, at $\xi = 10^{-7}$ some $10^{-8}$ of
# the largest stress, which confirms the paper's remark on its figure 7.


def ramps(options: Options) -> dict[int, Block]:
    """Return problems with the paper's corrector at all nodes, for each sign in eq. (12)."""
    return {
        sign: create_problem(
            MPI.COMM_SELF,
            options,
            f"raous_ramp_{sign}_",
            StepSettings(corrector="ramp", ramp_nodes="all", ramp_sign=sign),
        )
        for sign in (1, -1)
    }


# ## All together


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demo; return its exit status."""
    options = parse_options(arguments)
    comm = MPI.COMM_WORLD
    if comm.rank == 0:
        results.prepare(options.output)
    comm.barrier()
    terminal.say_problem(options, comm.size)
    block = create_problem(comm, options, "raous_")
    exact = None
    if comm.rank == 0:
        exact = Exact(create_problem(MPI.COMM_SELF, options, "raous_exact_"))
    increments, failure = solve_history(block, exact, options)
    if increments:
        cells = results.gather_cells(block.problem.u)
        if comm.rank == 0:
            r_p = float(np.median(exact.block.problem.contacts[0].r.x.array))
            terminal.say_results(options, increments)
            figures.write_results(options, increments, cells, r_p, ramps(options))
            terminal.say_files(options.output)
    comm.barrier()
    if failure:
        terminal.say_failure(failure)
    return 1 if failure else 0


if __name__ == "__main__":
    sys.exit(main())

# ## What to look at
#
# * **Table.** With 32 × 16 B-bar elements the points A to E move by 2.858, 2.720, 2.284, 1.979
#   and 1.540 × 10⁻⁵ m; all digits are those of the exact discrete solution, and each is within
#   3 % of the mean of the codes in the benchmark. `--element q1 --nx 32 --ny 10` gives the eight
#   digits that code_aster prints in SSNV128q: 2.84594384, 2.70792364, 2.27402555, 1.97270669,
#   1.53641594. R sticks, so it stays where it is.
# * **Figure 5.** The traction leans by the friction angle, here 45°, wherever the base slips, and
#   straightens up towards the symmetry plane. Under the flank the base is open, by a gap too
#   small to be seen at this magnification (`contact_line.csv` has it).
# * **Figure 6.** In the slip zone $\sigma_t$ follows the limit $\mu c_n$, and leaves it where the
#   base begins to stick. At $x = L$ it is zero by construction, see above. Below, the difference
#   from the exact solution is rounding: some $10^{-14}$ of the stress.
# * **Figure 7.** Down to $\xi = 0.5$ the curves differ visibly, and mostly where slip ends; below
#   $0.2$ they lie on one another, and only the error tells them apart. With the sign `-` the peak
#   at finite $\xi$ is *outside* the cone: at $w = 0$ any $c_t$ is a root of (15). The row alone
#   does not know Coulomb's law at $\xi > 0$, which is why the certificate contains no $\xi$.
#   $\xi = 1$ is left out of the upper panels: with `+` it reverses friction altogether.
# * **Unloading.** A file such as
#
#   ```
#   lateral_factor,top_factor
#   0.5,1
#   1,1
#   0.5,1
#   0,0.5
#   ```
#
#   for `--path` shows what a law without memory cannot: after the lateral pressure is gone, the
#   base slips back, and friction, now of the other sign under the flank, holds it halfway.
