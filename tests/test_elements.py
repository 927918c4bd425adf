"""The displacements that are accepted give the exact force; the quadrature leaves no soft mode."""

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from models import tagged_facets

CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
E, NU, PRESS, HEIGHT = 1000.0, 0.3, 0.01, 2.0
SHEAR, BULK = E / (2.0 * (1.0 + NU)), E / (3.0 * (1.0 - 2.0 * NU))
MINI = {"triangle": 3, "tetrahedron": 4}
MOMENTS = {
    "lagrange_variant": basix.LagrangeVariant.legendre,
    "dpc_variant": basix.DPCVariant.legendre,
}


def lagrange(cell, degree=1):
    return basix.ufl.element("Lagrange", cell, degree, shape=(CELLS[cell],))


def mini(cell):
    bubble = basix.ufl.element("Bubble", cell, MINI[cell])
    scalar = basix.ufl.enriched_element([basix.ufl.element("Lagrange", cell, 1), bubble])
    return basix.ufl.blocked_element(scalar, shape=(CELLS[cell],))


def quadratic(cell):
    return lagrange(cell, 2)


def cubic(cell):
    return lagrange(cell, 3)


def quadratic_with_bubbles(cell):
    parts = [basix.ufl.element("P", cell, 2), basix.ufl.element("Bubble", cell, 3)]
    return basix.ufl.blocked_element(basix.ufl.enriched_element(parts), shape=(CELLS[cell],))


ACCEPTED = [
    *(("P1 or Q1", lagrange, cell) for cell in CELLS),
    *(("P2 or Q2", quadratic, cell) for cell in CELLS),
    *(("P3 or Q3", cubic, cell) for cell in ("triangle", "quadrilateral", "tetrahedron")),
    *(("MINI", mini, cell) for cell in MINI),
    ("P2 with bubbles", quadratic_with_bubbles, "triangle"),
]
accepted = pytest.mark.parametrize(
    ("make", "cell"), [row[1:] for row in ACCEPTED], ids=[f"{a} {c}" for a, _, c in ACCEPTED]
)


def column(cell):
    """A column of a mesh without symmetry, whose inner nodes are off the lattice."""
    d = CELLS[cell]
    kind, low, high = getattr(mesh.CellType, cell), [0.0] * d, [1.0] * (d - 1) + [HEIGHT]
    make = mesh.create_rectangle if d == 2 else mesh.create_box
    msh = make(MPI.COMM_WORLD, [low, high], [3] * d, kind)
    x = msh.geometry.x
    inner = np.all((x[:, :d] > 0.01) & (x[:, :d] < np.array(high) - 0.01), axis=1)
    waves = [0.05 * np.sin(17.0 * x.sum(axis=1) + 3.0 * k) for k in range(d)]
    x[inner, :d] += np.stack(waves, axis=1)[inner]
    return msh


def stress():
    """The vertical stress of a column that may widen, in plane strain (2D) or free (3D)."""
    return {2: E / (1.0 - NU**2) * PRESS / HEIGHT, 3: E * PRESS / HEIGHT}


def pressed(msh, V):
    """Conditions of a column whose top is pressed down, free to widen; the contact of its base."""
    d = msh.geometry.dim
    up = d - 1
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(x[up], 0.0),
        lambda x: np.isclose(x[up], HEIGHT),
        *(lambda x, k=k: np.isclose(x[k], 0.0) for k in range(d - 1)),
    )
    sides = [(2, up, -PRESS), *((3 + k, k, 0.0) for k in range(d - 1))]
    bcs = [
        fem.dirichletbc(
            value, fem.locate_dofs_topological(V.sub(k), d - 1, tags.find(tag)), V.sub(k)
        )
        for tag, k, value in sides
    ]
    plane = ff.RigidPlane([0.0] * d, [0.0] * up + [1.0])
    return bcs, ff.Contact(ff.ContactSurface(msh, tags, 1), plane, ff.Coulomb(0.0))


@pytest.mark.quick
@pytest.mark.mpi
@accepted
def test_a_pressed_column_has_its_exact_force_and_stress(make, cell):
    msh = column(cell)
    V = fem.functionspace(msh, make(cell))
    u = fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU))
    energy = ff.bulk.stored_energy(density, ufl.dx)
    bcs, contact = pressed(msh, V)
    F = ufl.derivative(energy, u, ufl.TestFunction(V))
    problem = ff.FrictionalContactProblem(
        F, u, contact=contact, bcs=bcs, petsc_options_prefix="column_"
    )
    report, exact = problem.solve(), stress()[msh.geometry.dim]
    assert report.contacts[0].force[-1] == pytest.approx(exact, rel=1e-10)
    # Not only the sum: at every node.
    assert contact.nodal().c[:, 0] == pytest.approx(exact, rel=1e-9)
    strained = msh.comm.allreduce(fem.assemble_scalar(fem.form(energy)), MPI.SUM)
    assert strained == pytest.approx(exact * PRESS / 2.0, rel=1e-10)


MIXED = [(mini, cell) for cell in MINI] + [(quadratic, cell) for cell in CELLS]


@pytest.mark.mpi
@pytest.mark.parametrize(("make", "cell"), MIXED)
def test_mini_and_taylor_hood_with_a_pressure_have_their_exact_force(make, cell):
    """Two unknowns [u, p], the mixed form of the same column."""
    msh = column(cell)
    V, Q = fem.functionspace(msh, make(cell)), fem.functionspace(msh, ("Lagrange", 1))
    (u, v), (p, q) = ((fem.Function(W), ufl.TestFunction(W)) for W in (V, Q))
    strain = ufl.sym(ufl.grad(u))
    deviatoric = 2.0 * SHEAR * (ufl.inner(strain, ufl.grad(v)) - ufl.div(u) * ufl.div(v) / 3.0)
    F = [(deviatoric - p * ufl.div(v)) * ufl.dx, (ufl.div(u) + p / BULK) * q * ufl.dx]
    bcs, contact = pressed(msh, V)
    problem = ff.FrictionalContactProblem(
        F, [u, p], contact=contact, bcs=bcs, petsc_options_prefix="mixed_"
    )
    report = problem.solve()
    assert report.contacts[0].force[-1] == pytest.approx(stress()[msh.geometry.dim], rel=1e-10)


@pytest.mark.parametrize("cell", CELLS)
def test_displacements_that_do_not_follow_curved_facets_are_refused(cell):
    d = CELLS[cell]
    msh = mesh.create_mesh(MPI.COMM_SELF, *one_curved_cell(cell))
    V = fem.functionspace(msh, ("Lagrange", 1, (d,)))
    with pytest.raises(
        ff.ContactInputError, match=r"degree 1 on the facets.*geometry has degree 2"
    ):
        pressed_on_a_plane(msh, V)


@pytest.mark.parametrize("cell", CELLS)
def test_a_cell_that_is_curved_into_itself_is_refused(cell):
    d = CELLS[cell]
    cells, element, points = one_curved_cell(cell)
    middle = np.argmin(np.linalg.norm(points - 0.5 * np.eye(d)[0], axis=1))
    points[middle, 0] = 2.0
    msh = mesh.create_mesh(MPI.COMM_SELF, cells, element, points)
    with pytest.raises(ff.ContactInputError, match=r"curved so much that det J has both signs"):
        pressed_on_a_plane(msh, fem.functionspace(msh, ("Lagrange", 2, (d,))))


def one_curved_cell(cell):
    """Return cells, coordinate element and points of one cell of degree 2."""
    variant = basix.LagrangeVariant.equispaced
    kind = getattr(basix.CellType, cell)
    points = basix.create_element(basix.ElementFamily.P, kind, 2, variant).points.copy()
    second = basix.ufl.element("Lagrange", cell, 2, lagrange_variant=variant, shape=(CELLS[cell],))
    return np.arange(len(points))[None, :], second, points


def pressed_on_a_plane(msh, V):
    """Make a problem of one cell on a plane."""
    d = msh.geometry.dim
    tags = tagged_facets(msh, lambda x: np.isclose(x[d - 1], 0.0))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1.0, 0.3))
    plane = ff.RigidPlane([0.0] * d, [0.0] * (d - 1) + [1.0])
    return ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=ff.Contact(ff.ContactSurface(msh, tags, 1), plane, ff.Frictionless()),
        petsc_options_prefix="curved_",
    )


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
@pytest.mark.parametrize(("degree", "nodes"), [(2, 1), (2, 2), (3, 1)])
def test_a_curved_ring_on_a_cylinder_converges(cell, degree, nodes):
    """A ring of cells of degree 2, shrunk on a rigid cylinder: Lamé's pressure, of order four."""
    names = {n: f"ring_{cell}_{degree}_{nodes}_{n}_" for n in (4, 8)}
    errors = [ring_on_a_cylinder(cell, n, degree, nodes, name) for n, name in names.items()]
    assert errors[1] < 3e-4
    assert errors[1] < errors[0] / 12.0


#: Radii of the ring, by how much the cylinder is thicker (m), Young's modulus (Pa), nu.
RING = 1.0, 2.0, 0.01, 1000.0, 0.3


def ring(cell, n, degree, name, nodes=1):
    """Return the problem of a quarter of a ring on a rigid cylinder, plane strain."""
    inner, outer, excess, E, nu = RING
    kind = getattr(mesh.CellType, cell)
    flat = mesh.create_rectangle(MPI.COMM_WORLD, [[0.0, 0.0], [1.0, 1.0]], [n // 2, n], kind)
    element = basix.ufl.element("Lagrange", cell, 2, shape=(2,))
    W = fem.functionspace(flat, element)
    x = W.tabulate_dof_coordinates()[: W.dofmap.index_map.size_local]
    r, angle = inner + (outer - inner) * x[:, 0], np.pi / 2.0 * x[:, 1]
    own = W.dofmap.list[: flat.topology.index_map(2).size_local]
    cells = W.dofmap.index_map.local_to_global(own.ravel()).reshape(own.shape)
    x = np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    msh = mesh.create_mesh(MPI.COMM_WORLD, cells, element, x)
    sides = [lambda x: np.hypot(x[0], x[1]) < inner + 1e-6]
    sides += [lambda x, k=k: np.isclose(x[k], 0.0) for k in (0, 1)]
    tags = tagged_facets(msh, *sides)
    V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, nu))
    held = [fem.locate_dofs_topological(V.sub(k), 1, tags.find(2 + k)) for k in (0, 1)]
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, degree=nodes),
        ff.RigidSphere((0.0, 0.0), inner + excess),
        ff.Frictionless(),
    )
    return ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(0.0, dofs, V.sub(k)) for k, dofs in enumerate(held)],
        petsc_options_prefix=name,
    )


def ring_on_a_cylinder(cell, n, degree, nodes, name):
    """Return the relative error of the mean pressure on the cylinder."""
    inner, outer, excess, E, nu = RING
    problem = ring(cell, n, degree, name, nodes)
    (contact,) = problem.contacts
    assert problem.solve().certified
    # u = A r + B / r, without stress outside.
    G, lam = E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    stresses = [[inner, 1.0 / inner], [2.0 * (lam + G), -2.0 * G / outer**2]]
    A, B = np.linalg.solve(stresses, [excess, 0.0])
    exact = 2.0 * G * B / inner**2 - 2.0 * (lam + G) * A
    sums = [
        np.sum(contact.nodal_area() * contact.multipliers()[:, 0]),
        np.sum(contact.nodal_area()),
    ]
    force, area = problem.comm.allreduce(np.array(sums))
    return abs(force / area / exact - 1.0)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_vertex_dofs_must_be_values(cell, monkeypatch):
    """An element whose dofs at the vertices are twice the values there."""
    from fenicsx_friction.surfaces import elements

    scalar = basix.ufl.element("Lagrange", cell, 1)
    assert elements._unfit(scalar) is None
    tabulate = type(scalar).tabulate
    monkeypatch.setattr(type(scalar), "tabulate", lambda *a: 2.0 * tabulate(*a))
    assert "not the values" in elements._unfit(scalar)


@pytest.mark.parametrize(
    "scalar",
    [
        basix.ufl.element("Serendipity", "quadrilateral", 2, **MOMENTS),
        basix.ufl.element("P", "triangle", 2, lagrange_variant=basix.LagrangeVariant.bernstein),
    ],
    ids=["serendipity", "bernstein"],
)
def test_dofs_between_the_vertices_must_be_values(scalar):
    msh = column(scalar.cell_type.name)
    u = fem.Function(fem.functionspace(msh, basix.ufl.blocked_element(scalar, shape=(2,))))
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0))
    plane = ff.RigidPlane((0.0, 0.0), (0.0, 1.0))
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1), plane, ff.Coulomb(0.0))
    F = ufl.derivative(ufl.inner(ufl.grad(u), ufl.grad(u)) * ufl.dx, u)
    with pytest.raises(ff.ContactInputError, match="dofs on edges or facets that are not values"):
        ff.FrictionalContactProblem(F, u, contact=contact, petsc_options_prefix="dofs_")


@pytest.mark.parametrize(
    ("element", "rigid"),
    [
        *((make(cell), CELLS[cell]) for _, make, cell in ACCEPTED),
    ],
    ids=str,
)
def test_only_rigid_modes_have_no_energy(element, rigid):
    """The eigenvalues of a distorted cell's stiffness at the default degree."""
    d, cell = rigid, element.cell_type.name
    corners = basix.geometry(element.cell_type)
    x = corners + 0.1 * np.sin(5.0 * corners.sum(axis=1)[:, None] + np.arange(d))
    msh = mesh.create_mesh(MPI.COMM_SELF, np.arange(len(x))[None, :], lagrange(cell), x)
    u = fem.Function(fem.functionspace(msh, element))
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU))
    energy = ff.bulk.stored_energy(density, ufl.dx)
    K = fem.assemble_matrix(fem.form(ufl.derivative(ufl.derivative(energy, u), u))).to_dense()
    values = np.linalg.eigvalsh(K)
    zero = int(np.sum(values < 1e-9 * values[-1]))
    assert zero == d * (d + 1) // 2
    assert values[zero] > 1e-4 * values[-1]


@pytest.mark.parametrize(
    ("element", "degree"),
    [(lagrange("quadrilateral"), 1), (lagrange("hexahedron"), 1), (lagrange("triangle", 2), 1)]
    + [(lagrange("quadrilateral", 2), 3), (lagrange("hexahedron", 2), 2), (mini("triangle"), 1)],
    ids=str,
)
def test_a_degree_with_soft_modes_is_refused(element, degree):
    d, corners = len(basix.topology(element.cell_type)) - 1, basix.geometry(element.cell_type)
    flat = lagrange(element.cell_type.name)
    msh = mesh.create_mesh(MPI.COMM_SELF, np.arange(len(corners))[None, :], flat, corners)
    u = fem.Function(fem.functionspace(msh, element))
    density = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E, NU))
    with pytest.raises(ff.ContactInputError, match=f"degree = {degree} is too small"):
        ff.bulk.stored_energy(density, ufl.dx, degree=degree)
    # The modes are there: the rank of what would have been assembled shows them.
    energy = sum(part * ufl.dx(degree=degree) for part in density)
    K = fem.assemble_matrix(fem.form(ufl.derivative(ufl.derivative(energy, u), u))).to_dense()
    values = np.linalg.eigvalsh(K)
    assert np.sum(values < 1e-9 * values[-1]) > d * (d + 1) // 2


@pytest.mark.parametrize(("make", "cell"), [(lagrange, cell) for cell in CELLS])
def test_the_degree_of_linear_elements_is_two(make, cell):
    """As ever: their digits do not change."""
    msh = column(cell)
    u = fem.Function(fem.functionspace(msh, make(cell)))
    density = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E, NU))
    (integral, *_) = ff.bulk.stored_energy(density, ufl.dx).integrals()
    assert integral.metadata()["quadrature_degree"] == 2
