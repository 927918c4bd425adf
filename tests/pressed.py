"""A block under rigid bodies that carry loads."""

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff

E, NU = 100.0, 0.3
CELLS = {2: mesh.CellType.quadrilateral, 3: mesh.CellType.hexahedron}
NUMBERS = {2: (16, 8), 3: (6, 6, 3)}


class Half:
    """A block below y = 0 (z = 0), held at its bottom, under rigid bodies."""

    def __init__(
        self,
        name,
        bodies,
        d=2,
        degree=1,
        mu=0.3,
        width=1.0,
        numbers=None,
        place=None,
        nodes=1,
        energy="small",
        **options,
    ):
        low, high = (-width,) * (d - 1) + (-1.0,), (width,) * (d - 1) + (0.0,)
        make = mesh.create_rectangle if d == 2 else mesh.create_box
        numbers = numbers or NUMBERS[d]
        msh = make(MPI.COMM_WORLD, [low, high], list(numbers), CELLS[d])
        top = mesh.locate_entities_boundary(msh, d - 1, lambda x: np.isclose(x[d - 1], 0.0))
        tags = mesh.meshtags(msh, d - 1, np.sort(top), np.full(len(top), 1, dtype=np.int32))
        V = fem.functionspace(msh, ("Lagrange", degree, (d,)))
        bottom = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[d - 1], -1.0))
        if place is not None:
            msh.geometry.x[:, :d] = place(msh.geometry.x[:, :d])
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        density = {"small": ff.bulk.small_strain_energy, "finite": ff.bulk.neo_hooke_energy}[energy]
        stored = ff.bulk.stored_energy(density(self.u, ff.bulk.Elastic(E, NU)), ufl.dx)
        F = ufl.derivative(stored, self.u, v)
        self.bodies, obstacles = bodies(msh)
        friction = ff.Coulomb(mu) if mu else ff.Frictionless()
        self.contacts = [
            ff.Contact(ff.ContactSurface(msh, tags, 1, f"top {i}", degree=nodes), o, friction)
            for i, o in enumerate(obstacles)
        ]
        self.problem = ff.FrictionalContactProblem(
            F,
            self.u,
            contact=self.contacts,
            bcs=[fem.dirichletbc(np.zeros(d), bottom, V)],
            petsc_options_prefix=name,
            **options,
        )

    @property
    def body(self):
        """The only body."""
        return self.bodies[0]
