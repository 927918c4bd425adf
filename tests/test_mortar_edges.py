"""Mortar contact of a block on its edge: its own faces do not know in which direction to press."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import box, joined
from fenicsx_friction.obstacles.edges import Edges
from models import tagged_facets


def on_edge(angle, name, *, n=16, base=30, degree=1, flat=False, method="mortar"):
    """A soft block, turned by an angle (degrees), with its corner at (1, 0) of a stiff flat base.

    Args:
        angle: As said.
        name: Prefix of the PETSc options.
        n: Faces of the block's bottom.
        base: Faces of the base.
        degree: Of the displacement.
        flat: Take the base's surface as the secondary one.
        method: How they meet.
    """
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    ends = ((0.0, 0.0), (1.0, 0.8)) if angle > 0.0 else ((-1.0, 0.0), (0.0, 0.8))
    block = box(*ends, (n, n), "quadrilateral")
    turned = block.geometry.x[:, :2] @ np.array([[cosine, sine], [-sine, cosine]])
    block.geometry.x[:, :2] = turned + [1.0, 0.0]
    msh = joined(MPI.COMM_SELF, box((0.0, -1.0), (3.0, 0.0), (base, 6), "quadrilateral"), block)
    up = lambda x: (x[1] * cosine - (x[0] - 1.0) * sine) * np.where(x[1] < -1e-9, np.nan, 1.0)  # noqa: E731
    tags = tagged_facets(
        msh,
        lambda x: np.isclose(up(x), 0.0),
        lambda x: np.isclose(x[1], 0.0),
        lambda x: np.isclose(up(x), 0.8),
        lambda x: np.isclose(x[1], -1.0),
    )
    V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Constant(msh, (0.0, 0.0))
    young = fem.Function(fem.functionspace(msh, ("DG", 0)))
    middles = mesh.compute_midpoints(msh, 2, np.arange(len(young.x.array), dtype=np.int32))
    young.x.array[:] = np.where(middles[:, 1] > 0.0, 1e3, 1e6)
    density = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(young, 0.3))
    surfaces = [
        ff.ContactSurface(msh, tags, tag, text) for tag, text in ((1, "block"), (2, "base"))
    ]
    secondary, primary = surfaces[::-1] if flat else surfaces
    contact = ff.Contact(
        secondary, ff.DeformableObstacle(primary, method=method), ff.Frictionless()
    )
    held = [fem.locate_dofs_topological(V, 1, tags.find(tag)) for tag in (3, 4)]
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(top, held[0], V), fem.dirichletbc(np.zeros(2), held[1], V)],
        petsc_options_prefix=name,
    )
    return SimpleNamespace(problem=problem, top=top, sign=-1.0 if flat else 1.0)


def press(model, x, depth):
    """Return the force on the block."""
    model.top.value[:] = (x, -depth)
    return model.sign * np.array(model.problem.solve().contacts[0].force)


@pytest.mark.parametrize(
    ("angle", "degree", "depth"),
    [(20.0, 1, 0.02), (-20.0, 1, 0.02), (20.0, 2, 0.02), (20.0, 1, 0.04), (10.0, 1, 0.01)],
)
def test_a_block_on_its_edge_is_refused_as_the_secondary_one(angle, degree, depth):
    """Without friction a flat base can only push up; the block's faces push along themselves."""
    model = on_edge(angle, f"edge_{angle:g}_{degree}_{depth}_", degree=degree)
    with pytest.raises(ff.StepFailed, match="Take the flat body's surface as the secondary one"):
        press(model, 0.0, depth)


def test_what_is_refused_is_wrong_by_as_much_as_is_measured(monkeypatch):
    """Unchecked, the force leans, and dragging one way makes energy out of nothing."""
    parts = []

    def measure(self, element, force, held):
        """Keep the part of the force in a wrong direction."""
        tilts = element.averages(element.tilts()) * (self._nodes[:, None] & ~held)
        parts.append(np.linalg.norm(force @ tilts) / np.sum(force))
        return np.zeros(len(force), dtype=bool)

    monkeypatch.setattr(Edges, "askew", measure)
    model = on_edge(20.0, "unchecked_")
    for x in (0.0, 0.05, 0.1):
        force = press(model, x, 0.02)
        assert abs(force[0]) > 0.1 * force[1] > 0.1
        assert abs(force[0]) == pytest.approx(parts[-1] * force[1], rel=0.05)


@pytest.mark.parametrize(("flat", "method"), [(True, "mortar"), (False, "node-to-face")])
def test_dragging_there_and_back_costs_nothing_without_friction(flat, method):
    """The ways out that the message names: the hand does no work on either way."""
    model = on_edge(20.0, f"drag_{method}_", base=60 if flat else 30, flat=flat, method=method)
    force = press(model, 0.0, 0.04)
    for x in (0.05, 0.1, 0.05, 0.0):
        force = press(model, x, 0.04)
        assert force[1] > 1.0
        assert abs(force[0]) < 2e-3 * force[1]


def test_a_block_that_is_hardly_tilted_is_taken():
    """It lies down on the base as it is pressed: no part of the force is wrong by 5 %."""
    force = press(on_edge(1.0, "lies_"), 0.0, 0.01)
    assert abs(force[0]) < 2e-3 * force[1]
