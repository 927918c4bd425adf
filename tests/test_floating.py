# SPDX-License-Identifier: MIT
"""Deformable bodies that conditions do not hold: carried by contact, or refused when they leave."""

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from scipy.spatial.transform import Rotation

import fenicsx_friction as ff
from bodies import box, joined, sides
from fenicsx_friction.equations.floating import FloatingBodies
from fenicsx_friction.increment.adrift import bodies_adrift
from models import by_place

CELLS = {2: mesh.CellType.quadrilateral, 3: mesh.CellType.hexahedron}
DENSITIES = {"small": ff.bulk.small_strain_energy, "finite": ff.bulk.neo_hooke_energy}
TURNS = {"rx": np.eye(3)[0], "ry": np.eye(3)[1], "rz": np.eye(3)[2]}


def turned(u, vector):
    """Return how a turn by a vector about the middle has moved a block, at its dofs."""
    d = len(u)
    x = u.function_space.tabulate_dof_coordinates()[:, :d] + u.x.array.reshape(-1, d)
    back = Rotation.from_rotvec(-vector).as_matrix()[:d, :d]
    return ((x - middle(u)) @ (np.eye(d) - back).T).ravel()


class Block:
    """A block of sides 1 without conditions: on a plane, or between two loaded platens."""

    def __init__(
        self,
        name,
        d=2,
        mu=0.0,
        energy="small",
        platens=False,
        springs=0.0,
        skew=0.0,
        plane=False,
        size=1.0,
        numbers=None,
        law=None,
    ):
        make = mesh.create_rectangle if d == 2 else mesh.create_box
        msh = make(MPI.COMM_WORLD, [(-0.5,) * d, (0.5,) * d], numbers or [4] * d, CELLS[d])
        up = d - 1
        parts = [
            mesh.locate_entities_boundary(msh, up, lambda x, y=y: np.isclose(x[up], y))
            for y in (0.5, -0.5)
        ]
        facets, which = np.concatenate(parts), np.repeat([1, 2], [len(p) for p in parts])
        order = np.argsort(facets)
        tags = mesh.meshtags(msh, up, facets[order], which[order].astype(np.int32))
        left = mesh.locate_entities_boundary(msh, up, lambda x: np.isclose(x[0], -0.5))
        msh.geometry.x[:, 0] += skew * (msh.geometry.x[:, up] + 0.5)
        msh.geometry.x[:] *= size
        V = fem.functionspace(msh, ("Lagrange", 1, (d,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        stored = ff.bulk.stored_energy(
            DENSITIES[energy](self.u, ff.bulk.Elastic(100.0, 0.3)), ufl.dx
        )
        F = ufl.derivative(stored, self.u, v)
        ds = ufl.Measure("ds", msh, subdomain_data=tags)
        axis = [0.0] * up
        self.bodies, friction = [], law or (ff.Coulomb(mu) if mu else ff.Frictionless())
        motions = {1: None, 2: None}
        if platens:
            places = {1: 0.5 * size, 2: -0.5 * size}
            motions = {
                i: ff.RigidBody(msh, center=(*axis, y), name=f"platen {i}")
                for i, y in places.items()
            }
            self.bodies = list(motions.values())
        else:
            self.load = fem.Constant(msh, np.array([*axis, -1.0]))
            self.lean = fem.Constant(msh, 0.0)
            uneven = 1.0 + self.lean * ufl.SpatialCoordinate(msh)[0]
            F -= uneven * ufl.inner(self.load, v) * ds(1)
        if springs:
            F += springs * self.u[0] * v[0] * ds(1)
        dofs = fem.locate_dofs_topological(V.sub(0), up, left)
        bcs = [fem.dirichletbc(0.0, dofs, V.sub(0))] if plane else []
        half = 0.5 * size
        sides = {1: (half, -1.0), 2: (-half, 1.0)} if platens else {2: (-half, 1.0)}
        contacts = [
            ff.Contact(
                ff.ContactSurface(msh, tags, i, {1: "top", 2: "base"}[i]),
                ff.RigidPlane((*axis, y), (*axis, n), motion=motions[i]),
                friction,
            )
            for i, (y, n) in sides.items()
        ]
        self.problem = ff.FrictionalContactProblem(
            F, self.u, contact=contacts, bcs=bcs, petsc_options_prefix=name
        )

    def drifted(self, **by):
        """Say who would have drifted, had all bodies come by these components (m; rad)."""
        start = [f.x.array.copy() for f in self.problem.unknowns]
        floating, linear = self.problem.floating, self.problem.stiffness.linear
        shapes, units = floating.motions(0, undeformed=linear)
        for name, way in by.items():
            j = floating.names.index(name)
            if name in TURNS and not linear:
                start[0] -= turned(self.u, TURNS[name] * way)
            else:
                start[0] -= way / units[j] * shapes[:, j]
            for q in start[1:]:
                q[j] -= way
        return bodies_adrift(self.problem, start)


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("energy", DENSITIES)
@pytest.mark.parametrize("d", [2, 3])
def test_a_block_on_a_frictionless_plane_may_not_fly_along_it(d, energy):
    """Pressure holds it across the plane and upright; springs, friction or conditions along it."""
    up = "y" if d == 2 else "z"
    names = ("x",) if d == 2 else ("x", "y", "rz")
    block = Block(f"slides_{d}{energy}_", d, energy=energy)
    assert block.problem.solve().certified
    assert block.drifted() == []
    for name in names:
        way = 2.5 if name in TURNS else 5.0  # less than half a turn
        (line,) = block.drifted(**{name: way})
        moved = f"has moved in {name} by {way:.3g}, where"
        assert line.startswith(f"the body with the surface 'base' {moved}")
    for turn in (0.3, 1.0, 3.0) if d == 3 else ():  # a turn is no deformation, however large
        assert block.drifted(x=0.05, rz=turn) != []
    held = {up: 5.0, **({"rz": 0.1} if d == 2 else {"rx": 0.1, "ry": 0.1})}
    assert block.drifted(**held) == []
    for options in ({"mu": 0.3}, {"springs": 1.0}, {"plane": True}) if energy == "small" else ():
        carried = Block(f"carried_{d}{next(iter(options))}_", d, **options)
        assert carried.problem.solve().certified
        assert carried.drifted(x=5.0) == []


@pytest.mark.mpi
@pytest.mark.parametrize("energy", DENSITIES)
@pytest.mark.parametrize("d", [2, 3])
def test_a_block_that_has_flown_so_far_that_it_is_one_point_is_adrift(d, energy):
    """Its nodes are at one place, to the last digit: turns about it have no shape but rounding."""
    block = Block(f"far_{d}{energy}_", d, energy=energy)
    start = [f.x.array.copy() for f in block.problem.unknowns]
    for far in 10.0 ** np.arange(2, 140, 3):
        for way in np.random.default_rng(1).uniform(-1.0, 1.0, (4, d)):
            block.u.x.array[:] = np.tile(far * way, len(block.u.x.array) // d)
            (line,) = bodies_adrift(block.problem, start)
            assert line.startswith("the body with the surface 'base' has moved in")


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_a_block_that_is_stretched_without_bounds_is_no_solution(d):
    """There its forces are as small as those of a block at rest."""
    block = Block(f"burst_{d}_", d, energy="finite")
    problem, start = block.problem, [f.x.array.copy() for f in block.problem.unknowns]
    block.load.value[:] = 0.0
    x = block.u.function_space.tabulate_dof_coordinates()[:, :d]
    # As near as rounding comes to a turn, times a number.
    stretch = Rotation.from_rotvec([0.0, 0.0, 1.0]).as_matrix()[:d, :d]
    for by, stretched in ((1e2, False), (1e5, True), (1e33, True)):
        block.u.x.array[:] = (x @ (by * stretch)).ravel()
        lines = [line for line in bodies_adrift(problem, start) if "been stretched by" in line]
        assert len(lines) == stretched
    forces = problem.comm.allreduce(np.max(abs(problem.balance.momentum()), initial=0.0), MPI.MAX)
    assert forces < 1e-6


@pytest.mark.mpi
@pytest.mark.parametrize("size", [1.0, 1e-6])
@pytest.mark.parametrize("stiffness", [1e-2, 1e-6])
def test_a_weak_spring_holds_in_all_units(size, stiffness):
    """A traction on it moves the block by its quotient, however small beside the pressure."""
    block = Block(
        f"spring_{size}{stiffness}_".replace(".", ""), springs=stiffness / size, size=size
    )
    assert block.problem.solve().certified
    block.load.value[0] = 0.3 * stiffness
    assert block.problem.solve().certified
    assert middle(block.u)[0] == pytest.approx(0.3 * size, rel=1e-5)


def middle(u):
    """Return the middle of the displacements."""
    x = by_place(u).reshape(-1, u.function_space.dofmap.bs)
    return 0.5 * (x.max(axis=0) + x.min(axis=0))


@pytest.mark.mpi
@pytest.mark.parametrize("mu", [0.0, 0.3])
@pytest.mark.parametrize("numbers", [(4, 2), (6, 3), (8, 4)])
def test_an_unloaded_block_has_not_flown(numbers, mu):
    """Without load a node may touch with forces of rounding, which hold nothing."""
    block = Block(
        f"unloaded_{numbers[0]}{mu}_".replace(".", ""), mu=mu, energy="finite", numbers=numbers
    )
    block.lean.value = 0.7
    certified = 0
    for load in (5.0, 7.0, 5.0, 0.0, 5.0, 5.0 * np.sin(np.pi), 5.0):
        block.load.value[1] = -load
        before = middle(block.u)
        try:
            certified += block.problem.solve().certified
        except ff.StepFailed:
            continue
        assert np.all(abs(middle(block.u) - before) < 0.8)  # ten times the squeeze
    assert certified >= 4


@pytest.mark.mpi
@pytest.mark.parametrize("energy", DENSITIES)
@pytest.mark.parametrize("method", ["node-to-face", "mortar"])
def test_an_unloaded_block_has_not_flown_from_its_base(method, energy):
    """No node is closed, and the stiffness times a motion is rounding."""
    boxes = (((0, 0), (2, 0.5), (8, 2)), ((0.5, 0.5), (1.5, 1.0), (6, 3)))
    msh = joined(MPI.COMM_WORLD, *(box(*b, "quadrilateral") for b in boxes))
    tags = sides(msh, 1, (0, 0.5, 0.5, 1.0), 1e-6)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v, held = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    density = DENSITIES[energy](u, ff.bulk.Elastic(1000.0, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    load, x = fem.Constant(msh, 0.0), ufl.SpatialCoordinate(msh)
    F += load * (0.5 + x[0]) * v[1] * ufl.ds(domain=msh, subdomain_data=tags)(4)
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1, "block"),
        ff.DeformableObstacle(ff.ContactSurface(msh, tags, 2, "base"), method=method),
        ff.Coulomb(0.4),
    )
    base = fem.locate_dofs_topological(V, 1, tags.find(3))
    problem = ff.FrictionalContactProblem(
        F,
        u,
        contact=contact,
        bcs=[fem.dirichletbc(held, base)],
        petsc_options_prefix=f"off_base_{method}_{energy}_",
    )
    certified = 0
    for pressure, along in (
        (20.0, 0.0),
        (20.0, 0.6),
        (5.0, 0.6),
        (0.0, 0.6),
        (0.0, 0.3),
        (20.0, 0.6),
    ):
        load.value, held.x.array[0::2] = pressure, along
        before = middle(u)
        try:
            certified += problem.solve().certified
        except ff.StepFailed:
            continue
        assert np.all(abs(middle(u) - before) < 0.7)
    assert certified >= 3


@pytest.mark.mpi
@pytest.mark.parametrize("energy", DENSITIES)
@pytest.mark.parametrize("d", [2, 3])
def test_platens_and_what_is_between_them_drift_together(d, energy):
    """Each alone is held by friction of the others, all together by nothing, or by the lower."""
    block = Block(f"between_{d}{energy}_", d, 0.3, energy, platens=True)
    upper, lower = block.bodies
    upper.given.value[d - 1] = -0.01
    assert block.problem.solve().certified
    upper.free, lower.free = ("x", "y", "z")[:d], ("x", "y")[: d - 1]
    upper.force.value[d - 1] = -1.0
    assert block.problem.solve().certified
    assert block.drifted() == []
    lines = block.drifted(x=5.0)
    owners = ("rigid body 'platen 1'", "rigid body 'platen 2'", "the body with the surface 'top'")
    assert len(lines) == 3
    for line, owner in zip(lines, owners, strict=True):
        assert line.startswith(f"{owner[:-1]}")
        assert "has moved in x by 5," in line
    lower.free = ()
    assert block.drifted(x=5.0) == []
    lower.free, lower.spring.value[0] = ("x",), 1e-3
    assert block.drifted(x=5.0) == []


@pytest.mark.mpi
def test_a_platen_without_friction_goes_where_moments_balance():
    """A moment M and a load F move it by M/F along an upright block: its turn holds its motion."""
    block = Block("moments_", platens=True)
    upper, lower = block.bodies
    upper.given.value[1] = -0.01
    block.problem.solve()
    upper.free, lower.free = ("x", "y", "rz"), ("x",)
    upper.force.value[1], upper.moment.value[:] = -0.03, 0.006
    assert block.problem.solve().certified
    along = upper.q.x.array[0] - middle(block.u)[0]
    assert along == pytest.approx(0.006 / 0.03, abs=1e-3)
    assert abs(upper.q.x.array[2]) < 1e-3


@pytest.mark.parametrize("mu", [0.1, 0.5])
def test_certified_blocks_between_free_platens_have_not_flown(mu):
    """Platens that may slide and turn press a leaning block: a flight was certified once."""
    block = Block(f"flown_{mu}_".replace(".", ""), mu=mu, platens=True, skew=0.3)
    upper, lower = block.bodies
    upper.given.value[1] = -0.01
    block.problem.solve()
    rng, certified = np.random.default_rng(1), 0
    for i in range(6):
        upper.free, lower.free = ("x", "y", "rz")[: 2 + i % 2], ("x", "rz")[: 1 + (i % 3 > 0)]
        upper.force.value[1] = -abs(rng.normal())
        upper.moment.value[:] = 0.01 * rng.normal() * (i % 2)
        before = block.u.x.array.reshape(-1, 2)[:, 0].mean()
        try:
            certified += block.problem.solve().certified
        except ff.StepFailed:
            continue
        assert abs(block.u.x.array.reshape(-1, 2)[:, 0].mean() - before) < 0.2
    assert certified >= 2


@pytest.mark.mpi
@pytest.mark.parametrize("d", [2, 3])
def test_what_conditions_hold(d):
    """A point holds no turn, a plane of symmetry no motion along it; a facet holds all."""
    make = mesh.create_rectangle if d == 2 else mesh.create_box
    cell = {2: mesh.CellType.triangle, 3: mesh.CellType.tetrahedron}[d]
    msh = make(MPI.COMM_WORLD, [(0.0,) * d, (1.0,) * d], [3] * d, cell)
    P1 = basix.ufl.element("Lagrange", msh.basix_cell(), 1)
    bubble = basix.ufl.element("Bubble", msh.basix_cell(), d + 1)
    mini = basix.ufl.blocked_element(basix.ufl.enriched_element([P1, bubble]), shape=(d,))
    for element in (mini, ("Lagrange", 1, (d,)), ("Lagrange", 2, (d,))):
        V = fem.functionspace(msh, element)
        u = fem.Function(V)

        def held(where, part=None, V=V):
            W = V if part is None else V.sub(part)
            facets = mesh.locate_entities_boundary(msh, 0 if part is None else d - 1, where)
            dofs = fem.locate_dofs_topological(W, 0 if part is None else d - 1, facets)
            value = np.zeros(d) if part is None else 0.0
            return fem.dirichletbc(value, dofs, W)

        corner = held(lambda x: np.all(abs(x[:d]) < 1e-12, axis=0))
        plane = held(lambda x: abs(x[0]) < 1e-12, 0)
        planes = [held(lambda x, i=i: abs(x[i]) < 1e-12, i) for i in range(d)]
        for bcs, floats in (([], True), ([corner], True), ([plane], True), (planes, False)):
            assert FloatingBodies(u, bcs).bodies == [0] * floats
        assert FloatingBodies(u, [corner, plane]).bodies == [0] * (d == 3)
        floating = FloatingBodies(u, [])
        shapes, _ = floating.motions(0, undeformed=True)
        for j in range(len(floating.names)):
            u.x.array[:] = shapes[:, j]
            strain = ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(u))) * ufl.dx
            assert msh.comm.allreduce(fem.assemble_scalar(fem.form(strain))) < 1e-24
            moved, rest = floating.moved(0, -2.0 * u.x.array, undeformed=True)
            assert np.allclose(moved, 3.0 * np.eye(len(floating.names))[j], atol=1e-12)
            assert rest < 1e-12
