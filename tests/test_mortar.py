"""Mortar contact of two deformable bodies: averages over the parts that face each other."""

from types import SimpleNamespace

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, la, mesh

import fenicsx_friction as ff
from bodies import box, joined, sides, stack
from models import gathered, tagged_facets

pytestmark = pytest.mark.mpi
SQUARES = {"top": ((0.0, 1.0), (1.0, 2.0)), "base": ((0.0, 0.0), (1.0, 1.0))}
CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
FINE = {2: (5, 2), 3: (3, 3, 2)}
COARSE = {2: (3, 2), 3: (2, 2, 2)}


def blocks(cell, *arguments, swap=False, **options):
    """A block on a base whose faces do not match; the block's are the finer ones, or the base's."""
    d = CELLS[cell]
    n = (COARSE[d], FINE[d]) if swap else (FINE[d], COARSE[d])
    shape = dict(zip(("upper", "lower"), n, strict=True)) | (SQUARES if d == 2 else {})
    return stack(*arguments, cell=cell, method="mortar", **(shape | options))


def tilted(d, slope, uneven, skew):
    """A plane interface that is inclined, with faces of different sizes and shapes."""

    def warp(x):
        y = x.copy()
        for k in range(d - 1):
            y[k] += uneven * np.sin(2.0 * np.pi * x[k]) / (2.0 * np.pi)
        if d == 3:
            bump = skew * np.sin(np.pi * x[0]) * np.sin(np.pi * x[1])
            y[0], y[1] = y[0] + bump, y[1] - bump
        plane = slope * (y[0] - 0.5) - (0.2 * (y[1] - 0.5) if d == 3 else 0.0)
        y[d - 1] += plane * x[d - 1] * (2.0 - x[d - 1])
        return y

    return warp


# -- patch test -----------------------------------------------------------------------------------


@pytest.mark.quick
@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_patch_test_with_faces_that_do_not_match(cell, degree, swap):
    """Uniaxial stress on an inclined interface that sticks: pressure and shear are the same
    everywhere, whichever surface is the secondary one, of faces of any size."""
    d = CELLS[cell]
    warp = tilted(d, 0.3, 0.5, 0.1 if cell == "tetrahedron" else 0.0)
    name = f"patch_{cell}_{degree}_{swap}_"
    model = blocks(cell, 2.0, name, swap=swap, nu=0.0, energy="small", degree=degree, warp=warp)
    model.move(*[0.0] * (d - 1), -0.002)
    assert model.problem.solve().certified
    _, c, _ = gathered(model.problem)
    normal = np.array([-0.3, 0.2, 1.0] if d == 3 else [-0.3, 1.0])
    cosine = 1.0 / np.linalg.norm(normal)
    shear = np.linalg.norm(c[:, 1:], axis=1)
    assert c[:, 0] == pytest.approx(cosine**2, rel=2e-3)  # of the strain
    assert np.ptp(c[:, 0]) <= 1e-10
    assert shear == pytest.approx(cosine * np.sqrt(1.0 - cosine**2), rel=4e-3)
    assert np.ptp(shear) <= 1e-10


def test_patch_test_with_skewed_quadrilaterals_converges():
    """Hats on faces that are no parallelograms are no polynomials: quadrature makes an error."""
    errors = []
    for n in (2, 4):
        model = blocks(
            "hexahedron", 2.0, f"skewed_{n}_", upper=(n + n // 2, n + n // 2, 1), lower=(n, n, 1),
            nu=0.0, energy="small", warp=tilted(3, 0.3, 0.3, 0.15),
        )  # fmt: skip
        model.move(0.0, 0.0, -0.002)
        model.problem.solve()
        _, c, _ = gathered(model.problem)
        errors.append(np.ptp(c[:, 0]) / np.mean(c[:, 0]))
    assert errors[0] <= 1e-5
    assert errors[1] <= errors[0] / 3.0


def overhanging(covered, cell="quadrilateral", name="over_"):
    """A block whose last face is covered by a part; what is not covered carries the same load.

    A load on a part of a face has the nodal forces of one that is linear on the whole of it.
    """
    h, p = 0.25, 1.0
    free = h * (1.0 - covered)
    parts = box((0.0, 0.0), (1.0 - free, 1.0), (3, 2), cell), box(*SQUARES["top"], (4, 2), cell)
    msh = joined(MPI.COMM_SELF, *parts)
    tags = sides(msh, 1, (0.0, 1.0, 1.0, 2.0), 1e-6)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.0))
    stored, x = ff.bulk.stored_energy(density, ufl.dx), ufl.SpatialCoordinate(msh)
    ds = ufl.Measure("ds", msh, subdomain_data=tags)
    # On [0, 1] of the last face: the same moments as p on [covered, 1].
    zeroth, first = 1.0 - covered, (1.0 - covered**2) / 2.0
    xi = (x[0] - (1.0 - h)) / h
    load = p * (4.0 * zeroth - 6.0 * first + (12.0 * first - 6.0 * zeroth) * xi)
    load = ufl.conditional(ufl.gt(x[0], 1.0 - h), load, 0.0)
    F = ufl.derivative(stored, u, v) - load * v[1] * ds(1, degree=2) + p * v[1] * ds(4)
    held = fem.locate_dofs_topological(V, 1, tags.find(3))
    side = mesh.locate_entities_boundary(msh, 1, lambda x: np.isclose(x[0], 0.0) & (x[1] > 1.0))
    bcs = [
        fem.dirichletbc(fem.Function(V), held),
        fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(0), 1, side), V.sub(0)),
    ]
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "block"),
        ff.DeformableObstacle(ff.ContactSurface(msh, tags, 2, "base"), method="mortar"),
        ff.Frictionless(),
    )
    problem = ff.FrictionalContactProblem(F, u, contact=contact, bcs=bcs, petsc_options_prefix=name)
    return SimpleNamespace(problem=problem, contact=contact)


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
@pytest.mark.parametrize("covered", [0.9, 0.5, 0.3, 0.1, 1e-2, 1e-3, 1e-6, 1e-9])
def test_partly_covered_faces_pass_the_patch_test(covered, cell):
    """Down to slivers: the pressure does not jump, and no node has a negative weight."""
    model = overhanging(covered, cell, f"over_{cell}_{covered:g}_")
    report = model.problem.solve().contacts[0]
    c, element = model.contact.multipliers()[:, 0], model.contact.pairing._element
    pressed = c > 0.0
    assert c[pressed] == pytest.approx(1.0, rel=1e-10)
    assert np.sum(pressed) == (5 if covered**2 > 0.05 else 4)  # else its hat is given away
    assert np.all(element.shares.covered >= 0.0)
    assert np.sum(element.shares.covered) == pytest.approx(0.75 + 0.25 * covered, rel=1e-12)
    assert report.force[1] == pytest.approx(0.75 + 0.25 * covered, rel=1e-10)


# -- kinematics and forces ------------------------------------------------------------------------


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_jacobian_against_differences(cell, degree):
    """Turned, pressed, slid over other faces and partly beyond the edge, at finite strain."""
    d = CELLS[cell]
    if d == 3 and degree == 2 and cell == "hexahedron":
        return  # takes long; the others have all that it has
    model = blocks(cell, 0.3, f"jac_{cell}_{degree}_", nu=0.3, degree=degree)
    for k in (1, 2):
        turn(model, np.deg2rad(3.0 * k), 0.06 * k, -0.02)
        assert model.problem.solve().certified
    assert ff.check_jacobian(model.problem).error <= 1e-6


def turn(model, angle, along, up):
    """Turn the top about the middle of the interface, and shift it."""
    X = model.problem.u.function_space.tabulate_dof_coordinates()
    d = model.problem.u.function_space.mesh.geometry.dim
    arm = X[:, [0, d - 1]] - [0.5, 1.0]
    cosine, sine = np.cos(angle), np.sin(angle)
    u = np.zeros((len(X), d))
    u[:, [0, d - 1]] = arm @ np.array([[cosine, sine], [-sine, cosine]]) - arm + [along, up]
    model.top.x.array[:] = u.ravel()


@pytest.mark.parametrize("cell", CELLS)
def test_action_equals_reaction(cell):
    """In force, and in moment but for friction across pointwise gaps, whose average is zero."""
    d = CELLS[cell]
    model = blocks(cell, 0.0, f"reaction_{cell}_", nu=0.3)
    for k in (1, 2):
        turn(model, np.deg2rad(3.0 * k), 0.05 * k, -0.03)
        report = model.problem.solve().contacts[0]
    V, n = model.problem.u.function_space, len(model.problem.terms.momentum()) // d
    force = -model.problem.terms.momentum().reshape(n, d)  # on both bodies
    X = V.tabulate_dof_coordinates()[:n, :d]
    x = X + model.problem.u.x.array.reshape(-1, d)[:n]
    arm = x[:, :1] * force[:, 1:2] - x[:, 1:2] * force[:, :1] if d == 2 else np.cross(x, force)
    comm = model.problem.comm
    assert report.force[-1] > 1.0
    assert comm.allreduce(force.sum(axis=0)) == pytest.approx(0.0, abs=1e-11)
    assert comm.allreduce(arm.sum(axis=0)) == pytest.approx(0.0, abs=1e-10)
    # The totals of the report are those on the upper body.
    upper = X[:, -1] > 1.0 - 1e-9
    upper &= ~(np.isclose(X[:, -1], 1.0) & (abs(force[:, -1]) <= 0.0))
    assert report.force[-1] == pytest.approx(-model_reaction(model), rel=1e-9)


def model_reaction(model):
    """Return the vertical force of the support on the base."""
    d = model.problem.u.function_space.mesh.geometry.dim
    residual = fem.assemble_vector(fem.form(model.problem.bulk))
    residual.scatter_reverse(la.InsertMode.add)
    n = model.problem.u.function_space.dofmap.index_map.size_local
    X = model.problem.u.function_space.tabulate_dof_coordinates()[:n]
    values = residual.array[: n * d].reshape(n, d)[np.isclose(X[:, d - 1], 0.0), d - 1]
    return -model.problem.comm.allreduce(float(np.sum(values)))


# -- what is never certified, and what is never lost -----------------------------------------------


def tilted_block(tag_sides, method, name):
    """A block, turned by 0.04, over a wide base, without friction; its sides are tagged or not."""
    parts = (
        box((-1.0, -0.6), (2.0, 0.0), (24, 5), "quadrilateral"),
        box((0.0, 0.0), (1.0, 1.0), (12, 12), "quadrilateral"),
    )
    msh = joined(MPI.COMM_SELF, *parts)
    tags = sides(msh, 1, (-0.6, 0.0, 0.0, 1.0), 1e-6)
    if tag_sides:
        there = lambda x: (np.isclose(x[0], 0.0) | np.isclose(x[0], 1.0)) & (x[1] > -1e-9)  # noqa: E731
        more = np.setdiff1d(mesh.locate_entities_boundary(msh, 1, there), tags.indices)
        indices = np.concatenate([tags.indices, more])
        values = np.concatenate([tags.values, np.full(len(more), 1, dtype=np.int32)])
        order = np.argsort(indices)
        tags = mesh.meshtags(msh, 1, indices[order], values[order])
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    density = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(1000.0, 0.3))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "block"),
        ff.DeformableObstacle(ff.ContactSurface(msh, tags, 2, "base"), method=method),
        ff.Frictionless(),
    )
    held = [fem.locate_dofs_topological(V, 1, tags.find(tag)) for tag in (4, 3)]
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(top, held[0]), fem.dirichletbc(fem.Function(V), held[1])],
        petsc_options_prefix=name,
    )
    X = V.tabulate_dof_coordinates()
    for angle in (0.02, 0.04):
        cosine, sine = np.cos(angle), np.sin(angle)
        turned = X[:, :2] @ np.array([[cosine, sine], [-sine, cosine]]) - X[:, :2]
        top.x.array[:] = (turned + [0.0, -0.03]).ravel()
        report = problem.solve()
    return np.array(report.contacts[0].force)


def test_the_sides_of_a_tilted_block_do_not_see_what_it_stands_on():
    bottom, every = (tilted_block(k, "mortar", f"tilted_{k}_") for k in (False, True))
    assert bottom[1] > 3.0
    assert every == pytest.approx(bottom, rel=1e-9, abs=1e-9)
    assert abs(bottom[0]) < 0.02 * bottom[1]


def test_a_corner_that_conditions_move_has_friction():
    """The sides of a die are driven: its corner nodes slide like the others."""
    side = lambda x: (np.isclose(x[0], 0.3) | np.isclose(x[0], 0.7)) & (x[1] > 1.0 - 1e-9)  # noqa: E731
    shape = {"upper": (6, 6), "lower": (10, 8)}
    shape |= {"top": ((0.3, 1.0), (0.7, 1.4)), "base": ((0.0, 0.0), (1.0, 1.0))}
    model = stack(
        0.3,
        "die_",
        cell="quadrilateral",
        method="mortar",
        energy="small",
        hold=[(side, 0)],
        **shape,
    )
    model.move(0.0, -0.01)
    model.problem.solve()
    model.bottom.x.array[:] = np.tile([-0.2, 0.0], len(model.bottom.x.array) // 2)
    model.problem.solve()
    c = model.contact.multipliers()
    pressed = c[:, 0] > 1e-6
    assert abs(c[pressed, 1]) == pytest.approx(0.3 * c[pressed, 0], rel=1e-9)


def test_a_layer_in_front_hides_what_is_behind():
    """Also from a face of which only a part is covered: the strip carries the block."""
    strip, below = (1e3, 1e3), {"upper": (4, 4), "top": ((0.0, 1.0), (1.0, 2.0))}
    cover = 0.85
    parts = [
        box((0.0, 0.0), (cover, 0.9), (5, 4), "quadrilateral"),
        box((0.0, 0.95), (cover, 1.0), (7, 1), "quadrilateral"),
        box(*below["top"], below["upper"], "quadrilateral"),
    ]
    msh = joined(MPI.COMM_SELF, *parts)
    at = lambda y: lambda x: np.isclose(x[1], y)  # noqa: E731
    tags = tagged_facets(msh, at(1.0), at(0.9), at(2.0), at(0.0), at(0.95))
    msh.topology.create_connectivity(1, 2)
    owner = msh.topology.connectivity(1, 2)
    owners = np.array([owner.links(f)[0] for f in tags.indices], dtype=np.int32)
    lower = mesh.compute_midpoints(msh, 2, owners)[:, 1] < 1.0
    values = np.where((tags.values == 1) & lower | (tags.values == 2), 6, tags.values)
    tags = mesh.meshtags(msh, 1, tags.indices, values.astype(np.int32))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(strip[0], 0.0))
    held = [fem.locate_dofs_topological(V, 1, tags.find(tag)) for tag in (3, 4, 5)]
    bcs = [
        fem.dirichletbc(f, dofs)
        for f, dofs in zip((top, fem.Function(V), fem.Function(V)), held, strict=True)
    ]
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "block"),
        ff.DeformableObstacle(ff.ContactSurface(msh, tags, 6, "layers"), method="mortar"),
        ff.Frictionless(),
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u, contact=contact, bcs=bcs, petsc_options_prefix="layers_",
    )  # fmt: skip
    top.x.array[1::2] = -0.01
    report = problem.solve().contacts[0]
    assert report.penetration < 1e-4
    element = contact.pairing._element
    assert np.sum(element.points.weight) == pytest.approx(cover, rel=2e-3)  # strained


def test_dissipation_of_a_partly_covered_block_is_the_work_of_friction():
    """One node slides: force times way, of what is covered."""
    shape = {"upper": (4, 3), "lower": (9, 3)}
    shape |= {"top": ((0.8, 1.0), (1.8, 2.0)), "base": ((0.0, 0.0), (1.07, 1.0))}
    model = stack(
        0.3, "part_", cell="quadrilateral", method="mortar", E=(1e3, 1e8), nu=0.0, **shape
    )
    model.move(0.0, -0.01)
    model.problem.solve()
    audit = ff.EnergyAudit(model.problem, model.stored)
    for x in np.linspace(0.0, 0.02, 21)[1:]:
        model.move(-x, -0.01)
        model.problem.solve()
        balance = audit.update()
    moved = balance.external_work - balance.stored
    assert balance.dissipation > 5e-4
    assert balance.dissipation == pytest.approx(moved, rel=0.02)


def test_surfaces_that_share_a_node_are_taken_by_mortar():
    """A notch of matching lips: node to face would pair its tip with itself."""
    points = np.array([[0, 0], [2, 0.4], [2, 2], [0, 2], [-1, 0], [-1, 2], [2, -0.4], [2, -2],
                       [0, -2], [-1, -2]], dtype=float)  # fmt: skip
    cells = np.array([[0, 1, 3, 2], [4, 0, 5, 3], [8, 7, 0, 6], [9, 8, 4, 0]])
    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    msh = mesh.create_mesh(MPI.COMM_SELF, cells, element, points)
    lip = lambda sign: lambda x: np.isclose(x[1], sign * 0.2 * x[0]) & (x[0] > -1e-9)  # noqa: E731
    tags = tagged_facets(msh, lip(1.0), lip(-1.0))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1.0, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, ufl.TestFunction(V))
    surfaces = [ff.ContactSurface(msh, tags, tag, name) for tag, name in ((1, "up"), (2, "low"))]
    contact = ff.Contact(surfaces[0], ff.DeformableObstacle(surfaces[1]), ff.Frictionless())
    ff.FrictionalContactProblem(F, u, contact=contact, petsc_options_prefix="shared_")
    assert type(contact.pairing).__name__ == "Mortar"


def test_gaps_beyond_reach_are_not_closed_in_silence():
    with pytest.raises(ff.ContactInputError, match=r"close_gaps = 5 m is more than the surfaces"):
        stack(0.3, "far_", cell="quadrilateral", upper=(5, 2), lower=(3, 2), **SQUARES,
              method="mortar", close_gaps=5.0)  # fmt: skip
