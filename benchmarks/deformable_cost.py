# SPDX-License-Identifier: MIT
"""What contact costs between deformable bodies: search and contact elements, as parts of a step.

    ./container python3 benchmarks/deformable_cost.py [--density medium] [--mu 0.5] [--steps 5]
                                                      [--method nodes]

The concentric spheres are pressed by steps of 0.2 mm. Timed are the search, the contact elements
(kinematics, forces, matrices and the sparsity they need) and the whole; the unit beside it is one
linear elastic solve on the same mesh, in the same run. Compare parts and ratios.
"""

import argparse
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from dolfinx import fem

import fenicsx_friction as ff
from elastic import cpu_of, elastic_problem
from fenicsx_friction.equations.contact_terms import ContactTerms
from fenicsx_friction.obstacles.mortar import Mortar
from fenicsx_friction.obstacles.node_to_face import NodeToFace
from fenicsx_friction.obstacles.two_bodies import TwoBodies
from fenicsx_friction.solvers.snes_callbacks import Callbacks

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import demo_concentric_spheres as spheres

#: What is timed: a name, the class and its methods. No method of a part calls another of a part.
PARTS = (
    ("search", NodeToFace, ("anchor", "search")),
    ("search", Mortar, ("anchor", "search")),
    ("crossings", TwoBodies, ("crossed", "pierced")),
    ("kinematics", ContactTerms, ("update",)),
    ("forces", ContactTerms, ("_add_forces",)),
    ("matrices", ContactTerms, ("matrices",)),
    ("sparsity", Callbacks, ("prepare",)),
)


@contextmanager
def timed() -> Iterator[dict[str, float]]:
    """Time the parts of what runs inside the context (s)."""
    spent: dict[str, float] = defaultdict(float)
    kept = []
    for part, owner, methods in PARTS:
        for name in methods:
            original = getattr(owner, name)
            kept.append((owner, name, original))

            def call(*args, original=original, part=part, **kwargs):  # type: ignore[no-untyped-def]
                """Call the original and add its time."""
                start = time.process_time()
                try:
                    return original(*args, **kwargs)
                finally:
                    spent[part] += time.process_time() - start

            setattr(owner, name, call)
    try:
        yield spent
    finally:
        for owner, name, original in kept:
            setattr(owner, name, original)


def elastic_cost(problem: ff.FrictionalContactProblem) -> float:
    """Return the CPU time (s) of an elastic solve on the mesh, its upper part held."""
    V = problem.u.function_space
    dofs = fem.locate_dofs_geometrical(V, lambda x: x[2] > 0.8 * np.max(x[2]))
    elastic = elastic_problem(problem, dofs, None, "spheres")
    return statistics.median(cpu_of(elastic) for _ in range(3))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--density", default="medium")
    parser.add_argument("--mu", type=float, default=0.5)
    parser.add_argument("--steps", type=int, default=5)
    parser.add_argument("--method", default="mortar", help="or nodes")
    arguments = parser.parse_args()
    model = spheres.build(spheres.Case(arguments.density, arguments.mu, method=arguments.method))
    model.press(0.1)
    model.problem.solve()  # compiles
    solves = 0
    with timed() as spent:
        start = time.process_time()
        for k in range(arguments.steps):
            model.press(0.1 + 0.2 * (k + 1))
            solves += model.problem.solve().iterations
        total = time.process_time() - start
    elastic = elastic_cost(model.problem)
    pairs = model.spheres.surface.num_owned
    print(f"{pairs} pairs, {arguments.steps} steps, {solves} linear solves in {total:.1f} s")
    print(f"one linear elastic solve: {elastic:.2f} s; a Newton iteration: "
          f"{total / solves / elastic:.2f} of it")  # fmt: skip
    for part, seconds in spent.items():
        print(f"{part:12s} {100.0 * seconds / total:5.1f} % of the step")
    print(f"{'contact':12s} {100.0 * sum(spent.values()) / total:5.1f} %")


if __name__ == "__main__":
    main()
