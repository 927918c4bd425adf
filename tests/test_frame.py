"""The contact frame: well defined for every normal and every set of prescribed directions."""

from itertools import product

import numpy as np
import pytest
import ufl
from dolfinx import fem

import fenicsx_friction as ff
from fenicsx_friction.contact.frame import choose_hints, pinned_directions, steep_hints
from models import block, rectangle_on, with_contact

AXES = np.eye(3)
OBLIQUE = np.array([[1.0, 2.0, 3.0], [1.0, -1.0, 0.0], [0.1, 0.0, -1.0]])
NORMALS = np.vstack([AXES, -AXES, OBLIQUE / np.linalg.norm(OBLIQUE, axis=1)[:, None]])


@pytest.mark.quick
@pytest.mark.parametrize("fixed", list(product([False, True], repeat=3)))
def test_first_tangent_exists_and_prescribed_directions_are_pinned(fixed):
    fixed = np.tile(fixed, (len(NORMALS), 1))
    hints = choose_hints(NORMALS, fixed)
    tangents = hints - np.sum(hints * NORMALS, axis=1)[:, None] * NORMALS
    assert np.all(np.linalg.norm(tangents, axis=1) > 0.05)
    pinned = pinned_directions(NORMALS, fixed)
    held = np.all(fixed | (abs(NORMALS) < 1e-12), axis=1)  # the normal lies in what is prescribed
    assert np.array_equal(pinned[:, 0], held)
    assert np.all(pinned[held])
    free = ~held
    number = fixed.sum(axis=1)
    assert np.array_equal(pinned[free, 1:].sum(axis=1), np.minimum(number[free], 2))
    one = free & (number == 1)
    assert np.array_equal(hints[one], fixed[one].astype(float))


@pytest.mark.mpi
def test_frames_follow_normals_and_tractions_stay():
    """A plane that turns towards the first tangent: without new frames these would be none."""
    model = block("hexahedron", 0.3, "turning_")
    contact, V = model.contact, model.problem.u.function_space
    motion = ff.RigidMotion(V.mesh, axis=(0.0, 1.0, 0.0))
    turning = ff.Contact(
        contact.surface, ff.RigidPlane((0, 0, 0), (0, 0, 1), motion=motion), ff.Coulomb(0.3)
    )
    with_contact(model, turning, "turns_")
    n = turning.surface.num_owned
    motion.angle.value = 0.45 * np.pi
    turning.c.x.array[:] = np.tile([3.0, 0.5, -0.2], len(turning.c.x.array) // 3)
    before, normals = turning.nodal_traction(), turning.pairing.normals()
    assert np.all(steep_hints(normals, turning.hint.x.array.reshape(-1, 3)[:n]))
    turning.choose_frames()
    assert not np.any(steep_hints(normals, turning.hint.x.array.reshape(-1, 3)[:n]))
    assert turning.nodal_traction() == pytest.approx(before, abs=1e-13)


def held_on(normal, friction, prefix, component=0):
    """Return a problem of a square whose base, on a plane, is held in one direction."""
    msh, tags = rectangle_on(normal)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    held, top = fem.Constant(msh, 0.0), fem.Function(V)
    W = V.sub(component)
    bcs = [
        fem.dirichletbc(held, fem.locate_dofs_topological(W, 1, tags.find(1)), W),
        fem.dirichletbc(top, fem.locate_dofs_topological(V, 1, tags.find(2))),
    ]
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0.0, 0.0), normal), friction
    )
    problem = ff.FrictionalContactProblem(
        F, u, contact=contact, bcs=bcs, petsc_options_prefix=prefix
    )
    return problem, held, top


@pytest.mark.mpi
def test_nodes_held_obliquely_to_the_surface_are_refused():
    """Friction of such a node could not be told from the reaction."""
    slope = np.array([-0.3, 1.0]) / np.hypot(0.3, 1.0)
    with pytest.raises(
        ff.ContactInputError, match=r"neither normal nor tangential .* Frictionless"
    ):
        held_on(slope, ff.Coulomb(0.3), "oblique_")
    problem, _, top = held_on(slope, ff.Frictionless(), "smooth_")
    top.x.array[1::2] = -0.01
    assert problem.solve().certified


@pytest.mark.mpi
def test_conditions_that_push_nodes_into_an_obstacle_are_refused():
    problem, held, top = held_on((0.0, 1.0), ff.Coulomb(0.3), "pushed_", component=1)
    top.x.array[1::2] = -0.01
    assert problem.solve().certified  # held on the plane, the base carries the reaction
    held.value = -0.01
    with pytest.raises(ff.StepFailed, match=r"push held nodes 0\.01 m into an obstacle"):
        problem.solve()


@pytest.mark.mpi
def test_what_is_prescribed_is_found_anew_when_normals_turn():
    """Held along the plane's normal at first, nodes take part once the plane has turned."""
    msh, tags = rectangle_on((0.0, 1.0))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    W = V.sub(1)
    held = fem.dirichletbc(0.0, fem.locate_dofs_topological(W, 1, tags.find(1)), W)
    motion = ff.RigidMotion(msh)
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1),
        ff.RigidPlane((-1.0, 0.0), (0.0, 1.0), motion=motion),
        ff.Coulomb(0.3),
    )
    ff.FrictionalContactProblem(F, u, contact=contact, bcs=[held], petsc_options_prefix="anew_")
    assert not np.any(contact.present().takes_part)
    motion.angle.value = -0.5 * np.pi  # the normal is along x now
    contact.choose_frames()
    state = contact.present()
    assert np.all(state.free[:, 0])
    assert not np.any(state.free[:, 1])  # and the tangent is what is held
    motion.angle.value = -0.25 * np.pi
    with pytest.raises(ff.ContactInputError, match="neither normal nor tangential"):
        contact.choose_frames()
