"""Closed forms and an independent solver: inclines, Hertz, Cattaneo-Mindlin, PETSc's SNESVI."""

from types import SimpleNamespace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import NonlinearProblem
from dolfinx.la import InsertMode

import fenicsx_friction as ff
from closed_forms import indentation
from models import tagged_facets

# -- a block on an incline -------------------------------------------------------------------


def inclined_block(slope, size, cells, comm=MPI.COMM_WORLD):
    """Return a rectangle on an incline: mesh, tags, and the directions along and normal to it.

    Tags: 1 base, 2 left side without the lowest facet, 3 right side, 4 top, 5 that facet.
    """
    msh = mesh.create_rectangle(comm, [[0.0, 0.0], size], cells, mesh.CellType.quadrilateral)
    height, step = size[1], size[1] / cells[1]
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(x[1], 0.0),
        lambda x: np.isclose(x[0], 0.0) & (x[1] > 0.5 * step),  # clear of the contact nodes
        lambda x: np.isclose(x[0], size[0]),
        lambda x: np.isclose(x[1], height),
        lambda x: np.isclose(x[0], 0.0) & (x[1] < 1.5 * step),
    )
    along = np.array([1.0, slope]) / np.hypot(1.0, slope)
    normal = np.array([-along[1], along[0]])
    msh.geometry.x[:, :2] = msh.geometry.x[:, :2] @ np.array([along, normal])
    return msh, tags, along, normal


def pushed_block(slope, mu, prefix, *, controlled):
    """A block under its weight on an incline; pushed horizontally on its left side.

    Args:
        slope: Tangent of the incline.
        mu: Friction coefficient.
        prefix: Prefix of the PETSc options.
        controlled: Prescribe the horizontal displacement (``push``), or else the force.
    """
    size, weight, E = (1.0, 0.5), 10.0, 1e5
    msh, tags, _, normal = inclined_block(slope, size, (12, 6))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    stored = ff.bulk.stored_energy(ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, 0.3)), ufl.dx)
    push = fem.Constant(msh, 0.0)
    F = ufl.derivative(stored, u, v) + weight / (size[0] * size[1]) * v[1] * ufl.dx
    bcs = []
    if controlled:
        held = fem.locate_dofs_topological(V.sub(0), 1, tags.find(2))
        bcs.append(fem.dirichletbc(push, held, V.sub(0)))
    else:
        ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
        area = msh.comm.allreduce(fem.assemble_scalar(fem.form(1.0 * ds(2))), MPI.SUM)
        F -= push / area * v[0] * ds(2)
    coefficient = fem.Constant(msh, mu)
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0.0, 0.0), normal), ff.Coulomb(coefficient)
    )
    problem = ff.FrictionalContactProblem(
        F, u, contact=contact, bcs=bcs, petsc_options_prefix=prefix
    )

    def force():
        momentum = problem.balance.momentum()
        held = problem.constrained_dofs
        return problem.comm.allreduce(float(np.sum(momentum[held[held < len(momentum)]])), MPI.SUM)

    return SimpleNamespace(problem=problem, push=push, force=force, weight=weight)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("slope", "mu"), [(0.1, 0.0), (0.1, 0.1), (0.1, 0.2), (0.1, 0.3), (0.5, 0.3), (0.0, 0.7)]
)
def test_push_that_moves_a_block_up_an_incline(slope, mu):
    """NAFEMS CGS-4: ``F/G = (tan a + mu)/(1 - mu tan a)``, closed form, any elastic block.

    Once all nodes in contact slip, the contact force lies on the cone whatever its distribution,
    and global equilibrium with push and weight is the closed form. 0.412371 for 0.1 and 0.3
    (FrontISTR's manual reports 0.412168). Pulling back, friction turns: ``mu -> -mu``.
    """
    model = pushed_block(slope, mu, f"cgs4_{slope}_{mu}_", controlled=True)
    ratios, sticking = [], []
    for push in (0.0, 2e-5, 4e-5, 8e-5, 1e-3, 2e-3):
        model.push.value = push
        sticking.append(model.problem.solve().contacts[0].stick)
        ratios.append(model.force() / model.weight)
    up = (slope + mu) / (1.0 - mu * slope)
    if (slope, mu) == (0.1, 0.3):
        assert up == pytest.approx(0.412371, abs=5e-7)
    assert sticking[-2:] == [0, 0]
    assert ratios[-2:] == pytest.approx([up, up], rel=1e-9)
    # Before, some nodes stick and the push is smaller.
    for stick, ratio in zip(sticking, ratios, strict=True):
        assert stick == 0 or ratio < up * (1.0 - 1e-6)
    assert mu == 0.0 or max(sticking[:3]) > 0
    assert np.all(np.diff(ratios) > -1e-9)
    model.push.value = 0.0
    assert model.problem.solve().contacts[0].stick == 0
    down = (slope - mu) / (1.0 + mu * slope)
    assert model.force() / model.weight == pytest.approx(down, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("factor", [0.999, 1.001])
def test_a_block_held_by_friction_alone(factor):
    """CGS-4 under force control: below the closed form friction holds, above nothing does."""
    model = pushed_block(0.1, 0.3, f"cgs4_force_{factor}_", controlled=False)
    model.problem.solve()
    model.push.value = factor * 0.4 / 0.97 * model.weight
    if factor > 1.0:
        with pytest.raises(ff.StepFailed):
            model.problem.solve()
        return
    totals = model.problem.solve().contacts[0]
    assert totals.stick > 0
    assert totals.force == pytest.approx((-float(model.push.value), model.weight), rel=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize("factor", [0.99, 1.0 - 1e-6, 1.0 + 1e-6, 1.01])
def test_stick_slip_threshold_against_a_spring(factor):
    """Code_aster SSNV503 with a rigid base: ``slip = (F - mu N)/k`` beyond ``F = mu N``.

    40 mm x 20 mm, E = 2.1e5 MPa, nu = 0, mu = 0.3, base inclined by 30 degrees, N = 12000 N,
    springs of 4 N/mm in total. 3564 N sticks with T = 3564 N; 3636 N slips 9 mm with T = 3600 N,
    then DX = 8.794, DY = 2.768 mm, the closing of the 2 mm gap included. The loads make the
    stress homogeneous here, so that the closed form holds at every node.
    """
    N, k, mu = 12000.0, 4.0, 0.3
    length, height = 40.0, 20.0
    slope = np.tan(np.pi / 6.0)
    msh, tags, along, normal = inclined_block(slope, (length, height), (8, 4))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    closing = -2.0 * normal  # (1, -1.732), to the base
    u.x.array[:] = np.tile(closing, len(u.x.array) // 2)
    t, n = ufl.as_vector(along.tolist()), ufl.as_vector(normal.tolist())
    pressure, shear = fem.Constant(msh, N / length), fem.Constant(msh, 0.0)
    ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
    left, right = ds(2) + ds(5), ds(3)
    material = ff.bulk.Elastic(2.1e5, 0.0)
    stored = ff.bulk.stored_energy(ff.bulk.small_strain_energy(u, material), ufl.dx)
    loads = (-pressure * ufl.dot(v, n) + shear * ufl.dot(v, t)) * ds(4)
    loads += shear * ufl.dot(v, n) * right - shear * ufl.dot(v, n) * left
    springs = k / length * ufl.dot(u, t) * ufl.dot(v, t) * ds(1)
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane(closing, normal), ff.Coulomb(mu)
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v) + springs - loads,
        u,
        contact=contact,
        petsc_options_prefix=f"ssnv503_{factor}_",
    )
    problem.solve()
    push = factor * mu * N
    shear.value = push / length
    totals = problem.solve().contacts[0]
    slips = factor > 1.0
    assert (totals.slip, totals.stick) == ((9, 0) if slips else (0, 9))
    assert np.dot(totals.force, along) == pytest.approx(-min(push, mu * N), rel=1e-9)
    assert np.dot(totals.force, normal) == pytest.approx(N, rel=1e-9)
    slip = max(push - mu * N, 0.0) / k
    assert problem.accepted[0].slip == pytest.approx(slip, rel=1e-6, abs=1e-10)
    nodes = contact.surface.parent_dofs(V)
    moved = closing + slip * along
    # 1e-9 mm of it times the springs is 1e-12 of the force.
    moved_nodes = u.x.array.reshape(-1, 2)[nodes]
    assert moved_nodes == pytest.approx(np.tile(moved, (len(nodes), 1)), abs=1e-8)
    if factor == 1.01:
        assert slip == pytest.approx(9.0, rel=1e-12)
        assert moved == pytest.approx([8.794, 2.768], abs=5e-4)


# -- Hertz -----------------------------------------------------------------------------------


@pytest.mark.parametrize("crowned", [False, True])
def test_hertz_line_contact(crowned):
    """Rigid circle on a block, rigid plane on a crowned one: Hertz (Johnson 1985, section 4.2).

    Half-width and pressure are compared at the measured force, so that the approach, which has
    no limit for a half-plane, does not matter. The block is 80 a wide and 40 a high. The largest
    pressure keeps an error below 1e-3 on all three meshes: the circle's exact gap differs from a
    parabola's by order a/R = 0.01 (-1.2e-3; the plane has no such part), and the cells outside
    the contact grow by the same 1.25 in all of them (+0.8e-3).
    """
    errors = []
    for n in (5, 10, 20):
        model = indentation(
            2, n, f"line_{crowned}_{n}_", nu=0.3, full_x=False, far=40.0, growth=1.25,
            crowned=crowned,
        )  # fmt: skip
        model.move(0.0, 0.022)
        t = model.tractions()
        h = t.hertz
        assert abs(np.max(t.r[t.states != ff.OPEN]) - h.a) <= 1.0 / n
        assert np.max(t.pressure) == pytest.approx(h.p0, rel=1e-3)
        errors.append(t.norm(t.pressure - h.pressure(t.r)))
    assert errors[0] > 1.9 * errors[1] > 1.9**2 * errors[2]
    assert errors[-1] < 0.007


def test_hertz_sphere():
    """Rigid sphere on a block, a quarter: Hertz (Johnson 1985, section 4.2(a)).

    The block is 20 a wide and 10 a high; the coarse meshes, up to 6 cells on a, decide here.
    """
    errors, peaks = [], []
    for n in (2, 4, 6):
        model = indentation(3, n, f"point_{n}_", nu=0.3, full_x=False, far=10.0, growth=1.4)
        model.move(0.0, 0.0093)
        t = model.tractions()
        h = t.hertz
        assert abs(np.max(t.r[t.states != ff.OPEN]) - h.a) <= np.sqrt(2.0) / n
        peaks.append(abs(np.max(t.pressure) / h.p0 - 1.0))
        errors.append(t.norm(t.pressure - h.pressure(t.r)))
    assert errors[0] > errors[1] > errors[2]
    assert peaks[0] > peaks[1] > peaks[2]
    assert errors[-1] < 0.05
    assert peaks[-1] < 0.005


def test_hertz_sphere_with_quadratic_displacements():
    """Averages (Q2): profile, largest pressure and penetration fall with the mesh."""
    errors, peaks, deepest = [], [], []
    for n in (2, 4):
        model = indentation(
            3, n, f"quadratic_{n}_", nu=0.3, full_x=False, far=10.0, growth=1.8, degree=2
        )
        report = model.move(0.0, 0.0093)
        t = model.tractions()
        peaks.append(abs(np.max(t.pressure) / t.hertz.p0 - 1.0))
        errors.append(t.norm(t.pressure - t.hertz.pressure(t.r)))
        deepest.append(report.contacts[0].penetration / 0.0093)
    assert errors[1] < 0.18 and errors[0] > 1.6 * errors[1]
    assert peaks[1] < 0.01
    assert deepest[1] < 0.016 and deepest[0] > 2.0 * deepest[1]


# -- Cattaneo and Mindlin ----------------------------------------------------------------------


def test_partial_slip_and_its_reversal_under_a_line():
    """Pressed, shifted and shifted back: Cattaneo, Mindlin and Deresiewicz (Johnson 7.2, 7.4).

    The closed form needs Dundurs' beta = 0, which against a rigid body is nu -> 1/2: 0.499 with
    mean dilatation, beta = 0.002. It starts from a pressing without shear, so mu is set after it.
    The way back leaves ``f(a) - f(c) - 2 (f(a) - f(c'))`` with
    ``c'/a = sqrt(1 - (Q - Q')/(2 mu P))``, which only the right history gives.
    """
    mu, depth, errors = 0.3, 0.032, []
    for n in (10, 40):
        model = indentation(
            2, n, f"mindlin2_{n}_", mu=0.0, nu=0.499, full_x=True, far=100.0, growth=1.3,
            crowned=True,
        )  # fmt: skip
        model.move(0.0, depth)
        model.mu.value = mu
        model.move(mu * depth, depth)
        there = model.tractions()
        model.move(0.4 * mu * depth, depth)
        back = model.tractions()
        # The plane drags the block along with it.
        h, share = there.hertz, there.share / mu
        c, turned = h.stick(share), h.stick((share - back.share / mu) / 2.0)
        assert 0.2 < back.share / mu < share - 0.2
        assert share < 0.8
        for t, size in ((there, c), (back, turned)):
            assert abs(t.largest(ff.STICK) - size) <= 1.0 / n
            assert abs(t.smallest(ff.SLIP) - size) <= 1.0 / n

        def f(size, r=there.r, h=h):
            return h.traction(r, mu, size)

        q = f(h.a) - f(c)
        errors.append(
            [
                there.norm(there.shear[:, 0] - q) / mu,
                back.norm(back.shear[:, 0] - (q - 2.0 * (f(h.a) - f(turned)))) / mu,
            ]
        )
    assert np.all(np.array(errors[1]) < 0.6 * np.array(errors[0]))
    assert max(errors[1]) < 0.01


def test_partial_slip_under_a_sphere():
    """Cattaneo and Mindlin in 3D, half of it: ``c/a = (1 - Q/(mu P))^(1/3)`` (Johnson 7.2).

    nu = 0.49 with mean dilatation: beta = 0.02. The closed form lets all slip along the shift,
    which Coulomb's law obeys only nearly; the meshes are coarse, and decide here.
    """
    mu, depth, errors = 0.3, 0.0098, []
    for n in (3, 5):
        model = indentation(
            3, n, f"mindlin3_{n}_", mu=0.0, nu=0.49, full_x=True, far=10.0, growth=1.6,
            crowned=True,
        )  # fmt: skip
        model.move(0.0, depth)
        model.mu.value = mu
        model.move(0.6 * mu * depth, depth)
        t = model.tractions()
        h, share = t.hertz, t.share / mu
        c = h.stick(share)
        assert 0.4 < share < 0.6
        assert abs(t.largest(ff.STICK) - c) <= 1.0 / n
        assert abs(t.smallest(ff.SLIP) - c) <= 1.0 / n
        q = h.traction(t.r, mu, h.a) - h.traction(t.r, mu, c)
        errors.append(t.norm(t.shear[:, 0] - q) / mu)
        assert t.norm(t.shear[:, 1]) / mu < 0.05
    assert errors[1] < 0.7 * errors[0]
    assert errors[1] < 0.1


# -- PETSc's solver of variational inequalities ------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("energy", ["small", "finite"])
@pytest.mark.parametrize("dim", [2, 3])
def test_frictionless_contact_equals_petsc_snesvi(dim, energy):
    """A crowned block on a plane: bounds on the vertical displacement say the same."""
    up = 0.5
    cells, corner = ([12, 6], (1.2, up)) if dim == 2 else ([6, 5, 3], (1.2, 0.9, up))
    create = mesh.create_rectangle if dim == 2 else mesh.create_box
    cell = mesh.CellType.quadrilateral if dim == 2 else mesh.CellType.hexahedron
    msh = create(MPI.COMM_WORLD, [[0.0] * dim, corner], cells, cell)
    last = dim - 1
    tags = tagged_facets(msh, lambda x: np.isclose(x[last], 0.0), lambda x: np.isclose(x[last], up))
    X = msh.geometry.x
    X[:, last] += 0.1 * (X[:, 0] - 0.5) ** 2 * (1.0 - X[:, last] / up)
    V = fem.functionspace(msh, ("Lagrange", 1, (dim,)))
    density = {"small": ff.bulk.small_strain_energy, "finite": ff.bulk.neo_hooke_energy}[energy]
    top = fem.Function(V)
    top.x.array[0::dim] = 0.03
    top.x.array[last::dim] = -0.05
    bcs = [fem.dirichletbc(top, fem.locate_dofs_topological(V, dim - 1, tags.find(2)))]

    def residual(u):
        stored = ff.bulk.stored_energy(density(u, ff.bulk.Elastic(1000.0, 0.3)), ufl.dx)
        return ufl.derivative(stored, u, ufl.TestFunction(V))

    u, w = fem.Function(V), fem.Function(V)
    plane = ff.RigidPlane([0.0] * dim, np.eye(dim)[last])
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1), plane, ff.Frictionless())
    prefix = f"vi_{dim}_{energy}_"
    problem = ff.FrictionalContactProblem(
        residual(u), u, contact=contact, bcs=bcs, petsc_options_prefix=prefix
    )
    totals = problem.solve().contacts[0]
    assert totals.open > 0
    assert totals.slip > 0

    lower, upper = fem.Function(V), fem.Function(V)
    lower.x.array[:], upper.x.array[:] = PETSc.NINFINITY, PETSc.INFINITY
    bottom = fem.locate_dofs_topological(V, dim - 1, tags.find(1))
    lower.x.array[bottom * dim + last] = -V.tabulate_dof_coordinates()[bottom, last]
    lower.x.scatter_forward()
    reference = NonlinearProblem(
        residual(w),
        w,
        bcs=bcs,
        petsc_options_prefix=f"{prefix}reference_",
        petsc_options={
            "snes_type": "vinewtonrsls",
            "snes_rtol": 1e-13,
            "snes_atol": 1e-11,
            "snes_stol": 0.0,
            "ksp_type": "preonly",
            "pc_type": "lu",
            "pc_factor_mat_solver_type": "mumps",
        },
    )
    reference.solver.setVariableBounds(lower.x.petsc_vec, upper.x.petsc_vec)
    reference.solve()
    assert reference.solver.getConvergedReason() > 0
    assert u.x.array == pytest.approx(w.x.array, abs=1e-9 * 0.05)
    # The reactions to the bounds are the contact forces.
    surface = contact.surface
    reaction = fem.assemble_vector(fem.form(residual(w)))
    reaction.scatter_reverse(InsertMode.add)
    n = surface.num_owned
    forces = surface.area.x.array[:n] * contact.nodal().c[:, 0]
    nodes = surface.parent_dofs(V)[:n]
    owned = nodes < V.dofmap.index_map.size_local
    expected = reaction.array[nodes[owned] * dim + last]
    assert forces[owned] == pytest.approx(expected, abs=1e-9 * 50.0)
