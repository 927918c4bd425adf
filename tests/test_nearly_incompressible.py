"""Bodies whose bulk modulus is up to thousands of times their shear modulus."""

from itertools import combinations, count

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix

import fenicsx_friction as ff
from fenicsx_friction.equations.patches import FIRST, TOO_STIFF, felt_stiffness
from models import gathered, tagged_facets
from test_elements import lagrange, mini, quadratic

E, NEARLY, COEFFICIENTS = 1000.0, (0.49, 0.499, 0.4999, 0.49999), (0.1, 0.3, 1.0)
#: Newton's iterations a step, at most: the same as with other bodies.
MOST = 15
#: Displacements of the top: press, stick, slip, turn back.
PRESSED = [(0.0, -0.01), (0.001, -0.01), (0.003, -0.01), (0.02, -0.01), (0.01, -0.01)]
#: Fractions of the pressures on the side and on the top, the base lifts and slips.
LOADED = [(0.3, 0.6), (1.0, 1.0), (0.6, 1.0), (0.1, 1.0), (-0.4, 1.0), (0.9, 0.8)]
numbers = count()


def block(dim, n, cell=None, comm=MPI.COMM_WORLD):
    """A block with ``n`` cells along its length 1; facets: 1 base, 2 top, 3 left, 4 right."""
    size, cells = ((1.0, 0.5), (n, n // 2)) if dim == 2 else ((1.0, 0.75, 0.5), (n, n, n // 2))
    default = {2: "quadrilateral", 3: "hexahedron"}[dim]
    kind, corners = getattr(mesh.CellType, cell or default), [[0.0] * dim, size]
    if dim == 2:
        crossed = mesh.DiagonalType.crossed
        msh = mesh.create_rectangle(comm, corners, cells, kind, diagonal=crossed)
    else:
        msh = mesh.create_box(comm, corners, cells, kind)
    ends = [(dim - 1, 0.0), (dim - 1, size[-1]), (0, 0.0), (0, 1.0)]
    return msh, tagged_facets(msh, *(lambda x, k=k, at=at: np.isclose(x[k], at) for k, at in ends))


def on_plane(tags, msh, F, unknowns, bcs, mu, r_p=None):
    """Put a block on a rigid plane."""
    dim = msh.geometry.dim
    plane = ff.RigidPlane([0.0] * dim, [0.0] * (dim - 1) + [1.0])
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1), plane, ff.Coulomb(mu), r_p=r_p)
    prefix = f"nearly_{next(numbers)}_"
    return ff.FrictionalContactProblem(
        F, unknowns, contact=contact, bcs=bcs, petsc_options_prefix=prefix
    )


def moved(V, tags):
    """A Function that prescribes the top, and the condition."""
    top, dim = fem.Function(V), V.mesh.geometry.dim
    held = fem.locate_dofs_topological(V, dim - 1, tags.find(2))

    def move(step):
        top.x.array.reshape(-1, dim)[held] = [step[0], *[0.0] * (dim - 2), step[1]]

    return move, [fem.dirichletbc(top, held)]


def mean_dilatation(msh, nu, energy="small_strain_energy"):
    """A displacement and its residual, B-bar."""
    u = fem.Function(fem.functionspace(msh, ("Lagrange", 1, (msh.geometry.dim,))))
    density = getattr(ff.bulk, energy)(u, ff.bulk.Elastic(E, nu))
    stored = ff.bulk.stored_energy(density, ufl.dx, bbar=True)
    return u, ufl.derivative(stored, u, ufl.TestFunction(u.function_space))


def followed(problem, load, steps):
    """Solve the steps; return the counts of iterations, and the tractions and displacements."""
    counts, found = [], []
    for step in steps:
        load(step)
        counts.append(problem.solve().iterations)
        found.append(gathered(problem)[1:])
    return counts, found


def pressed(dim, n, nu, mu, energy="small_strain_energy", r_p=None, part=1.0):
    msh, tags = block(dim, n)
    u, F = mean_dilatation(msh, nu, energy)
    move, bcs = moved(u.function_space, tags)
    problem = on_plane(tags, msh, F, u, bcs, mu, r_p)
    return followed(problem, move, part * np.array(PRESSED))


def loaded(dim, n, nu, mu, r_p=None):
    """As the Raous rectangle: pressed from above and from the left, held on the right."""
    msh, tags = block(dim, n)
    u, F = mean_dilatation(msh, nu)
    V, v = u.function_space, ufl.TestFunction(u.function_space)
    sideways, down = fem.Constant(msh, 0.0), fem.Constant(msh, 0.0)
    ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
    F += down * v[dim - 1] * ds(2) - sideways * v[0] * ds(3)
    held = fem.locate_dofs_topological(V.sub(0), dim - 1, tags.find(4))
    bcs = [fem.dirichletbc(0.0, held, V.sub(0))]
    if dim == 3:
        where = mesh.locate_entities_boundary(msh, 2, lambda x: np.isclose(x[1], 0.0))
        bcs.append(fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(1), 2, where), V.sub(1)))

    def load(step):
        sideways.value, down.value = 1.15e-3 * E * step[0], 0.385e-3 * E * step[1]

    return followed(on_plane(tags, msh, F, u, bcs, mu, r_p), load, LOADED)


def assert_same(found, expected):
    """Tractions and displacements of all steps agree to 1e-9 of the largest."""
    for values, references in zip(
        zip(*found, strict=True), zip(*expected, strict=True), strict=True
    ):
        largest = np.max(np.abs(references))
        assert np.array(values) == pytest.approx(np.array(references), rel=0.0, abs=1e-9 * largest)


@pytest.mark.parametrize("run", [pressed, loaded])
@pytest.mark.parametrize(("dim", "n"), [(2, 8), (2, 64), (3, 6)])
def test_few_iterations_and_the_solution_of_a_chosen_scale(run, dim, n):
    for nu in NEARLY:
        for mu in COEFFICIENTS:
            counts, found = run(dim, n, nu, mu)
            assert max(counts) <= MOST, (nu, mu, counts)
            if (nu, mu) == (0.4999, 0.3):
                assert_same(found, run(dim, n, nu, mu, r_p=E * n)[1])


@pytest.mark.parametrize(
    ("dim", "n", "nu", "part"),
    [(2, 16, 0.49, 1.0), (2, 16, 0.499, 1.0), (2, 16, 0.4999, 0.1), (2, 8, 0.49999, 0.1)]
    + [(2, 64, 0.49, 0.1), (2, 64, 0.499, 0.1), (3, 6, 0.499, 1.0), (3, 6, 0.4999, 0.1)],
)
def test_few_iterations_at_finite_strain(dim, n, nu, part):
    for mu in COEFFICIENTS:
        counts, found = pressed(dim, n, nu, mu, "neo_hooke_energy", part=part)
        assert max(counts) <= MOST, (mu, counts)
        if mu == 0.3:
            chosen = pressed(dim, n, nu, mu, "neo_hooke_energy", r_p=E * n, part=part)
            assert_same(found, chosen[1])


@pytest.mark.parametrize(("dim", "n"), [(2, 8), (2, 32), (3, 6)])
@pytest.mark.parametrize("nu", [0.499, 0.49999])
def test_a_pressure_of_its_own_takes_large_steps_at_finite_strain(dim, n, nu):
    """Neo-Hooke with one pressure a cell: Newton's method does not depend on the bulk modulus."""
    msh, tags = block(dim, n)
    V, Q = fem.functionspace(msh, ("Lagrange", 1, (dim,))), fem.functionspace(msh, ("DG", 0))
    material, dx = ff.bulk.Elastic(E, nu), ufl.dx(degree=2)
    for mu in COEFFICIENTS:
        u, p = fem.Function(V), fem.Function(Q)
        isochoric, _ = ff.bulk.neo_hooke_energy(u, material)
        volume = ufl.ln(ufl.det(ufl.Identity(dim) + ufl.grad(u)))
        L = (isochoric + p * volume - p**2 / (2.0 * material.bulk_modulus)) * dx
        F = [ufl.derivative(L, f, ufl.TestFunction(f.function_space)) for f in (u, p)]
        move, bcs = moved(V, tags)
        counts, _ = followed(on_plane(tags, msh, F, [u, p], bcs, mu), move, PRESSED)
        assert max(counts) <= MOST, (mu, counts)


def strips(problem, parts=5):
    """Return the mean pressures of strips of the base, from the left (one rank)."""
    x, c, _ = gathered(problem)
    x, p = x[:, 0], c[:, 0]
    sums = np.append(0.0, np.cumsum(np.diff(x) * (p[1:] + p[:-1]) / 2.0))
    return parts * np.diff(np.interp(np.linspace(0.0, 1.0, parts + 1), x, sums))


def compared(kind, n, nu=0.4999, mu=0.3):
    """Press and drag a block of B-bar, MINI or Taylor-Hood elements; forces and strip pressures."""
    cell = "quadrilateral" if kind is lagrange else "triangle"
    msh, tags = block(2, n, cell, comm=MPI.COMM_SELF)
    if kind is lagrange:
        u, F = mean_dilatation(msh, nu)
        unknowns, V = u, u.function_space
    else:
        V, Q = fem.functionspace(msh, kind(cell)), fem.functionspace(msh, ("Lagrange", 1))
        (u, v), (p, q) = ((fem.Function(W), ufl.TestFunction(W)) for W in (V, Q))
        material = ff.bulk.Elastic(E, nu)
        strain, shear = ufl.sym(ufl.grad(u)), material.shear_modulus
        stress = 2.0 * shear * (strain - ufl.div(u) / 3.0 * ufl.Identity(2)) - p * ufl.Identity(2)
        F = [
            ufl.inner(stress, ufl.grad(v)) * ufl.dx,
            (ufl.div(u) + p / material.bulk_modulus) * q * ufl.dx,
        ]
        unknowns = [u, p]
    move, bcs = moved(V, tags)
    problem, found = on_plane(tags, msh, F, unknowns, bcs, mu), []
    for step in [(0.0, -0.01), (0.02, -0.01)]:
        move(step)
        report = problem.solve()
        assert report.iterations <= MOST
        found.append(np.append(report.contacts[0].force, strips(problem)))
    return np.array(found)


def test_taylor_hood_mini_and_mean_dilatation_agree():
    """Forces, and pressures of strips, within 1 % of the largest, and they come closer."""
    for n, share in ((16, 0.03), (64, 0.01)):
        found = [compared(kind, n) for kind in (lagrange, mini, quadratic)]
        normal, largest = found[2][:, 1:2], np.max(found[2][:, 2:])
        for one, other in combinations(found, 2):
            assert np.all(abs(one - other)[:, :2] <= share * normal), n
            assert np.all(abs(one - other)[:, 2:] <= share * largest), n


def with_stiffness(msh, nu):
    """Stiffness of B-bar, its diagonal, and the dofs of the base."""
    u, F = mean_dilatation(msh, nu)
    K = assemble_matrix(fem.form(ufl.derivative(F, u)))
    K.assemble()
    diagonal = fem.Function(u.function_space)
    diagonal.x.array[: K.getLocalSize()[0]] = K.getDiagonal().array
    diagonal.x.scatter_forward()
    d = msh.geometry.dim
    nodes = fem.locate_dofs_geometrical(u.function_space, lambda x: np.isclose(x[d - 1], 0.0))
    nodes = np.sort(nodes[nodes < u.function_space.dofmap.index_map.size_local])
    return K, diagonal, (d * nodes[:, None] + np.arange(d)).ravel()


@pytest.mark.parametrize(("dim", "n"), [(2, 4), (2, 2 * FIRST), (3, 4)])
def test_what_a_node_feels_is_the_schur_complement_of_its_patch(dim, n):
    K, diagonal, dofs = with_stiffness(block(dim, n, comm=MPI.COMM_SELF)[0], 0.4999)
    felt = felt_stiffness(K, diagonal, dofs)
    inside = np.setdiff1d(np.arange(len(felt.x.array)), dofs)
    assert np.array_equal(felt.x.array[inside], diagonal.x.array[inside])
    for node in dofs[::dim][:: max(n // 8, 1)]:
        own = np.arange(node, node + dim)
        patch = np.unique(np.concatenate([K.getRow(i)[0] for i in own]))
        rows = PETSc.IS().createGeneral(patch, comm=PETSc.COMM_SELF)
        dense = K.createSubMatrix(rows, rows).convert("dense").getDenseArray()
        compliance = np.linalg.inv(dense)[np.ix_(*[np.searchsorted(patch, own)] * 2)]
        expected = np.trace(np.linalg.inv(compliance)) / dim
        assert felt.x.array[own] == pytest.approx(expected, rel=1e-6)
        assert expected < diagonal.x.array[own].mean() / 100.0


@pytest.mark.mpi
@pytest.mark.parametrize("dim", [2, 3])
def test_the_felt_stiffness_does_not_depend_on_the_ranks(dim):
    found = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        K, diagonal, dofs = with_stiffness(block(dim, 8, comm=comm)[0], 0.4999)
        felt = felt_stiffness(K, diagonal, dofs).x.array[dofs]
        found.append(comm.allreduce(np.array([felt.sum(), (felt**2).sum()])))
    assert found[0] == pytest.approx(found[1], rel=1e-9)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.4])
def test_compressible_bodies_keep_their_diagonal(nu):
    for dim in (2, 3):
        K, diagonal, dofs = with_stiffness(block(dim, 8)[0], nu)
        assert np.array_equal(felt_stiffness(K, diagonal, dofs).x.array, diagonal.x.array)


@pytest.mark.parametrize("n", [1, 2])
def test_a_body_of_one_patch_keeps_its_diagonal(n):
    """Without nodes that are held, a patch resists nothing."""
    msh = mesh.create_rectangle(
        MPI.COMM_SELF, [[0.0, 0.0], [1.0, 1.0]], [n, 1], mesh.CellType.quadrilateral
    )
    K, diagonal, dofs = with_stiffness(msh, 0.3)
    felt = felt_stiffness(K, diagonal, dofs).x.array
    assert np.all((felt == diagonal.x.array) | (TOO_STIFF * felt < diagonal.x.array))
    assert np.all(felt > 1e-3 * diagonal.x.array)


def test_the_certificate_keeps_the_diagonal_and_a_given_scale_is_kept():
    for r_p in (None, 1.0):
        msh, tags = block(2, 8)
        u, F = mean_dilatation(msh, 0.4999)
        (contact,) = on_plane(tags, msh, F, u, moved(u.function_space, tags)[1], 0.3, r_p).contacts
        assert np.all(contact.scale.x.array > 100.0 * E * 8)
        assert np.all(contact.felt.x.array < 3.0 * E * 8)
        rows = contact.felt.x.array if r_p is None else 1.0
        assert np.all(contact.r.x.array == rows)


def mixed(dim, cell, numbers, nu, mu, length=1.0, young=1.0):
    """A block of neo-Hooke, quadratic with a linear pressure, on a plane; and what moves its top.

    Args:
        length: Unit of length: 1e3 for mm.
        young: Factor of Young's modulus, in the unit of pressure.
    """
    make = mesh.create_rectangle if dim == 2 else mesh.create_box
    low, high = [-0.5 * length] * (dim - 1) + [0.0], [0.5 * length] * dim
    msh = make(MPI.COMM_WORLD, [low, high], numbers, getattr(mesh.CellType, cell))
    up = dim - 1
    tags = tagged_facets(
        msh, *(lambda x, at=at: np.isclose(x[up], at, atol=1e-9 * length) for at in (0.0, high[up]))
    )
    V, Q = (fem.functionspace(msh, e) for e in (("Lagrange", 2, (dim,)), ("Lagrange", 1)))
    (u, p), (v, q) = (fem.Function(V), fem.Function(Q)), map(ufl.TestFunction, (V, Q))
    shear = young * E / 2.0 / (1.0 + nu)
    bulk = 2.0 * shear * nu / (1.0 - 2.0 * nu)
    F = ufl.Identity(dim) + ufl.grad(u)
    stress = shear * (F - ufl.inv(F).T) + p * ufl.det(F) * ufl.inv(F).T
    forms = [
        ufl.inner(stress, ufl.grad(v)) * ufl.dx,
        (ufl.det(F) - 1.0 - p / bulk) * q * ufl.dx,
    ]
    move, bcs = moved(V, tags)
    return on_plane(tags, msh, forms, [u, p], bcs, mu), move


def test_a_pressure_of_its_own_takes_the_same_steps_in_all_units():
    """A volume in mm³ is a large number beside a force in N: neither may drown the other."""
    found = []
    for length, young in ((1.0, 1.0), (1e3, 1e-6), (1e3, 1.0), (1e6, 1e-12)):
        problem, move = mixed(2, "triangle", (8, 4), 0.49, 0.2, length, young)
        counts, forces = [], []
        for step in ((0.0, -0.02), (0.02, -0.04)):
            move(length * np.array(step))
            report = problem.solve()
            counts.append(report.iterations)
            forces.append(np.array(report.contacts[0].force) / young / length)
        found.append((counts, forces))
    for counts, forces in found[1:]:
        assert counts == found[0][0]
        assert np.allclose(forces, found[0][1], rtol=1e-8, atol=1e-8 * np.max(np.abs(forces)))


@pytest.mark.mpi
def test_the_tangent_of_a_body_with_a_pressure_of_its_own():
    problem, move = mixed(2, "triangle", (4, 2), 0.49, 0.2, 1e3)
    move(1e3 * np.array((0.01, -0.02)))
    assert problem.solve().certified
    report = ff.check_jacobian(problem)
    assert report.error < 1e-6, str(report)
    assert {check.block for check in report.checks} >= {"momentum", "block 1"}


@pytest.mark.mpi
@pytest.mark.parametrize("way", [(0.05, 0.05), (0.0, 0.01), (0.0, 1e-6)])
def test_a_mixed_body_that_touches_nothing_goes_where_it_is_moved(way):
    """What is left of its stresses is the rounding of changes of volume, times the bulk modulus."""
    problem, move = mixed(3, "tetrahedron", (3, 2, 2), 0.4, 0.0)
    move(way)
    report = problem.solve()
    assert report.certified
    assert report.contacts[0].stick == report.contacts[0].slip == 0
    u = problem.u.x.array.reshape(-1, 3)
    assert np.allclose(u, [way[0], 0.0, way[1]], rtol=0.0, atol=1e-13)
