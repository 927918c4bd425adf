# SPDX-License-Identifier: MIT
"""Cost and memory of everything beside the linear solves, where the contact surface is large.

    ./container python3 benchmarks/large_contact.py [--nodes 100 200 316] [--deformable]

Two layers of ``n`` × ``n`` cubic cells, one above the other, do not match. The upper one meets a
rigid plane or, with ``--deformable``, the lower one. Each part is timed once after a small model
has compiled the forms (CPU seconds; the last column is the exponent in the contact nodes, from the
size before). Search, certificate and files must not grow faster than the mesh.
"""

import argparse
import math
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff

T = TypeVar("T")


def layers(n: int) -> tuple[mesh.Mesh, mesh.MeshTags]:
    """Return two layers of cells; the upper one's base is tagged 1, the lower one's top 2."""
    box = mesh.create_box(
        MPI.COMM_WORLD, [[0.0] * 3, [1.0, 1.0, 3.0]], [n, n, 3], mesh.CellType.hexahedron
    )
    own = np.arange(box.topology.index_map(3).size_local, dtype=np.int32)
    height = mesh.compute_midpoints(box, 3, own)[:, 2]
    msh = mesh.create_submesh(box, 3, own[abs(height - 1.5) > 0.6])[0]
    msh.topology.create_connectivity(2, 3)
    faces = [
        mesh.locate_entities_boundary(msh, 2, lambda x, at=at: np.isclose(x[2], at))
        for at in (2.0, 1.0)
    ]
    values = np.repeat(np.array([1, 2], dtype=np.int32), [len(f) for f in faces])
    order = np.argsort(np.concatenate(faces))
    tags = mesh.meshtags(msh, 2, np.concatenate(faces)[order], values[order])
    x = msh.geometry.x
    upper = x[:, 2] > 1.5
    x[upper, :2] = 0.02 + 0.96 * x[upper, :2]
    x[:, 2] = np.where(upper, x[:, 2] - 2.0, x[:, 2] - 1.0) / n
    return msh, tags


def build(n: int, deformable: bool) -> ff.FrictionalContactProblem:
    """Return the problem; its top is moved down, its base held."""
    msh, tags = layers(n)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v, moved = fem.Function(V, name="u"), ufl.TestFunction(V), fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E=1000.0, nu=0.3))
    ends = fem.locate_dofs_geometrical(V, lambda x: np.isclose(abs(x[2]), 1.0 / n))
    x = V.tabulate_dof_coordinates()
    moved.x.array.reshape(-1, 3)[x[:, 2] > 0.5 / n, 2] = -1e-3 / n
    if deformable:
        obstacle: ff.Obstacle = ff.DeformableObstacle(ff.ContactSurface(msh, tags, 2, "lower"))
    else:
        obstacle = ff.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    return ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=ff.Contact(ff.ContactSurface(msh, tags, 1, "upper"), obstacle, ff.Coulomb(0.3)),
        bcs=[fem.dirichletbc(moved, ends)],
        petsc_options_prefix=f"layers_{n}_",
        linear_solver="multigrid",
    )


def parts(n: int, deformable: bool, folder: Path) -> dict[str, float]:
    """Return the CPU times (s) of the parts, in their order."""
    spent: dict[str, float] = {}

    def timed(name: str, call: Callable[[], T]) -> T:
        """Run a part and keep its time."""
        start = time.process_time()
        result = call()
        spent[name] = time.process_time() - start
        return result

    problem = timed("mesh and construction", lambda: build(n, deformable))
    contact = problem.contacts[0]
    timed("frames, pairs and forces", lambda: (contact.anchor(), problem.scales.begin()))
    timed("residual", lambda: problem.projection.residual().destroy())
    timed("matrix", problem.projection.jacobian)
    timed("matrix again", problem.projection.jacobian)
    timed("one step", problem.solve)
    timed("search", contact.pairing.search)
    timed("certificate", problem.certify)
    fields = ff.ContactFields(problem)
    timed("contact fields", fields.update)
    path = folder / f"{n}.h5"
    timed("write checkpoint", lambda: ff.write_checkpoint(path, problem))
    timed("read checkpoint", lambda: ff.read_checkpoint(path, problem))
    return spent


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--nodes", type=int, nargs="+", default=[100, 200, 316])
    parser.add_argument("--deformable", action="store_true")
    arguments = parser.parse_args()
    sizes = arguments.nodes
    with tempfile.TemporaryDirectory() as name:
        parts(4, arguments.deformable, Path(name))
        found = []
        for n in sizes:
            found.append(parts(n - 1, arguments.deformable, Path(name)))
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
            print(f"{n**2} contact nodes, {12 * n**2} dofs: peak {memory:.2f} GiB", flush=True)
    print(f"{'':26s}" + "".join(f"{n**2:9d}" for n in sizes) + "  exponent")
    for part in found[0]:
        times = [row[part] for row in found]
        tail = ""
        if len(sizes) > 1 and min(times[-2:]) > 0.0:
            growth = math.log(times[-1] / times[-2]) / math.log((sizes[-1] / sizes[-2]) ** 2)
            tail = f"{growth:8.2f}"
        print(f"{part:26s}" + "".join(f"{t:9.2f}" for t in times) + tail)


if __name__ == "__main__":
    main()
