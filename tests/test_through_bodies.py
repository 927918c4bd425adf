"""Thin, small and sharp bodies that others go through within a step: refused, with the cause."""

from contextlib import nullcontext
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

import fenicsx_friction as ff
from bodies import box, joined, stack
from fenicsx_friction.obstacles import against_faces
from fenicsx_friction.obstacles.averaged import DEEP
from models import tagged_facets

pytestmark = pytest.mark.mpi
METHODS = ["node-to-face", "mortar"]
GAP = 0.5


def layers(cell, method, prefix):
    """A block above a foil that is clamped 0.3 above a base; the last two are one surface."""
    d = 2 if cell == "quadrilateral" else 3
    wide = lambda low, high: ((0.0,) * (d - 1) + (low,), (2.0,) * (d - 1) + (high,))  # noqa: E731
    n, up, start = 4 if d == 3 else 10, d - 1, 1.4 + GAP
    middle = ((0.5,) * (d - 1) + (start,), (1.5,) * (d - 1) + (start + 0.5,))
    msh = joined(
        MPI.COMM_WORLD,
        box(*wide(0.0, 1.0), (n,) * (d - 1) + (2,), cell),
        box(*wide(1.3, 1.4), (n,) * (d - 1) + (1,), cell),
        box(*middle, (n // 2,) * (d - 1) + (2,), cell),
    )
    at = lambda *ys: lambda x: np.any([np.isclose(x[up], y) for y in ys], axis=0)  # noqa: E731
    ends = lambda x: (x[up] > 1.25) & (np.isclose(x[0], 0.0) | np.isclose(x[0], 2.0))  # noqa: E731
    tags = tagged_facets(msh, at(start), at(1.0, 1.4), at(0.0), at(start + 0.5), ends)
    V = fem.functionspace(msh, ("Lagrange", 1, (d,)))
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.0))
    held = [fem.locate_dofs_topological(V, up, tags.find(tag)) for tag in (4, 3, 5)]
    values = (top, fem.Function(V), fem.Function(V))
    obstacle = ff.DeformableObstacle(ff.ContactSurface(msh, tags, 2, "layers"), method=method)
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=ff.Contact(ff.ContactSurface(msh, tags, 1, "block"), obstacle, ff.Coulomb(0.3)),
        bcs=[fem.dirichletbc(f, dofs) for f, dofs in zip(values, held, strict=True)],
        petsc_options_prefix=prefix,
    )

    def lower(by):
        """Prescribe how far the top of the block goes down."""
        top.x.array[d - 1 :: d] = -by

    return SimpleNamespace(problem=problem, lower=lower)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
def test_a_block_that_ends_on_what_is_below_a_foil_is_refused(cell, method):
    """All its nodes are closed there, but the foil is in the way; on the foil it may rest."""
    model = layers(cell, method, f"foil_{cell}_{method}_")
    model.lower(GAP + 0.4 + 0.02)
    with pytest.raises(
        ff.StepFailed, match=r"^Step 1 has no .* solution: \d+ nodes of 'block' went through"
    ) as error:
        model.problem.solve()
    assert "esidual" not in str(error.value)  # the equations are not the cause
    model.lower(GAP + 0.01)
    contact = model.problem.solve().contacts[0]
    assert contact.stick + contact.slip > 0
    assert contact.force[-1] > 1e-3


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
def test_a_small_body_that_goes_into_a_face_between_its_nodes_is_refused(cell, method):
    """A punch of 0.2 in a face of 1. Mortar contact meets it, but not beyond the reach."""
    d = 2 if cell == "quadrilateral" else 3
    punch = ((0.4,) * (d - 1) + (0.0,), (0.6,) * (d - 1) + (0.2,))
    block = ((0.0,) * (d - 1) + (0.5,), (2.0,) * (d - 1) + (1.5,))
    n = {"upper": (2,) * (d - 1) + (1,), "lower": (2,) * d}
    with pytest.warns(UserWarning, match="coarser") if method == METHODS[0] else nullcontext():
        model = stack(
            0.3, f"punch_{cell}_{method}_", cell=cell, top=block, base=punch, method=method, **n
        )
    corners, aside = 2 ** (d - 1), (0.0,) * (d - 1)
    for depth in (0.05, 0.5) if method == METHODS[0] else (0.5,):
        model.move(*aside, -0.3 - depth)
        with pytest.raises(
            ff.StepFailed, match=rf"solution: {corners} nodes of 'secondary' have faces"
        ):
            model.problem.solve()
    model.move(*aside, -0.29)
    assert model.problem.solve().contacts[0].open == 3 ** (d - 1)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("half", [25.0, 40.0])
def test_a_sharp_wedge_sinks_in_no_deeper_than_the_tolerance(half, method):
    """Its flanks are too steep, or too short, to be met by the faces that its tip goes into."""

    def sharpened(x):
        x[1] -= np.where(x[1] <= 1.0, x[1] * abs(x[0]) / np.tan(np.radians(half)), 0.0)
        return x

    model = stack(
        0.0, f"wedge_{half}_{method}_", cell="triangle", method=method, warp=sharpened,
        base=((-0.3, 0.0), (0.3, 1.0)), lower=(4, 4), top=((-1.0, 1.005), (1.0, 2.0)), upper=(7, 4),
    )  # fmt: skip
    faces = model.contact.pairing
    size = min(2.0 / 7.0, faces.faces.size)
    depth, step = 0.0, 0.2 * DEEP * size
    with pytest.raises(ff.StepFailed, match="2 nodes of 'secondary' have faces"):
        while depth < size:
            model.move(0.0, -0.005 - depth - step)
            force = model.problem.solve().contacts[0].force[1]
            assert force == pytest.approx(0.0, abs=1e-9)  # the wedge is not seen
            depth += step
    assert 0.0 < depth <= DEEP * size


@pytest.mark.parametrize("touch", [1e-5, 1e-4])
def test_a_node_that_only_touches_a_flank_does_not_hold_the_tip(touch, monkeypatch):
    """The tip of a stiff wedge is 0.3 of a face deep between nodes."""

    def sharpened(x):
        x[1] -= np.where(x[1] <= 1.0, x[1] * abs(x[0] - 0.03), 0.0)
        return x

    def dip(by, name):
        model = stack(
            0.3, name, cell="quadrilateral", warp=sharpened, E=(1e3, 1e6), upper=(10, 5),
            top=((-0.5, 1.01), (0.5, 1.51)), base=((-0.47, 0.0), (0.53, 1.0)), lower=(8, 4),
        )  # fmt: skip
        for y in (-0.01, -0.04 - by):
            model.move(0.0, y)
            force = model.problem.solve().contacts[0].force[1]
        return force

    with pytest.raises(ff.StepFailed, match="2 nodes of 'secondary' have faces"):
        dip(touch, "touch_")
    monkeypatch.setattr(against_faces, "SHARPER", 1e30)
    assert dip(touch, "net_") < 0.05  # a certificate for next to no force


@pytest.mark.filterwarnings("ignore:The secondary surface .* is coarser")
def test_a_blunt_wedge_of_coarse_faces_meets_node_to_face_and_is_refused_by_mortar():
    """No average over faces at the tip is closed while these are half through: that is told."""

    def sharpened(x):
        block = x[1] >= 1.0 + 1e-9
        x[1] += np.where(block, (2.005 - x[1]) * abs(x[0]) / np.tan(np.radians(40.0)), 0.0)
        return x

    for method in METHODS:
        model = stack(
            0.0, f"blunt_{method}_", cell="triangle", method=method, warp=sharpened,
            base=((-1.0, 0.0), (1.0, 1.0)), lower=(15, 4), top=((-0.4, 1.005), (0.4, 2.005)),
            upper=(6, 4), energy="small", E=(1e5, 1e3),
        )  # fmt: skip
        model.move(0.0, -0.055)
        if method == "mortar":
            with pytest.raises(ff.StepFailed, match="1 nodes of 'secondary' went through"):
                model.problem.solve()
        else:
            report = model.problem.solve()
            assert report.contacts[0].force[1] > 1.0
            assert report.contacts[0].penetration < 1e-9
