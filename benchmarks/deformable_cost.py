# SPDX-License-Identifier: MIT
"""What contact costs between deformable bodies: search and contact elements, as parts of a step.

    ./container python3 benchmarks/deformable_cost.py [--density medium] [--mu 0.5] [--steps 5]
                                                      [--method nodes] [--ring 4]

The concentric spheres are pressed by steps of 0.2 mm; or, in 2D, a half ring is dragged over a
block by one and a half faces a step, with so many times the cells of the tests. Timed are the
search, the contact elements (kinematics, forces, matrices, their sparsity) and the whole; the
unit beside it is one linear elastic solve on the same mesh, in the same run. A part that calls
another one does not count it. Compare parts and ratios.
"""

import argparse
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
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

sys.path[:0] = [str(Path(__file__).parents[1] / folder) for folder in ("demos", "tests")]
import demo_concentric_spheres as spheres
from rings import half_ring

#: A problem, and what makes its steps.
Run = tuple[ff.FrictionalContactProblem, Callable[[int], ff.StepReport]]
#: What is timed: a name, the class and its methods.
PARTS = (
    ("search", NodeToFace, ("anchor", "search")),
    ("search", Mortar, ("anchor", "search")),
    ("crossings", TwoBodies, ("crossed", "pierced")),
    ("kinematics", TwoBodies, ("_follow",)),
    ("forces", ContactTerms, ("_add_forces",)),
    ("matrices", ContactTerms, ("matrices",)),
    ("sparsity", Callbacks, ("prepare",)),
)


@contextmanager
def timed() -> Iterator[dict[str, float]]:
    """Time the parts of what runs inside the context (s)."""
    spent: dict[str, float] = defaultdict(float)
    kept, inner = [], [0.0]  # inner: spent in parts that a part calls, innermost last
    for part, owner, methods in PARTS:
        for name in methods:
            original = getattr(owner, name)
            kept.append((owner, name, original))

            def call(*args, original=original, part=part, **kwargs):  # type: ignore[no-untyped-def]
                """Call the original and add its time."""
                start = time.process_time()
                inner.append(0.0)
                try:
                    return original(*args, **kwargs)
                finally:
                    whole = time.process_time() - start
                    spent[part] += whole - inner.pop()
                    inner[-1] += whole

            setattr(owner, name, call)
    try:
        yield spent
    finally:
        for owner, name, original in kept:
            setattr(owner, name, original)


def elastic_cost(problem: ff.FrictionalContactProblem) -> float:
    """Return the CPU time (s) of an elastic solve on the mesh, its upper part held."""
    V = problem.u.function_space
    up = V.mesh.geometry.dim - 1
    dofs = fem.locate_dofs_geometrical(V, lambda x: x[up] > 0.8 * np.max(x[up]))
    elastic = elastic_problem(problem, dofs, None, "bodies")
    return statistics.median(cpu_of(elastic) for _ in range(3))


def pressed(density: str, mu: float, method: str) -> Run:
    """Return the spheres between planes, and what makes a step."""
    model = spheres.build(spheres.Case(density, mu, method=method))

    def step(k: int) -> ff.StepReport:
        """Press by 0.2 mm more."""
        model.press(0.1 + 0.2 * k)
        return model.problem.solve()

    step(0)  # compiles
    return model.problem, step


def dragged(refine: int, mu: float, method: str) -> Run:
    """Return the ring on the block, and what makes a step."""
    name = {"nodes": "node-to-face"}.get(method, method)
    problem, top = half_ring("ring_", mu, name, refine)

    def step(k: int) -> ff.StepReport:
        """Drag by one and a half faces more."""
        top.value[:] = (0.05 * k / refine, -0.1)
        return problem.solve()

    return problem, step


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--density", default="medium")
    parser.add_argument("--mu", type=float, default=0.5)
    parser.add_argument("--steps", type=int, default=5)
    parser.add_argument("--method", default="mortar", help="or nodes")
    parser.add_argument("--ring", type=int, help="in 2D, with so many times the cells")
    arguments = parser.parse_args()
    mu, method = arguments.mu, arguments.method
    if arguments.ring:
        problem, step = dragged(arguments.ring, mu, method)
    else:
        problem, step = pressed(arguments.density, mu, method)
    with timed() as spent:
        start = time.process_time()
        solves = sum(step(k + 1).iterations for k in range(arguments.steps))
        total = time.process_time() - start
    elastic = elastic_cost(problem)
    pairs, dofs = problem.contacts[0].surface.num_owned, len(problem.u.x.array)
    print(f"{dofs} displacements, {pairs} nodes, {arguments.steps} steps, {solves} linear solves "
          f"in {total:.1f} s")  # fmt: skip
    print(f"one linear elastic solve: {elastic:.2f} s; a Newton iteration: "
          f"{total / solves / elastic:.2f} of it")  # fmt: skip
    for part, seconds in spent.items():
        print(f"{part:12s} {100.0 * seconds / total:5.1f} % of the step")
    print(f"{'contact':12s} {100.0 * sum(spent.values()) / total:5.1f} %")


if __name__ == "__main__":
    main()
