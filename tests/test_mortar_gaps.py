"""Mortar contact where one surface has a step or a chamfer below a face of the other."""

import numpy as np
import pytest

from bodies import stack
from models import gathered

pytestmark = pytest.mark.mpi
DROP, WIDTH = 0.1, 0.1


def chamfered(x):
    """Lower the edge of the base along a slope."""
    return DROP * np.clip((WIDTH - x) / WIDTH, 0.0, 1.0)


def rounded(x):
    """Lower it along a quarter of a circle."""
    return DROP * (1.0 - np.sqrt(1.0 - np.clip((WIDTH - x) / WIDTH, 0.0, 1.0) ** 2))


def stepped(x):
    """Lower a strip of four faces of the base, and a fifth that goes up from it."""
    return 0.5 * DROP * (x < 0.225)


def block_on(drop, n, name, *, degree=1, method="mortar", cell="quadrilateral"):
    """A block that stands on a base whose edge is lowered below it; both have E = 1000."""

    def warp(x):
        y = x.copy()
        y[-1] += np.where(x[-1] < 0.25, -drop(x[0]) * (1.0 + x[-1]), -0.5)
        return y

    flat = {"upper": (n, n), "lower": (40, 4)}
    flat |= {"top": ((0.0, 0.5), (1.0, 1.5)), "base": ((0.0, -1.0), (2.0, 0.0))}
    deep = {"upper": (n, 2, n), "lower": (40, 1, 4)}
    deep |= {"top": ((0.0, 0.2, 0.5), (1.0, 0.8, 1.5)), "base": ((0.0, 0.0, -1.0), (2.0, 1.0, 0.0))}
    shape = deep if cell == "hexahedron" else flat
    shape |= {"cell": cell, "degree": degree, "method": method}
    return stack(0.0, name, nu=0.0, energy="small", warp=warp, **shape)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 8, 16])
@pytest.mark.parametrize("drop", [chamfered, rounded, stepped])
def test_bodies_that_only_touch_do_not_press(drop, n):
    """Where no point overlaps no average may: dual functions, negative in places, had 1 to 3 N."""
    model = block_on(drop, n, f"touch_{drop.__name__}_{n}_")
    report = model.problem.solve().contacts[0]
    assert np.linalg.norm(report.force) <= 1e-10
    assert report.penetration <= 1e-12
    assert np.max(abs(gathered(model.problem)[2])) <= 1e-12


@pytest.mark.parametrize(
    ("cell", "degree"), [("quadrilateral", 2), ("triangle", 2), ("hexahedron", 1)]
)
def test_nor_do_other_faces(cell, degree):
    model = block_on(chamfered, 2, f"touch_{cell}_{degree}_", degree=degree, cell=cell)
    model.move(*[0.0] * (2 if cell == "hexahedron" else 1), 1e-9)  # free of rounding
    report = model.problem.solve().contacts[0]
    assert np.linalg.norm(report.force) <= 1e-10
    assert report.penetration <= 1e-12


@pytest.mark.parametrize(("drop", "last"), [(chamfered, 0.01), (stepped, 0.08)])
def test_pressed_they_have_the_force_of_fine_faces(drop, last):
    """Pressed by 0.001: the average gap of coarse faces is open above the drop, never closed."""
    name = drop.__name__
    fine = block_on(drop, 64, f"fine_{name}_", method="node-to-face")
    fine.move(0.0, -0.001)
    right, errors = fine.problem.solve().contacts[0].force[1], []
    for n in (4, 8, 16, 32):
        model = block_on(drop, n, f"press_{name}_{n}_")
        model.move(0.0, -0.001)
        force = model.problem.solve().contacts[0].force
        assert abs(force[0]) <= 1e-3 * force[1]
        errors.append(1.0 - force[1] / right)
    assert np.all(np.diff(errors) < 0.0)
    assert errors[0] < 0.35
    assert -1e-3 < errors[-1] < last
