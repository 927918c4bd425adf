"""Multigrid finds what the direct solver finds, for all states, laws, obstacles and bulks."""

from dataclasses import replace

import numpy as np
import pytest

import fenicsx_friction as ff
from bodies import stack
from models import block, with_contact

pytestmark = pytest.mark.mpi
PATH = [(0.0, 0.0, -0.01), (0.004, 0.002, -0.01), (0.02, 0.005, -0.008), (0.0, 0.0, -0.006)]


LAWS = {
    "orthotropic": ff.OrthotropicCoulomb((0.2, 0.6), (1.0, 1.0, 0.0)),
    "adhesive": ff.Coulomb(0.3, adhesion=0.5),
    "capped": ff.Coulomb(0.8, cap=4.0),
    "path": ff.Coulomb(lambda pressure, sliding: 0.2 + 0.3 * sliding.path / 0.02),
    "rate": ff.Coulomb(lambda pressure, sliding: 0.5 / (1.0 + 10.0 * sliding.rate)),
    "stuck": ff.PermanentStick(),
    "smooth": ff.Frictionless(),
}


def follow(make, path=PATH):
    """Return reports and unknowns of all steps."""
    model, found = make, []
    for place in path:
        model.move(*place)
        report = model.problem.solve()
        assert report.certified
        found.append((report, [f.x.array.copy() for f in model.problem.state]))
    return found


def assert_same(direct, multigrid):
    """Compare the states of all steps, and see that multigrid was at work."""
    for (exact, states), (report, others) in zip(direct, multigrid, strict=True):
        assert report.linear_solver == "multigrid" and report.solver == "full"
        assert exact.linear_solver == "direct"
        if report.iterations:
            assert report.krylov >= report.iterations
        for a, b in zip(states, others, strict=True):
            assert np.max(abs(a - b), initial=0.0) <= 1e-9 * max(np.max(abs(a), initial=0.0), 1e-300)


@pytest.mark.parametrize("energy", ["small", "finite"])
@pytest.mark.parametrize("mu", [0.0, 0.3, 1.0, 5.0])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_block_on_a_plane(cell, mu, energy):
    def made(linear):
        name = f"mg_{linear}_{cell}_{mu}_{energy}_"
        return block(cell, mu, name, n=(6, 5, 4), energy=energy, linear_solver=linear, solver="full")

    assert_same(follow(made("direct")), follow(made("multigrid")))


@pytest.mark.parametrize("law", LAWS)
def test_laws(law):
    def made(linear):
        body = block("hexahedron", 0.1, f"mg_{law}_{linear}_body_", n=(6, 5, 3))
        surface, plane = body.contact.surface, body.contact.obstacle
        contact = ff.Contact(surface, plane, LAWS[law])
        options = {"linear_solver": linear, "settings": ff.StepSettings(solver="full")}
        problem = with_contact(body, contact, f"mg_{law}_{linear}_", **options)
        return replace(body, problem=problem, contact=contact)

    assert_same(follow(made("direct")), follow(made("multigrid")))


@pytest.mark.parametrize("kind", ["sphere", "cylinder", "moving"])
def test_obstacles(kind):
    def made(linear):
        body = block("hexahedron", 0.1, f"mg_{kind}_{linear}_body_", n=(8, 6, 3), energy="finite")
        if kind == "sphere":
            obstacle = ff.RigidSphere((0.6, 0.45, -0.8), 0.8)
        elif kind == "cylinder":
            obstacle = ff.RigidCylinder((0.0, 0.45, -0.7), (1.0, 0.0, 0.0), 0.7)
        else:
            motion = ff.RigidMotion(body.problem.u.function_space.mesh)
            obstacle = ff.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), motion=motion)
        contact = ff.Contact(body.contact.surface, obstacle, ff.Coulomb(0.4))
        options = {"linear_solver": linear, "settings": ff.StepSettings(solver="full")}
        problem = with_contact(body, contact, f"mg_{kind}_{linear}_", **options)
        return replace(body, problem=problem, contact=contact)

    assert_same(follow(made("direct")), follow(made("multigrid")))


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("energy", ["small", "finite"])
def test_two_bodies(cell, energy):
    def made(linear):
        name = f"mg_pair_{linear}_{cell}_{energy}_"
        settings = {"linear_solver": linear, "solver": "full"}
        return stack(0.4, name, cell=cell, upper=(5, 5, 3), energy=energy, **settings)

    path = [(0.0, 0.0, -0.02), (0.01, 0.0, -0.02), (0.06, 0.02, -0.03)]
    assert_same(follow(made("direct"), path), follow(made("multigrid"), path))
