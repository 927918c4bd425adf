# SPDX-License-Identifier: MIT
"""Random problems, each certified and equal to the exact reference at every step.

    ./container python3 benchmarks/random_suite.py [--problems 200] [--first 0]

Each seed draws dimension, cell, mesh, box, material, friction, plane, load path with reversals and
the corrector. A step fails the suite if it is not certified, or if certified but different from the
exact solution although that one is unique (mu <= 1). A sample of it is part of the tests.
"""

import argparse
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.verification.exact import ExactReference
from fenicsx_friction.verification.soclcp import NoExactSolution

CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
#: Relative difference of tractions from the exact solution that counts as equal.
EQUAL = 1e-7
#: Beyond this friction coefficient several solutions may exist, all of them certified.
UNIQUE = 1.0


@dataclass(frozen=True)
class Outcome:
    """What became of one random problem.

    Attributes:
        seed: Its seed.
        text: Description of the problem.
        certified: Number of certified steps.
        steps: Number of steps asked for.
        difference: Largest relative difference of tractions from the exact solution.
        other_solutions: Steps with another certified solution than the exact reference's.
        iterations: Newton iterations in all.
        message: Why it stopped, if it did.
        failed: Whether a step was neither certified nor solved by the reference.
    """

    seed: int
    text: str
    certified: int
    steps: int
    difference: float
    other_solutions: int
    iterations: int
    message: str = ""
    failed: bool = False

    @property
    def passed(self) -> bool:
        """Whether all steps made were certified, and equal where they must be.

        All are made but after another solution: from there on the histories differ.
        """
        whole = self.certified == self.steps or self.other_solutions > 0
        return whole and not self.failed and self.difference <= EQUAL


def run(seed: int) -> Outcome:
    """Solve the random problem of a seed, in serial."""
    rng = np.random.default_rng(seed)
    cell = str(rng.choice(CELLS))
    d = 2 if cell in CELLS[:2] else 3
    n = rng.integers(3, 9, d) if d == 2 else rng.integers(2, 5, d)
    box = rng.uniform(0.5, 2.0, d)
    mu = float(rng.choice([0.0, *rng.uniform(0.05, 2.0, 3)]))
    material = ff.bulk.Elastic(E=float(10 ** rng.uniform(2, 11)), nu=float(rng.uniform(0.0, 0.45)))
    corrector = str(rng.choice(["projection", "projection", "ramp"]))
    problem, move = _problem(rng, seed, cell, n, box, material, mu, corrector)
    exact = ExactReference(problem)
    steps, difference, others, iterations = int(rng.integers(4, 9)), 0.0, 0, 0
    scale = 1e-6 * material.E  # the largest traction so far, once there is one
    text = f"{cell:13s} {'x'.join(map(str, n)):7s} mu {mu:5.3f} nu {material.nu:.2f} {corrector}"
    for done, position in enumerate(_path(rng, steps, box)):
        move(position)
        try:
            expected = exact.advance()
            iterations += problem.solve().iterations
        except (ff.StepFailed, NoExactSolution) as failure:
            message = f"{type(failure).__name__}: {str(failure).splitlines()[0]}"
            return Outcome(seed, text, done, steps, difference, others, iterations, message, True)
        scale = max(float(np.max(np.abs(expected.c))), scale)
        apart = float(np.max(np.abs(problem.accepted[0].c - expected.c))) / scale
        if apart > EQUAL and mu > UNIQUE:
            message = "another solution"
            return Outcome(seed, text, done + 1, steps, difference, 1, iterations, message)
        difference = max(difference, apart)
    return Outcome(seed, text, steps, steps, difference, others, iterations)


def _problem(rng, seed, cell, n, box, material, mu, corrector):
    """Build a box on a plane (floor of a random height below) with a moved top."""
    d = len(box)
    cell_type = getattr(mesh.CellType, cell)
    create = mesh.create_rectangle if d == 2 else mesh.create_box
    msh = create(MPI.COMM_SELF, [np.zeros(d), box], n.tolist(), cell_type)
    bottom = mesh.locate_entities_boundary(msh, d - 1, lambda x: np.isclose(x[d - 1], 0.0))
    tags = mesh.meshtags(msh, d - 1, np.sort(bottom), 1)
    V = fem.functionspace(msh, ("Lagrange", 1, (d,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, material)
    bbar = bool(rng.integers(2)) and cell in ("quadrilateral", "hexahedron")
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx, bbar=bbar), u, v)
    top = fem.Function(V)
    held = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[d - 1], box[d - 1]))
    # A slightly tilted floor, so that contact grows from an edge.
    tilt = np.append(rng.uniform(-0.02, 0.02, d - 1), 1.0)
    low = float(np.min(np.array([[0.0, *([0.0] * (d - 2))], box[: d - 1]]) @ tilt[:-1]))
    point = np.append(np.zeros(d - 1), min(low, 0.0) - float(rng.uniform(0.0, 0.01)))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1),
        ff.RigidPlane(point.tolist(), tilt.tolist()),
        ff.Coulomb(mu),
    )
    problem = ff.FrictionalContactProblem(
        F,
        u,
        contact=contact,
        bcs=[fem.dirichletbc(top, held)],
        petsc_options_prefix=f"random_{seed}_",
        settings=ff.StepSettings(corrector=corrector),
    )

    def move(position: np.ndarray) -> None:
        top.x.array[:] = np.tile(position, len(top.x.array) // d)

    return problem, move


def _path(rng: np.random.Generator, steps: int, box: np.ndarray) -> np.ndarray:
    """Draw a path of the top: pressed down, moved to and fro, sometimes lifted."""
    d, size = len(box), 0.03 * float(np.min(box))
    path = rng.normal(0.0, size, (steps, d))
    path[:, d - 1] = -np.abs(rng.normal(1.5 * size, size, steps))
    lifted = rng.random(steps) < 0.1
    path[lifted, d - 1] = 5.0 * size
    return path


def main() -> int:
    """Run the suite; the exit status is the number of failures, at most 1."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--problems", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    arguments = parser.parse_args()
    outcomes = []
    for seed in range(arguments.first, arguments.first + arguments.problems):
        outcome = run(seed)
        outcomes.append(outcome)
        print(
            f"seed {seed:4d} {outcome.text:52s} steps {outcome.certified}/{outcome.steps} "
            f"solves {outcome.iterations:4d} difference {outcome.difference:.1e} "
            f"{'ok' if outcome.passed else 'FAILED'} {outcome.message}",
            flush=True,
        )
    failed = [outcome.seed for outcome in outcomes if not outcome.passed]
    print(
        f"{len(outcomes) - len(failed)} of {len(outcomes)} passed, "
        f"{sum(o.certified for o in outcomes)} of {sum(o.steps for o in outcomes)} steps made and "
        f"certified, largest difference "
        f"{max(o.difference for o in outcomes):.1e}, other solutions in "
        f"{sum(o.other_solutions for o in outcomes)}; failed seeds: {failed or 'none'}"
    )
    return min(len(failed), 1)


if __name__ == "__main__":
    raise SystemExit(main())
