"""Weighted contact: displacements with dofs on edges and faces meet rigid obstacles on average."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from scipy.spatial.transform import Rotation

import fenicsx_friction as ff
from models import by_place, gathered, tagged_facets

pytestmark = pytest.mark.mpi
CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
E, NU = 1000.0, 0.3


def block(
    cell,
    n,
    obstacle,
    mu=0.3,
    *,
    degree=2,
    surface_degree=1,
    comm=MPI.COMM_WORLD,
    energy="small",
    size=1.0,
    span=None,
    symmetric=False,
    tag_side=False,
    turn=None,
    name="w_",
    **options,
):
    """A block (square or cube) over an obstacle; ``move`` sets where its top is."""
    d, kind = CELLS[cell], getattr(mesh.CellType, cell)
    make, up = (mesh.create_rectangle if d == 2 else mesh.create_box), d - 1
    span = span or ([0.0] * d, [size] * d)
    msh = make(comm, span, np.broadcast_to(n, d).tolist(), kind)
    sides = [lambda x: np.isclose(x[up], 0.0), lambda x: np.isclose(x[up], span[1][up])]
    if tag_side:
        sides.append(lambda x: np.isclose(x[0], span[1][0]))
    tags = tagged_facets(msh, *sides)
    if turn is not None:
        msh.geometry.x[:] = msh.geometry.x @ turn.T
    V = fem.functionspace(msh, ("Lagrange", degree, (d,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Constant(msh, np.zeros(d))
    densities = {"small": ff.bulk.small_strain_energy, "finite": ff.bulk.neo_hooke_energy}
    stored = ff.bulk.stored_energy(densities[energy](u, ff.bulk.Elastic(E, NU)), ufl.dx)
    if callable(obstacle):
        obstacle = obstacle(msh)
    law = ff.Coulomb(mu) if mu > 0.0 else ff.Frictionless()
    surface = ff.ContactSurface(msh, tags, 3 if tag_side else 1, degree=surface_degree)
    contact = ff.Contact(surface, obstacle, law)
    held = [fem.dirichletbc(top, fem.locate_dofs_topological(V, up, tags.find(2)), V)]
    if symmetric:
        side = mesh.locate_entities_boundary(msh, up, lambda x: np.isclose(x[0], 0.0))
        dofs = fem.locate_dofs_topological(V.sub(0), up, side)
        held.append(fem.dirichletbc(0.0, dofs, V.sub(0)))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v),
        u,
        contact=contact,
        bcs=held,
        petsc_options_prefix=name,
        **options,
    )

    def move(*place):
        top.value[:] = place

    return SimpleNamespace(problem=problem, contact=contact, move=move, u=u, top=top)


def ball(d, radius=2.0, height=0.02):
    """A sphere under the middle of the block that is so much too high."""
    return ff.RigidSphere([0.45] * (d - 1) + [height - radius], radius)


def plane(d):
    return ff.RigidPlane([0.0] * d, [0.0] * (d - 1) + [1.0])


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [2, 3])
def test_jacobian_against_differences(cell, degree):
    """Averages over a sphere turn with the body: every block of the matrix is there."""
    d = CELLS[cell]
    if d == 3 and degree == 3:
        return
    model = block(cell, 2, ball(d), degree=degree, energy="finite", name=f"jac_{cell}_")
    model.move(*[0.004] * (d - 1), -0.03)
    model.problem.solve()
    assert ff.check_jacobian(model.problem).error <= 1e-6


@pytest.mark.parametrize("cell", CELLS)
def test_forces_of_a_smooth_sphere_go_through_its_centre(cell):
    """They are conjugate to the gap: a common turn about the centre does no work."""
    d = CELLS[cell]
    model = block(cell, 3, ball(d), 0.0, energy="finite", name=f"centre_{cell}_")
    model.move(*[0.01] * (d - 1), -0.03)
    report = model.problem.solve().contacts[0]
    force, centre = np.array(report.force), np.array([0.45] * (d - 1) + [-1.98])
    assert report.stick + report.slip >= 2
    assert np.linalg.norm(force) > 1.0
    lever = centre[0] * force[1] - centre[1] * force[0] if d == 2 else np.cross(centre, force)
    assert np.array(report.moment) == pytest.approx(lever, abs=1e-10 * np.linalg.norm(force))


@pytest.mark.quick
@pytest.mark.parametrize("cell", CELLS)
def test_what_slides_everywhere_has_the_friction_of_its_load(cell):
    d = CELLS[cell]
    model = block(cell, 3, plane(d), 0.2, name=f"slide_{cell}_")
    model.move(*[0.0] * (d - 1), -0.01)
    model.problem.solve()
    model.move(0.3, *[0.0] * (d - 2), -0.02)
    report = model.problem.solve().contacts[0]
    assert report.stick == 0 and report.slip > 0
    assert abs(report.force[0]) <= 0.2 * report.force[-1] * (1.0 + 1e-12)
    # In 3D some nodes slip sideways, too.
    assert abs(report.force[0]) == pytest.approx(
        0.2 * report.force[-1], rel=1e-9 if d == 2 else 2e-3
    )


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_a_turned_copy_of_a_model_has_the_same_forces(cell):
    """Slips are averaged in frames that are carried from one of the node: no axis is preferred."""
    forces = []
    for turn in ([0.0, 0.0, 0.0], [0.3, -0.2, 0.5], [1.0, 0.7, -0.4]):
        Q = Rotation.from_rotvec(turn).as_matrix()
        centre = Q @ np.array([0.45, 0.4, -1.98])
        model = block(cell, 3, ff.RigidSphere(centre, 2.0), 0.3, turn=Q, name=f"turn_{cell}_")
        for place in ([0.0, 0.0, -0.03], [0.01, 0.004, -0.04]):
            model.move(*Q @ np.array(place))
            report = model.problem.solve().contacts[0]
        assert report.stick + report.slip > 2
        forces.append(Q.T @ np.array(report.force))
    assert abs(forces[0][0]) > 0.1
    for other in forces[1:]:
        assert other == pytest.approx(forces[0], abs=1e-8 * np.linalg.norm(forces[0]))


@pytest.mark.parametrize("kind", ["plane", "ball"])
@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
def test_half_of_a_symmetric_model_is_half_of_it(cell, kind):
    """The symmetry plane holds one tangent of its nodes, and carries no friction."""
    d, forces = CELLS[cell], []
    for low in (-1.0, 0.0):
        obstacle = plane(d) if kind == "plane" else ff.RigidSphere([0.0] * (d - 1) + [-9.98], 10.0)
        span = [low] + [-1.0] * (d - 2) + [0.0], [1.0] * d
        cells = [4 if low < 0.0 else 2] + [2] * (d - 1)
        model = block(cell, cells, obstacle, 0.3, span=span, symmetric=low == 0.0, name="half_")
        model.move(*[0.0] * (d - 1), -0.15)
        report = model.problem.solve().contacts[0]
        forces.append(report.force[-1])
        states = (report.open, report.stick, report.slip)
        assert sum(states[1:]) > 0
    # The mean normals of half a neighbourhood are a bit off those of the whole.
    assert 2.0 * forces[1] == pytest.approx(forces[0], rel=1e-9 if kind == "plane" else 1e-6)


@pytest.mark.parametrize("cell", CELLS)
def test_the_boundary_and_the_whole_have_the_same_solution(cell):
    d, states = CELLS[cell], []
    for solver in ("condensed", "full"):
        settings = ff.StepSettings(solver=solver)
        name = f"{solver}_{cell}_"
        model = block(cell, 3, ball(d), settings=settings, name=name)
        model.move(*[0.01] * (d - 1), -0.03)
        report = model.problem.solve()
        assert report.solver == solver and report.contacts[0].slip + report.contacts[0].stick
        states.append([by_place(f) for f in (model.u, model.contact.c)])
    for one, other in zip(*states, strict=True):
        assert other == pytest.approx(one, abs=1e-9 * np.max(abs(one), initial=0.0))


@pytest.mark.parametrize(
    ("cell", "sizes"), [("triangle", (8, 32)), ("quadrilateral", (8, 32)), ("tetrahedron", (3, 6))]
)
def test_penetration_between_the_nodes_falls_fast(cell, sizes):
    """Averages leave some; it is reported, and falls nearly with the square of the mesh size."""
    d, approach, found = CELLS[cell], 0.02, []
    for n in sizes:
        model = block(cell, n, ball(d, 1.0, 0.0), 0.0, name=f"deep_{cell}_{n}_")
        model.move(*[0.0] * (d - 1), -approach)
        report = model.problem.solve().contacts[0]
        assert model.problem.accepted[0].gap.min(initial=0.0) > -1e-10
        found.append(report.penetration)
    rate = np.log(found[0] / found[1]) / np.log(sizes[1] / sizes[0])
    assert 0.0 < found[1] < (0.02 if d == 2 else 0.4) * approach
    assert rate > 1.2


def parabola(msh):
    return ff.ImplicitObstacle(lambda X: X[1] + (X[0] - 1.013) ** 2 / 8.0)


def profile(n):
    """Pressures of a parabola on a block (Q2), interpolated, and the force."""
    model = block("quadrilateral", n, parabola, 0.0, name=f"profile_{n}_", size=2.0)
    model.move(0.0, -0.02)
    report = model.problem.solve().contacts[0]
    x, c, _ = gathered(model.problem)
    return np.interp(np.linspace(0.4, 1.6, 2001), x[:, 0], c[:, 0]), report.force[1]


@pytest.mark.serial  # large; others compare ranks
def test_pressures_and_force_of_a_line_contact_converge():
    """The profile with 65 and 129 nodes on the surface, against 257."""
    (exact, force), *others = (profile(n) for n in (128, 32, 64))
    errors = [np.linalg.norm(p - exact) / np.linalg.norm(exact) for p, _ in others]
    assert errors[0] < 0.08 and errors[1] < 0.04
    assert [f for _, f in others] == [
        pytest.approx(force, rel=2e-3),
        pytest.approx(force, rel=1e-3),
    ]


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_a_gap_may_depend_on_fields(cell):
    """A field of the mesh counts at the points of the faces, as the same expression does."""
    d, found = CELLS[cell], []

    def of_field(msh):
        f = fem.Function(fem.functionspace(msh, ("Lagrange", 4)))
        f.interpolate(lambda x: 0.01 * x[0] ** 2 + 0.003 * x[0])
        return ff.ImplicitObstacle(lambda X: X[d - 1] - f)

    def of_place(msh):
        x = ufl.SpatialCoordinate(msh)[0]
        return ff.ImplicitObstacle(lambda X: X[d - 1] - (0.01 * x**2 + 0.003 * x))

    for kind, obstacle in (("field", of_field), ("place", of_place)):
        model = block(cell, 3, obstacle, name=f"{kind}_{cell}_")
        model.move(*[0.0] * (d - 1), -0.01)
        assert model.problem.solve().contacts[0].force[-1] > 0.5
        found.append([by_place(f) for f in (model.u, model.contact.c)])
    for one, other in zip(*found, strict=True):
        assert other == pytest.approx(one, abs=1e-10 * np.max(abs(one), initial=0.0))


@pytest.mark.parametrize("obstacle", ["sphere", "gap"])
def test_a_block_that_is_carried_through_a_ball_is_refused(obstacle):
    """The ball is smaller than a face: no vertex meets it."""
    radius, centre = 0.08, (0.5, -0.2)
    found = {
        "sphere": ff.RigidSphere(centre, radius),
        "gap": ff.ImplicitObstacle(
            lambda X: ufl.sqrt((X[0] - 0.5) ** 2 + (X[1] + 0.2) ** 2) - radius
        ),
    }[obstacle]
    model = block("triangle", 3, found, 0.0, name=f"through_{obstacle}_")
    model.move(0.0, -0.6)
    with pytest.raises(ff.StepFailed, match=r"2 nodes of 'contact' went through the obstacle"):
        model.problem.solve()
    model.move(0.0, -0.05)
    assert model.problem.solve().contacts[0].open == 4


def test_a_ball_smaller_than_the_faces_is_no_open_contact():
    """On average every node is open, while the ball is deep in a face."""
    ball = ff.RigidSphere([0.45, 0.4, -0.3], 0.3)
    model = block("tetrahedron", 4, ball, 0.5, name="small_")
    model.move(0.0, 0.0, -0.05)
    with pytest.raises(ff.StepFailed, match=r"open, but the obstacle is deep"):
        model.problem.solve()


@pytest.mark.parametrize("radius", [0.08, 0.02])
def test_a_small_ball_is_not_passed_in_small_steps(radius):
    """Also one that is never deep in a face, on the way of a point of quadrature."""
    x = 0.5  # in the middle of a face, where one of the three points is

    def distance(X):
        return ufl.sqrt((X[0] - x) ** 2 + (X[1] + 0.2) ** 2) - radius

    model = block("triangle", 3, ff.ImplicitObstacle(distance), 0.0, name="slowly_")
    with pytest.raises(ff.StepFailed, match=r"deep in the faces|went through"):
        for height in np.arange(0.1, 0.65, 0.5 * radius):
            model.move(0.0, -height)
            model.problem.solve()


def test_the_penetration_of_a_corner_is_told():
    """A tilted plane meets the corner first, which no point of quadrature touches."""
    normal = np.array([np.sin(0.2), np.cos(0.2)])
    model = block("quadrilateral", 4, ff.RigidPlane((0.0, 0.0), normal), 0.0, name="corner_")
    model.move(0.0, -0.01)
    report = model.problem.solve().contacts[0]
    x = model.u.function_space.tabulate_dof_coordinates()[:, :2]
    gap = (x + model.u.x.array.reshape(-1, 2)) @ normal
    deepest = model.problem.comm.allreduce(float(np.max(-gap)), MPI.MAX)
    assert report.penetration == pytest.approx(deepest, rel=1e-9)
    assert deepest > 1e-3


@pytest.mark.parametrize("degree", [2, 3])
def test_held_nodes_that_are_pushed_into_an_obstacle_are_told(degree):
    """The corner of the held top goes into the wall; no average is held as a whole."""
    wall = ff.RigidPlane((1.001, 0.0), (-1.0, 0.0))
    model = block("quadrilateral", 4, wall, 0.0, degree=degree, tag_side=True, name="wall_")
    model.move(0.01, 0.0)
    with pytest.raises(ff.StepFailed, match="push held nodes"):
        model.problem.solve()


def test_a_sphere_of_any_radius_is_a_plane_in_the_end():
    forces = []
    for radius in (1e4, 1e12):
        sphere = ff.RigidSphere((0.5, -radius), radius)
        model = block("triangle", 4, sphere, 0.3, name="large_")
        model.move(0.0, -0.01)
        forces.append(model.problem.solve().contacts[0].force[1])
    assert forces[1] == pytest.approx(forces[0], rel=1e-2)


def test_what_a_gap_cannot_contain_on_average_is_refused():
    def of_submesh(contact_mesh):
        f = fem.Function(fem.functionspace(contact_mesh, ("Lagrange", 2)))
        return ff.ImplicitObstacle(lambda X: X[1] - f)

    msh = mesh.create_unit_square(MPI.COMM_WORLD, 3, 3)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0))
    surface = ff.ContactSurface(msh, tags, 1)
    normal = ff.ImplicitObstacle(lambda X: X[1] - 1e-3 * ufl.FacetNormal(msh)[0])
    u = fem.Function(fem.functionspace(msh, ("Lagrange", 2, (2,))))
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU))
    F = ufl.derivative(
        ff.bulk.stored_energy(density, ufl.dx), u, ufl.TestFunction(u.function_space)
    )
    for obstacle in (of_submesh(surface.submesh), normal):
        with pytest.raises(ff.ContactInputError, match="not known at points between the nodes"):
            ff.FrictionalContactProblem(
                F,
                u,
                contact=ff.Contact(surface, obstacle, ff.Frictionless()),
                petsc_options_prefix="gap_",
            )


def test_node_to_face_needs_values_at_the_vertices():
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 3, 3)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 1.0))
    V = fem.functionspace(msh, ("Lagrange", 2, (2,)))
    u = fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, ufl.TestFunction(V))
    surfaces = [ff.ContactSurface(msh, tags, tag, name) for tag, name in ((1, "low"), (2, "top"))]
    obstacle = ff.DeformableObstacle(surfaces[1], method="node-to-face")
    contact = ff.Contact(surfaces[0], obstacle, ff.Coulomb(0.3))
    with pytest.raises(ff.ContactInputError, match=r'needs P1, Q1 or MINI. Take method="mortar"'):
        ff.FrictionalContactProblem(F, u, contact=contact, petsc_options_prefix="two_")


def test_a_surface_that_goes_round_a_corner_is_refused():
    """Averages over a bottom and a side mean nothing: the corner would sink into the plane."""
    msh = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0) | np.isclose(x[0], 0.0))
    V = fem.functionspace(msh, ("Lagrange", 2, (2,)))
    u = fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, NU))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, ufl.TestFunction(V))
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1, "round"), plane(2), ff.Coulomb(0.3))
    with pytest.raises(ff.ContactInputError, match=r"'round' goes round a corner at \(0, "):
        ff.FrictionalContactProblem(F, u, contact=contact, petsc_options_prefix="round_")
