"""Mortar contact of two bodies whose faces do not match, against closed forms."""

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import stack
from models import gathered, tagged_facets
from rings import half_ring

# -- hollow spheres of Lamé -----------------------------------------------------------------------


def eighth(n, layers, inner, outer, degree):
    """Points and cells of an eighth of a hollow sphere: 3 n² × layers curved hexahedra."""
    kind, variant = basix.ElementFamily.P, basix.LagrangeVariant.gll_warped
    local = basix.create_element(kind, basix.CellType.hexahedron, degree, variant).points
    numbers, points, cells = {}, [], []
    for turn, i, j, layer in np.ndindex(3, n, n, layers):
        cell = []
        for a, b, c in local:
            ray = np.array([1.0, *np.tan(np.pi / 4.0 * (np.array([i, j]) + [a, b]) / n)])
            ray = np.roll(ray, turn) / np.linalg.norm(ray)
            point = (inner + (outer - inner) * (layer + c) / layers) * ray
            key = tuple(np.round(point, 7) + 0.0)
            if key not in numbers:
                numbers[key] = len(points)
                points.append(point)
            cell.append(numbers[key])
        cells.append(cell)
    return np.array(points), np.array(cells)


def spheres(n, m, mu, degree, name):
    """Two hollow spheres (mm), E = 2000 MPa, nu = 0.3, with a pressure of 25 MPa inside."""
    (x, cells), (y, others) = (
        eighth(k, max(k // 2, 1), *radii, degree)
        for k, radii in ((n, (20.0, 30.0)), (m, (30.0, 40.0)))
    )
    element = basix.ufl.element("Lagrange", "hexahedron", degree, shape=(3,))
    msh = mesh.create_mesh(
        MPI.COMM_SELF, np.concatenate([cells, others + len(x)]), element, np.concatenate([x, y])
    )
    length = lambda x: np.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2)  # noqa: E731
    at = [lambda x, r=r: np.isclose(length(x), r) for r in (30.0, 20.0)]
    tags = tagged_facets(msh, *at)
    msh.topology.create_connectivity(2, 3)
    owner = msh.topology.connectivity(2, 3)
    owners = np.array([owner.links(f)[0] for f in tags.indices], dtype=np.int32)
    outside = np.linalg.norm(mesh.compute_midpoints(msh, 3, owners), axis=1) > 30.0
    values = np.where((tags.values == 1) & outside, 3, tags.values).astype(np.int32)
    tags = mesh.meshtags(msh, 2, tags.indices, values)
    V = fem.functionspace(msh, ("Lagrange", degree, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(2000.0, 0.3))
    ds = ufl.Measure("ds", msh, subdomain_data=tags)
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    F += 25.0 * ufl.dot(ufl.FacetNormal(msh), v) * ds(2)
    bcs = []
    for k in range(3):
        facets = mesh.locate_entities_boundary(msh, 2, lambda x, k=k: np.isclose(x[k], 0.0))
        dofs = fem.locate_dofs_topological(V.sub(k), 2, facets)
        bcs.append(fem.dirichletbc(0.0, dofs, V.sub(k)))
    obstacle = ff.DeformableObstacle(
        ff.ContactSurface(msh, tags, 3, "outer"), method="mortar", close_gaps=1.5
    )
    law = ff.Coulomb(mu) if mu else ff.Frictionless()
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1, "inner"), obstacle, law)
    problem = ff.FrictionalContactProblem(F, u, contact=contact, bcs=bcs, petsc_options_prefix=name)
    return problem, contact


@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize(("n", "m", "degree", "worst"), [(6, 4, 1, 0.025), (3, 2, 2, 0.008)])
def test_concentric_hollow_spheres(n, m, degree, worst, mu):
    """Code_aster V6.03.173: pressure 4.894180 MPa, u_r = 0.103968 mm (Lamé), with any friction."""
    problem, contact = spheres(n, m, mu, degree, f"lame_{n}_{degree}_{mu}_")
    report = problem.solve()
    assert sum(s.iterations for s in report.substeps) <= 6
    p, area = contact.multipliers()[:, 0], contact.nodal_area()
    assert p == pytest.approx(4.894180, rel=worst)
    assert np.sum(area * p) / np.sum(area) == pytest.approx(4.894180, rel=5e-3)
    X = problem.u.function_space.tabulate_dof_coordinates()
    r = np.linalg.norm(X, axis=1)
    radial = np.sum(problem.u.x.array.reshape(-1, 3) * X, axis=1) / r
    assert radial[np.isclose(r, 30.0)] == pytest.approx(0.103968, rel=0.025)


# -- a crack under compression --------------------------------------------------------------------

HALF, ANGLE, FRICTION = 1.0, np.radians(20.0), np.tan(np.radians(30.0))
LOAD, MODULUS, RATIO = 100.0, 25e3, 0.25


def cracked(upper, lower, far=12.0):
    """A sheet with a crack along x whose lips have so many faces; the rest is joined."""
    first, sizes = HALF / max(upper, lower), []
    while sum(sizes) < far - HALF:
        sizes.append(min(sizes[-1] * 1.25, 1.5) if sizes else first)
    sizes = np.array(sizes) * (far - HALF) / sum(sizes)
    outer = HALF + np.concatenate([[0.0], np.cumsum(sizes)])
    height = np.concatenate([[0.0], np.cumsum(sizes)])
    numbers, points, cells = {}, [], []

    def node(x, y, side):
        """Number a point; the lips of the crack have points of their own."""
        key = (round(x, 9), round(y, 9), side if y == 0.0 and abs(x) < HALF - 1e-9 else 0)
        if key not in numbers:
            numbers[key] = len(points)
            points.append((x, y))
        return numbers[key]

    for n, side in ((upper, 1.0), (lower, -1.0)):
        x = np.concatenate([-outer[:0:-1], np.linspace(-HALF, HALF, n + 1), outer[1:]])
        for j, i in np.ndindex(len(height) - 1, len(x) - 1):
            corners = [(i + a, j + b) for b in (0, 1) for a in (0, 1)]
            cells.append([node(x[k], side * height[m], side) for k, m in corners])
    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    return mesh.create_mesh(MPI.COMM_SELF, np.array(cells), element, np.array(points)), far


def closed_crack(upper, lower, name):
    """Compress the sheet by 100 MPa at 20 degrees to the crack; return contact and error of slip.

    Plane strain, E = 25 GPa, nu = 0.25, friction of 30 degrees (Phan et al., 2003; GEOS).
    """
    msh, far = cracked(upper, lower)
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(x[1], 0.0) & (abs(x[0]) < HALF + 1e-9),
        lambda x: (abs(x[0]) > far - 1e-6) | (abs(x[1]) > far - HALF - 1e-6),
    )
    msh.topology.create_connectivity(1, 2)
    owner = msh.topology.connectivity(1, 2)
    owners = np.array([owner.links(f)[0] for f in tags.indices], dtype=np.int32)
    below = mesh.compute_midpoints(msh, 2, owners)[:, 1] < 0.0
    values = np.where((tags.values == 1) & below, 3, tags.values).astype(np.int32)
    tags = mesh.meshtags(msh, 1, tags.indices, values)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    way = np.array([np.cos(ANGLE), np.sin(ANGLE)])
    stress = ufl.as_matrix((-LOAD * np.outer(way, way)).tolist())
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(MODULUS, RATIO))
    ds = ufl.Measure("ds", msh, subdomain_data=tags)
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    F -= ufl.dot(stress * ufl.FacetNormal(msh), v) * ds(2)
    X = V.tabulate_dof_coordinates()
    corners = [np.argmin(X @ [1.0, 1.0, 0.0]), np.argmin(X @ [-1.0, 1.0, 0.0])]
    bcs = []
    for corner, k in ((corners[0], 0), (corners[0], 1), (corners[1], 1)):
        dofs = np.array([2 * corner + k], dtype=np.int32)
        bcs.append(fem.dirichletbc(0.0, dofs, V.sub(k)))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "upper lip"),
        ff.DeformableObstacle(ff.ContactSurface(msh, tags, 3, "lower lip"), method="mortar"),
        ff.Coulomb(FRICTION),
    )
    problem = ff.FrictionalContactProblem(F, u, contact=contact, bcs=bcs, petsc_options_prefix=name)
    assert problem.solve().certified
    return contact


def test_a_closed_crack_slips_as_in_closed_form():
    """t_N = -11.697778 MPa, and the slip of an ellipse, 3.80785 mm at most; of first order.

    The tips belong to both lips: their hats are given to the nodes beside.
    """
    largest = 4.0 * (1.0 - RATIO**2) / MODULUS * LOAD * np.sin(ANGLE)
    largest *= np.cos(ANGLE) - np.sin(ANGLE) * FRICTION
    assert largest == pytest.approx(3.8078498e-3, rel=1e-7)
    errors = []
    for upper, lower in ((24, 16), (48, 32)):
        contact = closed_crack(upper, lower, f"crack_{upper}_")
        x, inside = contact.surface.x[:, 0], abs(contact.surface.x[:, 0]) < 0.9
        slip = abs(contact.slip_increment[:, 0])
        exact = largest * np.sqrt(np.maximum(1.0 - x**2, 0.0))
        errors.append(np.linalg.norm((slip - exact)[inside]) / np.linalg.norm(exact[inside]))
        p, middle = contact.multipliers()[:, 0], abs(x) < 0.5
        assert p[middle] == pytest.approx(11.697778, rel=0.02 if upper == 24 else 0.004)
    assert errors[1] < 0.018
    assert errors[1] < 0.6 * errors[0]


# -- sliding --------------------------------------------------------------------------------------


def test_friction_of_a_sliding_ring_is_steady():
    """Faces come and go: the ratio of the forces stays the same within 0.3 %.

    It is smaller than mu by the strain of the block's surface, which is stretched below the ring:
    what friction dissipates is the work of the ring.
    """
    problem, top = half_ring("ring_")
    ratios, normal = [], []
    for x in np.arange(0.05, 0.95, 0.05):
        top.value[:] = (x, -0.1)
        force = problem.solve().contacts[0].force
        ratios.append(-force[0] / force[1])
        normal.append(force[1])
    steady = np.array(ratios[8:]) / np.mean(ratios[8:])
    assert abs(steady - 1.0).max() < 3e-3
    assert np.mean(ratios[8:]) == pytest.approx(0.3, rel=0.02)
    assert np.std(np.diff(normal[8:], 2)) < 1e-3 * np.mean(normal)


@pytest.mark.parametrize("cell", ["quadrilateral", "tetrahedron"])
def test_the_path_is_the_way_over_the_base(cell):
    """However many faces the block slides over, in one step or in several."""
    d = 2 if cell == "quadrilateral" else 3
    shape = {
        2: {"upper": (4, 2), "lower": (11, 2)}
        | {"top": ((0.0, 1.0), (0.4, 1.4)), "base": ((0.0, 0.0), (2.0, 1.0))},
        3: {"upper": (3, 3, 1), "lower": (8, 4, 1)}
        | {"top": ((0.0, 0.3, 1.0), (0.4, 0.7, 1.4)), "base": ((0.0, 0.0, 0.0), (2.0, 1.0, 1.0))},
    }[d]
    model = stack(0.1, f"path_{cell}_", cell=cell, E=(1e3, 1e7), method="mortar", **shape)
    model.move(*[0.0] * (d - 1), -0.02)
    model.problem.solve()
    for x in (0.1, 0.9, 1.2):
        model.move(x, *[0.0] * (d - 2), -0.02)
        report = model.problem.solve().contacts[0]
        assert report.stick == 0
    slipping = model.contact.nodal().states() == ff.SLIP
    # Rigid sliding but for the lag of the elastic block, mu p h / G of the way.
    assert np.sum(slipping) >= 4
    path = model.contact.path.x.array[: len(slipping)][slipping]
    assert path == pytest.approx(1.2, abs=0.03)
    assert abs(report.force[0]) == pytest.approx(0.1 * report.force[-1], rel=2e-3)
    assert gathered(model.problem)[1][:, 0].min() >= 0.0
