"""The contact surface: collocation, nodal areas, measures shared with the loads."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.surfaces.measures import share_facet_data
from models import gathered, raous, tagged_facets

CELLS = {
    "triangle": 2,
    "quadrilateral": 2,
    "tetrahedron": 3,
    "hexahedron": 3,
}


def unit_mesh(cell, n=4, comm=MPI.COMM_WORLD):
    cell_type = getattr(mesh.CellType, cell)
    if CELLS[cell] == 2:
        return mesh.create_unit_square(comm, n, n, cell_type)
    return mesh.create_unit_cube(comm, n, n, n, cell_type)


def bottom(msh):
    height = msh.geometry.dim - 1
    return tagged_facets(
        msh, lambda x: np.isclose(x[height], 0.0), lambda x: np.isclose(x[height], 1.0)
    )


NODES = [*((cell, 1) for cell in CELLS), *((cell, 2) for cell in CELLS if cell != "tetrahedron")]


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "nodes"), NODES)
def test_areas_add_up_and_expressions_are_collocated(cell, nodes):
    msh = unit_mesh(cell)
    surface = ff.ContactSurface(msh, bottom(msh), 1, degree=nodes)
    n = surface.num_owned
    total = msh.comm.allreduce(float(np.sum(surface.area.x.array[:n])), MPI.SUM)
    assert total == pytest.approx(1.0, rel=1e-13)
    x = ufl.SpatialCoordinate(msh)
    values = surface.evaluator(ufl.as_vector([ufl.sin(3 * x[0]), x[0] ** 3]))()
    expected = np.stack([np.sin(3 * surface.x[:, 0]), surface.x[:, 0] ** 3], axis=1)
    assert values == pytest.approx(expected, abs=1e-14)  # nodal values, not projections


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("cell", "nodes"), NODES)
def test_parent_dofs_sit_at_the_contact_nodes(cell, nodes, degree):
    if nodes > degree:
        return
    msh = unit_mesh(cell)
    V = fem.functionspace(msh, ("Lagrange", degree, (msh.geometry.dim,)))
    surface = ff.ContactSurface(msh, bottom(msh), 1, degree=nodes)
    dofs = surface.parent_dofs(V)
    where = V.tabulate_dof_coordinates()[dofs]
    assert where == pytest.approx(surface.S.tabulate_dof_coordinates(), abs=1e-14)


def test_contact_rows_are_node_local():
    """The block dR/dc of contact couples the components of one node, and no two nodes."""
    model = raous(6, 4, 0.5, "local_")
    model.problem.solve()
    matrix = model.problem.projection.jacobian()
    first = model.problem.u.function_space.dofmap.index_map.size_local * 2
    rows = matrix.getSize()[0]
    indptr, indices, values = matrix.getValuesCSR()
    for row in range(first, rows):
        columns = indices[indptr[row] : indptr[row + 1]]
        nonzero = columns[np.abs(values[indptr[row] : indptr[row + 1]]) > 0]
        partners = nonzero[nonzero >= first]
        assert set((partners - first) // 2) <= {(row - first) // 2}


@pytest.mark.mpi
def test_loads_on_the_contact_facets_keep_their_own_quadrature():
    """Tags as MeshTags and as a list of entities."""
    msh = unit_mesh("hexahedron", 3)
    tags = bottom(msh)
    surface = ff.ContactSurface(msh, tags, 1)
    v = ufl.TestFunction(fem.functionspace(msh, ("Lagrange", 1, (3,))))
    x = ufl.SpatialCoordinate(msh)
    tagged = ufl.Measure("ds", domain=msh, subdomain_data=tags)
    listed = ufl.Measure("ds", domain=msh, subdomain_data=[(1, surface.entities)])
    for ds in (tagged, listed):
        load = x[0] ** 2 * v[2] * ds(1, degree=4)
        (shared,) = share_facet_data([load])
        both = fem.assemble_vector(fem.form(shared)).array
        alone = fem.assemble_vector(fem.form(load)).array
        assert both == pytest.approx(alone, abs=1e-15)


@pytest.mark.mpi
def test_untagged_and_multiple_tag_loads_survive():
    msh = unit_mesh("quadrilateral", 3)
    tags = bottom(msh)
    v = ufl.TestFunction(fem.functionspace(msh, ("Lagrange", 1)))
    ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
    load = v * ds + 2.0 * v * ds((1, 2)) + 5.0 * v * ds(2) + v * ufl.dx
    (shared,) = share_facet_data([load])
    alone = fem.assemble_vector(fem.form(load)).array
    both = fem.assemble_vector(fem.form(shared)).array
    assert both == pytest.approx(alone, abs=1e-15)


@pytest.mark.mpi
def test_ranks_without_contact_facets():
    """All contact facets on one rank: a strip of one cell, the others elsewhere."""
    comm = MPI.COMM_WORLD

    msh = mesh.create_rectangle(comm, [[0.0, 0.0], [0.1, 3.0]], [1, 30])
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 3.0))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    stored = ff.bulk.stored_energy(
        ff.bulk.small_strain_energy(u, ff.bulk.Elastic(100.0, 0.0)), ufl.dx
    )
    top = fem.Function(V)
    top.x.array[1::2] = -0.03
    bcs = [fem.dirichletbc(top, fem.locate_dofs_topological(V, 1, tags.find(2)))]
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0, 0), (0, 1)), ff.Coulomb(0.3)
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v), u, contact=contact, bcs=bcs, petsc_options_prefix="strip_"
    )
    report = problem.solve()
    # nu = 0: a bar under 1 % strain, pressure 1, width 0.1.
    assert report.contacts[0].force[1] == pytest.approx(0.1, rel=1e-9)
    facets = comm.allgather(len(contact.surface.entities))
    if comm.size > 1:
        assert 0 in facets


@pytest.mark.mpi
def test_all_ranks_together_equal_one_alone():
    """The same problem on COMM_WORLD and on COMM_SELF."""
    results = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        model = raous(24, 12, 0.7, "ranks_", comm=comm)
        for fractions in ((0.6, 0.8), (1.0, 1.0), (0.2, 0.9)):
            model.load(*fractions)
            report = model.problem.solve()
        results.append((gathered(model.problem), report))
    (x, c, u), report = results[0]
    (X, C, U), alone = results[1]
    assert x == pytest.approx(X, abs=1e-15)
    assert c == pytest.approx(C, abs=1e-9 * np.max(np.abs(C)))
    assert u == pytest.approx(U, abs=1e-9 * np.max(np.abs(U)))
    for name in ("open", "stick", "slip"):
        assert getattr(report.contacts[0], name) == getattr(alone.contacts[0], name)
    assert report.contacts[0].force == pytest.approx(alone.contacts[0].force, rel=1e-9)
    assert report.contacts[0].dissipation == pytest.approx(alone.contacts[0].dissipation, rel=1e-9)


def loaded(load_of):
    """Return the contact force of a strip (see above) under a load on its top."""
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 3, 3)
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(x[1], 0.0),
        lambda x: np.isclose(x[1], 1.0),
        lambda x: np.isclose(x[0], 0.0),
    )
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(100.0, 0.0))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v) - load_of(msh, tags, v)
    held = fem.locate_dofs_topological(V.sub(0), 1, tags.find(3))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0, 0), (0, 1)), ff.Coulomb(0.3)
    )
    problem = ff.FrictionalContactProblem(
        F,
        u,
        contact=contact,
        bcs=fem.dirichletbc(0.0, held, V.sub(0)),
        petsc_options_prefix="loaded_",
    )
    return problem.solve().contacts[0].force[1]


@pytest.mark.mpi
@pytest.mark.parametrize("tag", [2, np.int32(2), np.int64(2), (np.int32(2), 7), (2, 2)])
def test_a_load_counts_whatever_integer_its_tag_is(tag):
    def load(msh, tags, v):
        other = mesh.meshtags(
            msh, 1, tags.indices, np.where(tags.values == 1, 7, tags.values).astype(np.int32)
        )
        return -0.5 * v[1] * ufl.Measure("ds", domain=msh, subdomain_data=other)(tag)

    # What presses on the contact facets themselves (7) goes straight to the plane.
    doubled = isinstance(tag, tuple)
    assert loaded(load) == pytest.approx(1.0 if doubled else 0.5, rel=1e-9)


@pytest.mark.mpi
def test_equal_numbers_of_equal_facets_may_come_from_two_tags():
    def load(msh, tags, v):
        again = mesh.meshtags(msh, 1, tags.indices, tags.values)
        both = (ufl.Measure("ds", domain=msh, subdomain_data=t) for t in (tags, again))
        return sum(-0.5 * v[1] * ds(2) for ds in both)

    assert loaded(load) == pytest.approx(1.0, rel=1e-9)


@pytest.mark.mpi
def test_equal_numbers_of_different_facets_are_refused():
    def load(msh, tags, v):
        swapped = mesh.meshtags(msh, 1, tags.indices, (4 - tags.values).astype(np.int32))
        both = (ufl.Measure("ds", domain=msh, subdomain_data=t) for t in (tags, swapped))
        return sum(-0.5 * v[1] * ds(1) for ds in both)

    with pytest.raises(ff.ContactInputError, match=r"ids \[1\] for different facets"):
        loaded(load)
