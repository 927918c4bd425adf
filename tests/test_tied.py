# SPDX-License-Identifier: MIT
"""Tied surfaces: they carry tension and shear as one body does, until they are released."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import box
from models import tagged_facets

E, NU, COMM = 100.0, 0.3, MPI.COMM_WORLD


class Pair:
    """Two blocks on each other; the lower one is held, the upper one is pulled by tractions."""

    def __init__(self, name, cells=(4, 4), degree=1, law=None, method=None, d=2, cell=None, **more):
        cell = cell or {2: "quadrilateral", 3: "hexahedron"}[d]
        parts = {}
        for k, (body, n) in enumerate(zip(("lower", "upper"), cells, strict=True)):
            low, high = [0.0] * (d - 1) + [float(k)], [1.0] * (d - 1) + [k + 1.0]
            msh = box(low, high, [n] * (d - 1) + [2], cell)
            sides = [lambda x, z=z: np.isclose(x[d - 1], z) for z in (k, k + 1.0)]
            tags = tagged_facets(msh, *sides)
            names = {"bottom": (d - 1, (1,)), "top": (d - 1, (2,))}
            parts[body] = ff.NamedMesh(msh, None, tags, names)
        self.model = model = ff.join_meshes(parts, COMM)
        V = fem.functionspace(model.mesh, ("Lagrange", degree, (d,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        density = ff.bulk.small_strain_energy(self.u, ff.bulk.Elastic(E, NU))
        self.load = fem.Constant(model.mesh, np.zeros(d))
        F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), self.u, v)
        F -= ufl.inner(self.load, v) * model.ds("upper/top")
        bcs = []
        foot = fem.locate_dofs_topological(V.sub(d - 1), d - 1, model.facets("lower/bottom"))
        bcs.append(fem.dirichletbc(fem.Constant(model.mesh, 0.0), foot, V.sub(d - 1)))
        for axis in range(d - 1):  # supports that do not hinder a uniform state
            side = mesh.locate_entities_boundary(
                model.mesh, d - 1, lambda x, i=axis: np.isclose(x[i], 0.0)
            )
            dofs = fem.locate_dofs_topological(V.sub(axis), d - 1, side)
            bcs.append(fem.dirichletbc(fem.Constant(model.mesh, 0.0), dofs, V.sub(axis)))
        self.contact = ff.Contact(
            model.surface("upper/bottom"),
            ff.DeformableObstacle(model.surface("lower/top"), method=method),
            law or ff.Frictionless(),
        )
        self.problem = ff.FrictionalContactProblem(
            F, self.u, contact=self.contact, bcs=bcs, petsc_options_prefix=name, **more
        )


CASES = [
    ((4, 4), 1, None, 2, None),
    ((5, 3), 1, None, 2, None),
    ((5, 3), 2, None, 2, "triangle"),
    ((4, 4), 1, "mortar", 2, None),
    ((3, 2), 1, None, 3, None),
]


@pytest.mark.parametrize(("cells", "degree", "method", "d", "cell"), CASES)
def test_tension_is_uniform_as_in_one_body(cells, degree, method, d, cell):
    name = f"tension_{cells[0]}{cells[1]}{degree}{d}{method}_"
    pair = Pair(name, cells, degree, method=method, d=d, cell=cell)
    assert ff.tie(pair.contact, within=1e-9) > 0
    assert pair.problem.solve().certified  # nothing acts
    pair.load.value[d - 1] = 2.0
    report = pair.problem.solve()
    assert report.certified
    assert np.allclose(pair.contact.nodal().c[:, 0], -2.0, atol=1e-9)
    assert report.contacts[0].force[d - 1] == pytest.approx(-2.0, rel=1e-9)
    assert report.contacts[0].open == report.contacts[0].slip == 0
    height = pair.u.function_space.tabulate_dof_coordinates()[:, d - 1]
    modulus = E if d == 3 else E / (1.0 - NU**2)
    moved = pair.u.x.array.reshape(-1, d)[:, d - 1]
    assert np.allclose(moved, 2.0 / modulus * height, atol=1e-9)


def test_it_carries_shear_without_friction():
    """A bond carries what the supports of one side would have to."""
    pair = Pair("shear_")
    ff.tie(pair.contact, within=1e-9)
    pair.load.value[:] = (0.3, -1.0)
    report = pair.problem.solve().contacts[0]
    assert report.slip == report.open == 0
    tied = np.array(report.force)
    ff.release(pair.contact)
    report = pair.problem.solve().contacts[0]
    assert report.force[1] == pytest.approx(1.0, rel=1e-9)
    assert np.max(abs(pair.contact.nodal().c[:, 1])) < 1e-12  # frictionless again
    assert abs(tied[0] - report.force[0]) > 0.01


@pytest.mark.quick
def test_released_bodies_come_apart():
    pair = Pair("apart_")
    ff.tie(pair.contact, within=1e-9)
    pair.load.value[1] = 1.0
    assert pair.problem.solve().certified
    ff.release(pair.contact)
    with pytest.raises(ff.StepFailed):  # nothing holds the upper body
        pair.problem.solve()
    pair.load.value[1] = -1.0
    report = pair.problem.solve()
    assert report.contacts[0].force[1] == pytest.approx(1.0, rel=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize("law", [ff.Coulomb(0.3), ff.OrthotropicCoulomb((0.2, 0.5), (1, 0, 0))])
def test_a_rigid_stamp_lifts_a_block(law):
    """Bonded to a rigid plane; the drag of the bond is no friction, whatever the law."""
    d = 3
    msh = mesh.create_box(COMM, [(0, 0, 0), (1, 1, 1)], [3, 3, 3], mesh.CellType.hexahedron)
    tags = tagged_facets(msh, lambda x: np.isclose(x[2], 1.0))
    V = fem.functionspace(msh, ("Lagrange", 1, (d,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU))
    motion = ff.RigidMotion(msh)
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0, 0, 1), (0, 0, -1), motion=motion), law
    )
    foot = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[2], 0.0))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(np.zeros(d), foot, V)],
        petsc_options_prefix=f"stamp_{type(law).__name__}_",
    )
    assert ff.tie(contact, within=1e-9) == 16
    motion.translation.value[:] = (0.01, 0.0, 0.02)
    report = problem.solve()
    assert report.certified
    top = np.isclose(V.tabulate_dof_coordinates()[:, 2], 1.0)
    assert np.allclose(u.x.array.reshape(-1, d)[top], (0.01, 0.0, 0.02), atol=1e-12)
    assert report.contacts[0].force[2] > 0.5  # up
    assert report.contacts[0].dissipation == pytest.approx(0.0, abs=1e-12)
    assert ff.check_jacobian(problem).error < 1e-6


def test_a_checkpoint_keeps_bonds(tmp_path):
    pair = Pair("kept_")
    ff.tie(pair.contact, within=1e-9)
    pair.load.value[1] = 1.0
    pair.problem.solve()
    ff.write_checkpoint(tmp_path / "bonds.h5", pair.problem)
    again = Pair("kept_again_")
    ff.read_checkpoint(tmp_path / "bonds.h5", again.problem)
    again.load.value[1] = 2.0
    report = again.problem.solve()
    assert report.contacts[0].force[1] == pytest.approx(-2.0, rel=1e-9)


def test_a_bond_that_opens_is_not_certified():
    """The mutation: a state with a gap at a bonded node."""
    pair = Pair("mutant_")
    ff.tie(pair.contact, within=1e-9)
    pair.load.value[1] = 1.0
    pair.problem.solve()
    assert pair.problem.certify().certified
    upper = pair.u.function_space.tabulate_dof_coordinates()[:, 1] > 1.0 - 1e-9
    moved = fem.locate_dofs_geometrical(pair.u.function_space, lambda x: x[1] > 1.5)
    assert upper.any()
    pair.u.x.array.reshape(-1, 2)[pair.contact.parent_dofs, 1] += 1e-3
    assert len(moved)
    assert not pair.problem.certify().certified


def test_multigrid_joins_faces_that_do_not_match():
    """Springs of mortar join nodes that nothing in the bulk joins."""
    pair = Pair("multigrid_", (3, 2), d=3, linear_solver="multigrid")
    ff.tie(pair.contact, within=1e-9)
    pair.load.value[2] = 2.0
    report = pair.problem.solve()
    assert report.linear_solver == "multigrid"
    assert np.allclose(pair.contact.nodal().c[:, 0], -2.0, atol=1e-8)
    ff.release(pair.contact)
    pair.load.value[2] = -1.0
    assert pair.problem.solve().contacts[0].force[2] == pytest.approx(1.0, rel=1e-8)


def test_what_cannot_be_tied():
    pair = Pair("cannot_")
    with pytest.raises(ff.ContactInputError, match="within"):
        ff.tie(pair.contact, within=-1.0)
    other = ff.Contact(pair.model.surface("upper/bottom"), pair.contact.obstacle, ff.Frictionless())
    with pytest.raises(ff.ContactInputError, match="has no problem yet"):
        ff.tie(other, within=0.1)
    pair.u.x.array.reshape(-1, 2)[pair.contact.parent_dofs, 1] += 1e-3
    with pytest.raises(ff.ContactInputError, match="no node of 'upper/bottom' is within"):
        ff.tie(pair.contact, within=1e-9)
