"""Obstacles at one point, without bodies: gaps, frames and slip in closed form; wrong ones."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.obstacles.kinematics import Kinematics
from fenicsx_friction.obstacles.shapes import _Place
from rectangles import AXIS, turned


def numbers(vector):
    return ufl.as_vector([ufl.as_ufl(float(v)) for v in vector])


def values(msh, expression):
    """Evaluate a UFL vector of Constants."""
    point = np.zeros((1, msh.topology.dim))
    compiled = fem.Expression(expression, point, comm=MPI.COMM_SELF)
    return compiled.eval(msh, np.array([0], dtype=np.int32)).reshape(-1)


def off_axis(x):
    return x - np.dot(x, AXIS) * AXIS


def tilted(x):
    return np.dot(x - np.array([0.1, 0.2, 0.3]), AXIS)


#: Obstacle, gap and normal of a point.
SHAPES = {
    "line": (
        ff.RigidPlane((1.0, 0.5), (3.0, 4.0)),
        lambda x: 0.6 * (x[0] - 1.0) + 0.8 * (x[1] - 0.5),
        lambda x: np.array([0.6, 0.8]),
    ),
    "plane": (ff.RigidPlane((0.1, 0.2, 0.3), (2.0, 4.0, 4.0)), tilted, lambda x: AXIS),
    "circle": (
        ff.RigidSphere((0.0, 0.0), 0.5),
        lambda x: np.linalg.norm(x) - 0.5,
        lambda x: x / np.linalg.norm(x),
    ),
    "socket": (
        ff.RigidSphere((0.0, 0.0, 0.0), 3.0, inside=True),
        lambda x: 3.0 - np.linalg.norm(x),
        lambda x: -x / np.linalg.norm(x),
    ),
    "cylinder": (
        ff.RigidCylinder((2.0, 4.0, 4.0), 5.0 * AXIS, 0.4),
        lambda x: np.linalg.norm(off_axis(x)) - 0.4,
        lambda x: off_axis(x) / np.linalg.norm(off_axis(x)),
    ),
    "bearing": (
        ff.RigidCylinder((0.0, 0.0, 0.0), AXIS, 2.0, inside=True),
        lambda x: 2.0 - np.linalg.norm(off_axis(x)),
        lambda x: -off_axis(x) / np.linalg.norm(off_axis(x)),
    ),
    "paraboloid": (
        ff.ImplicitObstacle(lambda X: X[2] - X[0] ** 2 - 2.0 * X[1] ** 2),
        lambda x: x[2] - x[0] ** 2 - 2.0 * x[1] ** 2,
        lambda x: (n := np.array([-2 * x[0], -4 * x[1], 1.0])) / np.linalg.norm(n),
    ),
}


PLANES = [name for name, (shape, *_) in SHAPES.items() if isinstance(shape, ff.RigidPlane)]


@pytest.mark.quick
@pytest.mark.parametrize(
    ("name", "place"),
    [*((name, False) for name in SHAPES), *((name, True) for name in PLANES)],  # by displacements
)
def test_gap_frame_and_slip_in_closed_form(name, place):
    """Of an obstacle that has been moved, and moves in the step."""
    shape, gap, normal = SHAPES[name]
    d = 2 if name in ("line", "circle") else 3
    create = mesh.create_rectangle if d == 2 else mesh.create_box
    msh = create(MPI.COMM_SELF, [[0] * d, [1] * d], [1] * d)
    center, shift = np.array([0.3, -0.1, 0.2])[:d], np.array([0.05, 0.02, -0.04])[:d]
    motion = ff.RigidMotion(msh, center=center, axis=2.0 * AXIS)
    obstacle = replace(shape, motion=motion)
    X, u, u_old, hint = (fem.Constant(msh, np.zeros(d)) for _ in range(4))
    hint.value[0], X.value[:] = 1.0, np.array([0.4, -0.9, 0.5])[:d]
    if place:
        direction = np.array(shape.normal) / np.linalg.norm(shape.normal)
        place = _Place(numbers(direction), numbers(shape.point), ufl.as_ufl(gap(X.value)))
        obstacle = replace(obstacle, place=place)
    kin = Kinematics.of(obstacle.kinematic_values(X, u, u_old, hint), d)
    parts = [[kin.gap], kin.normal, *kin.tangents, kin.slip, kin.position]
    found = ufl.as_vector([entry for part in parts for entry in part])
    sizes = np.cumsum([1, *[d] * d, d - 1])
    for old, now in ((0.0, 0.0), (0.25, 0.6), (2.0, -0.7)):
        motion.angle.value, motion.translation.value = old, 0.1 * shift
        motion.commit()
        motion.angle.value, motion.translation.value = now, shift
        x, x_old = np.array([0.7, -0.8, 1.1])[:d], np.array([0.68, -0.83, 1.05])[:d]
        u.value, u_old.value = x - X.value, x_old - X.value
        R, step = turned(now, d), turned(now - old, d)
        back = center + R.T @ (x - center - shift)
        carried = center + shift + step @ (x_old - center - 0.1 * shift)
        g, n, *tangents, slip, position = np.split(values(msh, found), sizes)
        tangents = np.array(tangents)
        assert g == pytest.approx([gap(back)], rel=1e-13)
        assert n == pytest.approx(R @ normal(back), abs=1e-13)
        assert tangents @ tangents.T == pytest.approx(np.eye(d - 1), abs=1e-13)
        assert tangents @ n == pytest.approx(np.zeros(d - 1), abs=1e-13)
        if d == 2:
            assert tangents[0] == pytest.approx([n[1], -n[0]], abs=1e-13)
        else:
            assert np.linalg.det([n, *tangents]) == pytest.approx(1.0, rel=1e-13)
            assert tangents[0, 0] > 0.0  # along the hint
            assert tangents[1, 0] == pytest.approx(0.0, abs=1e-13)
        assert slip == pytest.approx(tangents @ (x - carried), abs=1e-13)
        assert position == pytest.approx(x, abs=1e-13)


def test_wrong_obstacles_are_refused():
    with pytest.raises(ff.ContactInputError, match="has no direction"):
        ff.RigidPlane((0, 0), (0, 0))
    with pytest.raises(ff.ContactInputError, match="radius"):
        ff.RigidSphere((0, 0), -1.0)
    with pytest.raises(ff.ContactInputError, match="axis"):
        ff.RigidCylinder((0, 0, 0), (0, 0, 0), 1.0)
    with pytest.raises(ff.ContactInputError, match="cannot be met by points of 2"):
        ff.RigidPlane((0, 0, 0), (0, 0, 1)).gap(numbers([0, 0]))
    with pytest.raises(ff.ContactInputError, match="must return a UFL scalar"):
        ff.ImplicitObstacle(lambda X: 2 * X).gap(numbers([0, 0]))
    msh = mesh.create_rectangle(MPI.COMM_SELF, [[0, 0], [1, 1]], [1, 1])
    with pytest.raises(ff.ContactInputError, match="2 finite numbers; it has 3"):
        ff.RigidMotion(msh, center=(0, 0, 0))
