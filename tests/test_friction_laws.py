"""Each friction law against its closed form, on blocks pressed on a plane and dragged."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction import laws
from fenicsx_friction.system import contact_terms
from fenicsx_friction.verification.jacobian import check_jacobian
from models import tagged_facets

#: With nu = 0 the normal force is E times the pressed depth, whatever friction does.
E, DEPTH = 1000.0, 0.01
PRESSURE = E * DEPTH


@dataclass
class Dragged:
    """A block of side 1 on a plane, its top moved."""

    problem: ff.FrictionalContactProblem
    contact: ff.Contact
    top: fem.Function
    law: ff.FrictionLaw

    def move(self, *displacement):
        """Move the top to a displacement and solve."""
        self.top.x.array[:] = np.tile(displacement, len(self.top.x.array) // len(displacement))
        return self.problem.solve()

    def nodes(self):
        """Return positions, pressures, tractions along the tangents, paths and slips, of all ranks.

        Slips are the global vectors of the last step.
        """
        surface, comm = self.contact.surface, self.problem.comm
        n, d = surface.num_owned, surface.mesh.geometry.dim
        c = self.contact.c.x.array.reshape(-1, d)[:n]
        path, slip = self.contact.path.x.array[:n], self.contact.slip_increment
        parts = comm.allgather((surface.x, c[:, 0], c[:, 1:], path, slip))
        return [np.concatenate(column) for column in zip(*parts, strict=True)]


def dragged(make_law, prefix, *, dim=2, comm=MPI.COMM_WORLD, **settings) -> Dragged:
    """Build the block; ``make_law(msh, surface)`` makes its law."""
    if dim == 2:
        kind = mesh.CellType.quadrilateral
        msh = mesh.create_rectangle(comm, [[0, 0], [1, 1]], [4, 2], kind)
    else:
        msh = mesh.create_box(comm, [[0] * 3, [1] * 3], [2, 2, 1], mesh.CellType.hexahedron)
    up = dim - 1
    tags = tagged_facets(msh, lambda x: np.isclose(x[up], 0), lambda x: np.isclose(x[up], 1))
    V = fem.functionspace(msh, ("Lagrange", 1, (dim,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E, 0.0))
    surface = ff.ContactSurface(msh, tags, 1)
    law, normal = make_law(msh, surface), np.eye(dim)[up]
    contact = ff.Contact(surface, ff.RigidPlane(np.zeros(dim), normal), law)
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(top, fem.locate_dofs_topological(V, up, tags.find(2)))],
        petsc_options_prefix=prefix,
        settings=ff.StepSettings(**settings),
    )
    return Dragged(problem, contact, top, law)


def on_mesh(msh, value):
    """Interpolate a function of ``x`` on the mesh of the body."""
    f = fem.Function(fem.functionspace(msh, ("Lagrange", 1)))
    f.interpolate(value)
    return f


def on_surface(surface, value):
    """Interpolate a function of ``x`` on the submesh of the contact facets."""
    f = fem.Function(surface.S)
    f.interpolate(value)
    return f


def user_law(msh, surface):
    """A law of a user: a limit and nothing else."""

    class Saturating(ff.FrictionLaw):
        def limit(self, pressure, sliding):
            return 4.0 * (1.0 - ufl.exp(-0.3 * pressure / 4.0))

    return Saturating()


def constant(msh, value):
    return fem.Constant(msh, float(value))


DT = 0.5
#: Name: law, and its limit of position, pressure, path and slip rate in NumPy.
LAWS = {
    "frictionless": (lambda m, s: ff.Frictionless(), lambda x, p, path, v: 0 * p),
    "constant": (lambda m, s: ff.Coulomb(constant(m, 0.2)), lambda x, p, path, v: 0.2 * p),
    "functions": (
        lambda m, s: ff.Coulomb(
            on_mesh(m, lambda x: 0.1 + 0.2 * x[0]), adhesion=on_surface(s, lambda x: x[0])
        ),
        lambda x, p, path, v: x[:, 0] + (0.1 + 0.2 * x[:, 0]) * p,
    ),
    "field": (
        lambda m, s: ff.Coulomb(0.1 + 0.2 * ufl.sin(ufl.SpatialCoordinate(m)[0]) ** 2),
        lambda x, p, path, v: (0.1 + 0.2 * np.sin(x[:, 0]) ** 2) * p,
    ),
    "surface function": (
        lambda m, s: ff.Coulomb(on_surface(s, lambda x: 0.3 - 0.2 * x[0])),
        lambda x, p, path, v: (0.3 - 0.2 * x[:, 0]) * p,
    ),
    "pressure": (
        lambda m, s: ff.Coulomb(lambda p, sliding: 0.4 / (1.0 + p / 20.0)),
        lambda x, p, path, v: 0.4 / (1.0 + p / 20.0) * p,
    ),
    "slip weakening": (
        lambda m, s: ff.Coulomb(lambda p, sliding: 0.2 + 0.2 * ufl.exp(-sliding.path / 0.05)),
        lambda x, p, path, v: (0.2 + 0.2 * np.exp(-path / 0.05)) * p,
    ),
    "rate": (
        lambda m, s: ff.Coulomb(lambda p, sliding: 0.2 + 0.5 * sliding.rate),
        lambda x, p, path, v: (0.2 + 0.5 * v) * p,
    ),
    "cap and adhesion": (
        lambda m, s: ff.Coulomb(0.2, adhesion=constant(m, 1.0), cap=constant(m, 3.1)),
        lambda x, p, path, v: np.minimum(1.0 + 0.2 * p, 3.1),
    ),
    "Tresca": (lambda m, s: ff.Coulomb(0.0, adhesion=2.5), lambda x, p, path, v: 0 * p + 2.5),
    "user": (user_law, lambda x, p, path, v: 4.0 * (1.0 - np.exp(-0.3 * p / 4.0))),
}


@pytest.mark.mpi
@pytest.mark.parametrize("name", LAWS)
def test_a_dragged_block_meets_the_limit_exactly(name):
    make, limit = LAWS[name]
    model = dragged(make, "law_")
    model.problem.dt.value = DT
    # Right, on, and back; the limit follows the path and the rate.
    for x, sign in ((0.05, -1.0), (0.08, -1.0), (-0.08, 1.0)):
        report = model.move(x, -DEPTH)
        assert report.certified
        assert report.certificate.certifiable
        X, pressure, traction, path, slip = model.nodes()
        totals = report.contacts[0]
        assert totals.stick == 0
        assert totals.slip >= 4
        rate = np.linalg.norm(slip, axis=1) / DT
        expected = sign * limit(X, pressure, path, rate) * (pressure > 0.0)
        assert traction[:, 0] == pytest.approx(expected, abs=1e-9 * PRESSURE)
        if totals.open == 0:
            assert totals.force[1] == pytest.approx(PRESSURE, rel=1e-9)
        assert totals.dissipation >= -1e-12
    force = {"constant": 2.0, "Tresca": 2.5, "frictionless": 0.0}  # of the whole block
    if name in force:
        assert totals.open == 0
        assert totals.force[0] == pytest.approx(force[name], rel=1e-9, abs=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize("name", LAWS)
def test_jacobian_of_each_law(name):
    model = dragged(LAWS[name][0], "jac_", corrector="ramp")
    model.move(0.004, -DEPTH)
    before = [f.x.array.copy() for f in model.problem.state]
    report = check_jacobian(model.problem)
    assert report.error < 1e-6, str(report)
    (counts,) = report.states
    assert counts[0] > 0
    assert counts[2] > 0
    assert (counts[1] > 0) == (name != "frictionless")
    # All rows of the mixed state were compared; there are no kinks near it but the law's own.
    mixed = [check for check in report.checks if check.state == "mixed"]
    assert sum(check.kinks for check in mixed) == 0, str(report)
    assert {check.substep for check in mixed} == {"stick", "slip", "projection"}
    after = [f.x.array for f in model.problem.state]
    assert all(np.array_equal(*pair) for pair in zip(before, after, strict=True))


@pytest.mark.mpi
@pytest.mark.parametrize(
    "law", [ff.PermanentStick(), ff.Coulomb(0.3), ff.OrthotropicCoulomb((0.2, 0.5), (1, 0.7, 0))]
)
@pytest.mark.parametrize("normal", ["chen-mangasarian", "fischer-burmeister", "min"])
def test_jacobian_in_3d_with_each_normal_function(law, normal):
    model = dragged(lambda m, s: law, "jac3_", dim=3, normal=normal)
    assert check_jacobian(model.problem).error < 1e-6  # untouched
    model.move(0.003, 0.002, -DEPTH)
    for seed in range(2):
        report = check_jacobian(model.problem, seed=seed)
        assert report.error < 1e-6, str(report)
        assert report.states[0][0] > 0


@pytest.mark.parametrize(("row", "where"), [(0, "momentum"), (1, "contact 'contact'")])
def test_a_wrong_jacobian_is_found_and_named(row, where, monkeypatch):
    original = contact_terms._element_matrices

    def crippled(k, kernel):
        matrix = original(k, kernel)
        block = [slice(0, 2), slice(2, 4)]
        matrix[:, block[row], block[1 - row]] *= 1.001
        return matrix

    monkeypatch.setattr(contact_terms, "_element_matrices", crippled)
    report = check_jacobian(dragged(LAWS["constant"][0], "wrong_").problem)
    assert report.error > 1e-5
    assert report.worst.block == where
    assert where in str(report)
    right = {key: error for key, error in report.largest().items() if key[1] != where}
    assert max(right.values()) < 1e-6


@pytest.mark.mpi
def test_friction_follows_the_temperature():
    """``mu`` of a field that the user changes between steps, on the reference configuration."""
    fields = []

    def make(msh, surface):
        fields.append(on_mesh(msh, lambda x: 0 * x[0]))
        return ff.Coulomb(0.4 * (1.0 - fields[0] / 1000.0))

    model = dragged(make, "warm_")
    for i, warmth in enumerate((0.0, 500.0, 250.0)):
        fields[0].interpolate(lambda x, warmth=warmth: warmth * x[0])
        assert model.move(0.05 + 0.03 * i, -DEPTH).certified
        X, pressure, traction, *_ = model.nodes()
        expected = -0.4 * (1.0 - warmth * X[:, 0] / 1000.0) * pressure
        assert traction[:, 0] == pytest.approx(expected, abs=1e-9 * PRESSURE)


@pytest.mark.mpi
def test_a_constant_may_change_between_steps():
    mu = []

    def make(msh, surface):
        mu.append(constant(msh, 0.3))
        return ff.Coulomb(mu[0])

    model = dragged(make, "change_")
    assert model.move(0.05, -DEPTH).contacts[0].force[0] == pytest.approx(-3.0, rel=1e-9)
    mu[0].value = 0.1
    assert model.move(0.08, -DEPTH).contacts[0].force[0] == pytest.approx(-1.0, rel=1e-9)
    mu[0].value = -0.1
    with pytest.raises(ff.ContactInputError, match="must be >= 0"):
        model.move(0.09, -DEPTH)


@pytest.mark.mpi
@pytest.mark.parametrize("corrector", ["projection", "ramp"])
def test_permanent_stick_holds_any_traction_and_lets_go_when_pulled(corrector):
    model = dragged(lambda m, s: ff.PermanentStick(), "stuck_", corrector=corrector)
    model.move(0.0, -DEPTH)
    report = model.move(0.08, -DEPTH)
    assert report.certified
    *_, slip = model.nodes()
    totals = report.contacts[0]
    assert totals.slip == 0
    assert totals.stick >= 2
    assert abs(totals.force[0]) > 1.1 * totals.force[1]  # more than mu = 1 would hold
    pressure = model.nodes()[1]
    assert np.max(abs(slip[pressure > 1e-9 * np.max(pressure)])) < 1e-12
    report = model.move(0.08, 0.3)  # less far, a wedged corner is a solution, too
    assert report.contacts[0].open == 5
    assert np.max(abs(model.nodes()[2])) < 1e-12 * PRESSURE
    # Pressed again where it is now, it sticks there.
    report = model.move(0.08, -DEPTH)
    assert report.contacts[0].force == pytest.approx((0.0, PRESSURE), abs=1e-9 * PRESSURE)


# -- orthotropic friction --------------------------------------------------------------------


def orthotropic_force(mu, angle, drag):
    """Return the force of unit pressure on a body that slides along ``drag``."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    M = turn @ np.diag(mu) @ turn.T
    return -M @ M @ drag / np.linalg.norm(M @ drag)


@pytest.mark.mpi
@pytest.mark.parametrize("angle", [0.4, 2.5])
def test_orthotropic_friction_is_on_the_ellipse_and_slip_normal_to_it(angle):
    mu, drag = (0.1, 0.25), np.array([0.8, 0.6])
    axis = (3.0 * np.cos(angle), 3.0 * np.sin(angle), 0.7)  # only its tangential part counts
    model = dragged(lambda m, s: ff.OrthotropicCoulomb(mu, axis), "ortho_", dim=3)
    for length in (0.05, 0.3, 1.5, 6.0, 20.0):  # the slip tends to the direction of the drag
        report = model.move(*(length * drag), -DEPTH)
        assert report.certified
    expected = PRESSURE * orthotropic_force(mu, angle, drag)
    force = np.array(report.contacts[0].force)
    assert report.contacts[0].slip == 9
    assert force == pytest.approx([*expected, PRESSURE], abs=1e-7 * PRESSURE)
    # Node by node, against the slip of the node itself; the frame of a horizontal plane is known.
    _, pressure, traction, _, slip = model.nodes()
    frames = model.contact.pairing.frames()
    e1 = np.concatenate(model.problem.comm.allgather(frames[:, 1]))
    e2 = np.cross([0.0, 0.0, 1.0], e1)
    vectors = traction[:, :1] * e1 + traction[:, 1:] * e2
    for p, vector, s in zip(pressure, vectors, slip, strict=True):
        assert vector[:2] == pytest.approx(
            p * orthotropic_force(mu, angle, s[:2]), abs=1e-9 * PRESSURE
        )


def test_orthotropic_with_equal_coefficients_is_coulomb():
    forces = []
    for law in (ff.Coulomb(0.3), ff.OrthotropicCoulomb((0.3, 0.3), (0.3, 1.0, 0.0))):
        model = dragged(lambda m, s, law=law: law, "equal_", dim=3)
        forces.append(
            [model.move(*d, -DEPTH).contacts[0].force for d in ((0.004, 0.0), (0.01, 0.02))]
        )
    assert np.array(forces[1]) == pytest.approx(np.array(forces[0]), rel=1e-9, abs=1e-9)


def test_orthotropic_friction_is_refused_where_it_has_no_meaning():
    for mu, axis in (((0.0, 0.1), (1, 0, 0)), ((0.1, 0.2), (0, 0, 0)), ((0.1, 0.2), (1, 0))):
        with pytest.raises(ff.ContactInputError):
            ff.OrthotropicCoulomb(mu, axis)


# -- normal functions ------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("corrector", ["projection", "ramp"])
def test_the_normal_function_does_not_change_the_solution(corrector):
    """Press, drag until the trailing edge lifts, lift: open, stick and slip in one history."""
    solutions = []
    for normal in laws.NORMAL_ROWS:
        model = dragged(lambda m, s: ff.Coulomb(0.9), "normal_", normal=normal, corrector=corrector)
        history = [model.move(*d) for d in ((0.004, -DEPTH), (0.02, -DEPTH), (0.0, -DEPTH / 2))]
        assert all(report.certified for report in history)
        solutions.append(model.problem.u.x.array.copy())
    scale = np.max(abs(solutions[0]))
    for other in solutions[1:]:
        assert other == pytest.approx(solutions[0], abs=1e-9 * scale)


# -- laws of users -----------------------------------------------------------------------------


class Viscous(ff.FrictionLaw):
    """``c_t = -eta s / dt`` in contact, as a row of its own."""

    def __init__(self, eta):
        self.eta = eta

    def limit(self, pressure, sliding):
        return pressure  # tells the row where there is contact

    def row(self, s, c_t, limit, r, eps):
        return c_t + ufl.conditional(ufl.gt(limit, 0.0), self.eta, 0.0) * s


@pytest.mark.mpi
def test_a_law_with_its_own_row_is_solved_but_not_certified():
    eta = 20.0
    model = dragged(lambda m, s: Viscous(eta), "viscous_")
    report = model.move(0.05, -DEPTH)
    certificate = report.certificate
    assert certificate.solved
    assert not certificate.certified
    assert not certificate.certifiable
    assert not report.certified
    assert certificate.as_dict()["certified"] is False
    _, pressure, traction, _, slip = model.nodes()
    assert np.all(pressure > 0.0)
    assert np.all(slip[:, 0] > 1e-3)
    assert traction[:, 0] == pytest.approx(-eta * slip[:, 0], abs=1e-9 * PRESSURE)
    assert check_jacobian(model.problem).error < 1e-6


@pytest.mark.mpi
def test_the_same_viscous_law_as_a_limit_is_certified():
    """``limit = eta |s| / dt`` is a cone at every slip, so that its projection is known."""

    class Certified(ff.FrictionLaw):
        def limit(self, pressure, sliding):
            return 20.0 * sliding.rate

    model, other = (
        dragged(lambda m, s, law=law: law, "cone_") for law in (Certified(), Viscous(20.0))
    )
    assert model.move(0.05, -DEPTH).certified
    other.move(0.05, -DEPTH)
    assert model.problem.u.x.array == pytest.approx(other.problem.u.x.array, abs=1e-11)


@pytest.mark.mpi
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_law_whose_limit_is_not_that_of_its_rows_is_refused(factor):
    class Pretending(ff.Coulomb):
        certifiable = True

        def row(self, s, c_t, limit, r, eps):
            return laws.projection_row(s, c_t, factor * limit, r, eps)

    model = dragged(lambda m, s: Pretending(0.3), "pretending_")
    with pytest.raises(ff.StepFailed) as failure:
        model.move(0.05, -DEPTH)
    assert failure.value.report.certificate.relative > 1e-3


@pytest.mark.parametrize(
    "arguments", [{"mu": -0.1}, {"mu": 0.1, "adhesion": -1.0}, {"mu": 0.1, "cap": float("nan")}]
)
def test_coefficients_are_checked(arguments):
    with pytest.raises(ff.ContactInputError, match="must be >= 0"):
        ff.Coulomb(**arguments)
