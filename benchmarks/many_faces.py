# SPDX-License-Identifier: MIT
"""A block pressed on a plate of one layer with many faces: mortar, multigrid, on several ranks.

    ./container mpirun -n 4 python3 benchmarks/many_faces.py [--block 100] [--plate 316]

Both have one layer of cells, so many along each side. Printed are sizes, times of the parts (s,
wall clock; ranks may share cores) and the largest memory of a rank.
"""

import argparse
import resource
import time

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff


def build(block: int, plate: int) -> ff.FrictionalContactProblem:
    """Return the problem: the block's top is moved down, the plate's base held."""
    comm, hexahedron = MPI.COMM_WORLD, mesh.CellType.hexahedron
    low, high = [0.3, 0.3, 0.0], [0.7, 0.7, 0.4 / block]
    parts = {
        "block": mesh.create_box(comm, [low, high], [block, block, 1], hexahedron),
        "plate": mesh.create_box(
            comm, [[0.0, 0.0, -1.0 / plate], [1.0, 1.0, 0.0]], [plate, plate, 1], hexahedron
        ),
    }
    joined = ff.join_meshes(parts, comm)
    msh = joined.mesh
    at_joint = mesh.locate_entities_boundary(msh, 2, lambda x: abs(x[2]) < 1e-9)
    of_block = joined.cells("block")
    msh.topology.create_connectivity(2, 3)
    to_cells = msh.topology.connectivity(2, 3)
    owner = np.array([to_cells.links(f)[0] for f in at_joint], dtype=np.int32)
    which = np.where(np.isin(owner, of_block), 1, 2).astype(np.int32)
    tags = mesh.meshtags(msh, 2, at_joint, which)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v, pressed = fem.Function(V, name="u"), ufl.TestFunction(V), fem.Function(V)
    x = V.tabulate_dof_coordinates()
    pressed.x.array.reshape(-1, 3)[x[:, 2] > 0.0, 2] = -1e-3 * high[2]
    ends = np.flatnonzero(abs(x[:, 2]) > 1e-9).astype(np.int32)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E=1000.0, nu=0.3))
    obstacle = ff.DeformableObstacle(ff.ContactSurface(msh, tags, 2, "plate"), method="mortar")
    return ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=ff.Contact(ff.ContactSurface(msh, tags, 1, "block"), obstacle, ff.Coulomb(0.3)),
        bcs=[fem.dirichletbc(pressed, ends)],
        petsc_options_prefix="faces_",
        linear_solver="multigrid",
    )


def main() -> None:
    """Print sizes, times and memory."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--block", type=int, default=100, help="cells along a side of the block")
    parser.add_argument("--plate", type=int, default=316, help="of the plate")
    arguments = parser.parse_args()
    build(4, 8).solve()  # compiles the forms
    start = time.perf_counter()
    problem = build(arguments.block, arguments.plate)
    made = time.perf_counter()
    report = problem.solve()
    solved = time.perf_counter()
    comm, index_map = problem.comm, problem.u.function_space.dofmap.index_map
    memory = comm.allgather(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)
    if comm.rank == 0:
        print(
            f"{arguments.block**2} faces on {arguments.plate**2}, {3 * index_map.size_global} "
            f"displacements, {comm.size} ranks: mesh and construction {made - start:.0f} s, first "
            f"step {solved - made:.0f} s, {report.iterations} iterations, certificate "
            f"{report.certificate.relative:.0e}, at most {max(memory):.1f} GiB on a rank",
            flush=True,
        )


if __name__ == "__main__":
    main()
