"""Initial gaps that count as closed: an offset of each node, and no node is moved."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from bodies import box, stack
from fenicsx_friction.files.checkpoint import read_checkpoint, write_checkpoint
from models import tagged_facets
from rectangles import everywhere

METHODS = pytest.mark.parametrize("method", [None, "mortar"], ids=["nodes", "mortar"])
#: A thin layer on a stiff base; their common side is curved, their faces do not match.
CURVED = {"cell": "quadrilateral", "upper": (7, 2), "lower": (4, 2), "E": (1e3, 1e6)}
CURVED |= {"top": ((0.0, 1.0), (1.0, 1.06)), "base": ((0.0, 0.0), (1.0, 1.0))}
BLOCK = {"cell": "quadrilateral", "upper": (3, 2), "lower": (5, 2)}
SOLID = {"upper": (2, 2, 1), "lower": (3, 3, 1)}


def bump(x):
    """Curve all horizontal lines."""
    return np.stack([x[0], x[1] + 0.3 * x[0] * (1.0 - x[0])])


def block(prefix, apart, method, *, d=2, **options):
    """A block at a distance above (or in) a wider base."""
    ends = np.array([[0.2] * (d - 1) + [1.0 + apart], [0.8] * (d - 1) + [1.6 + apart]])
    low, high = (0.0,) * d, (1.0,) * d
    shape = (BLOCK if d == 2 else SOLID) | {"top": ends.tolist(), "base": (low, high)}
    shape |= {"E": (1e3, 1e9)}
    return stack(0.3, prefix, method=method, **(shape | options))


def pressed(model, *displacements):
    """Return the force on the surface after some steps."""
    for displacement in displacements:
        model.move(*displacement)
        report = model.problem.solve()
        assert report.certificate.certified
    return np.array(report.contacts[0].force)


@pytest.mark.mpi
@METHODS
def test_a_curved_wall_keeps_its_thickness(method):
    """Its force is that of matching faces; with moved nodes it is that of another wall."""
    down = (0.0, -0.002)
    matching = CURVED | {"upper": (28, 2), "lower": (28, 2)}
    right = pressed(stack(0.0, "wall_right_", **matching, warp=bump), down)[1]
    model = stack(0.0, "wall_kept_", **CURVED, warp=bump, method=method, close_gaps=0.02)
    pairing = model.contact.pairing
    assert np.max(abs(pairing.offset), initial=0.0) < 0.006
    assert model.problem.comm.allreduce(np.max(abs(pairing.offset), initial=0.0), MPI.MAX) > 0.001
    assert np.all(pairing.gaps() == 0.0)
    assert pressed(model, down)[1] == pytest.approx(right, rel=0.03)
    loose = stack(0.0, "wall_loose_", **CURVED, warp=bump, method=method)
    assert abs(pressed(loose, down)[1] / right - 1.0) > 0.06


@pytest.mark.mpi
@METHODS
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("apart", [0.03, -0.03], ids=["gap", "overlap"])
def test_a_block_with_an_offset_is_a_block_without_a_gap(method, d, apart):
    """On a flat stiff base they are the same body: equal forces, stuck and slid."""
    way = [(0.0,) * (d - 1) + (-0.02,), (0.01,) * (d - 1) + (-0.02,), (0.1,) * (d - 1) + (-0.03,)]
    close = 1e-5 if method is None else 5e-4  # the block's normals, which turn, tell the mortar gap
    there = block(f"offset_there_{d}_", 0.0, method, d=d)
    here = block(f"offset_here_{d}_", apart, method, d=d, close_gaps=0.05)
    for k in range(1, 4):
        force = pressed(there, way[k - 1])
        assert pressed(here, way[k - 1]) == pytest.approx(force, abs=close * np.max(abs(force)))
    assert abs(force[0]) > 0.2 * force[-1] > 1.0


@pytest.mark.mpi
@METHODS
def test_derivatives_with_an_offset(method):
    model = stack(0.5, "offset_jacobian_", **CURVED, warp=bump, method=method, close_gaps=0.02)
    pressed(model, (0.0, -0.002))
    model.move(0.02, -0.003)
    assert ff.check_jacobian(model.problem).error < 1e-6


@pytest.mark.mpi
@METHODS
def test_larger_gaps_stay(method):
    model = block("offset_limit_", 0.03, method, close_gaps=0.02)
    assert np.all(model.contact.pairing.offset == 0.0)
    model.move(0.0, -0.02)
    assert model.problem.solve().contacts[0].open == 4


@pytest.mark.mpi
@METHODS
def test_a_node_that_starts_inside_and_opens_has_crossed_nothing(method):
    """It is still inside the base as the mesh tells; what passes through is refused as ever."""
    near = ff.SearchPolicy(reach=0.2)
    model = block("offset_open_", -0.05, method, close_gaps=0.06, search=near)
    pressed(model, (0.0, -0.01))
    model.move(0.0, 0.02)
    assert model.problem.solve().contacts[0].open == 4
    model.move(0.1, 0.02)
    assert model.problem.solve().contacts[0].open == 4
    model.move(0.1, 0.5)
    model.problem.solve()
    model.move(0.1, -2.0)
    with pytest.raises(ff.StepFailed, match="went through"):
        model.problem.solve()


@pytest.mark.mpi
@METHODS
def test_a_resumed_run_has_the_same_offsets(method, tmp_path, comm):
    """Also of a problem that is made with a displacement; the run ends where it would have."""
    path = comm.bcast(tmp_path) / "offsets.h5"
    options = CURVED | {"warp": bump, "method": method, "close_gaps": 0.02}
    way = [(0.0, -0.002), (0.01, -0.003), (0.05, -0.004)]
    whole, again = (stack(0.3, f"offset_{k}_", **options) for k in range(2))
    pressed(whole, *way[:2])
    write_checkpoint(path, whole.problem)
    force = pressed(whole, way[2])
    read_checkpoint(path, again.problem)
    assert pressed(again, way[2]) == pytest.approx(force, rel=1e-9)
    pairing = again.contact.pairing
    before = pairing.offset.copy()
    pairing.close_gaps(0.02)
    assert np.array_equal(pairing.offset, before)


@pytest.mark.mpi
@METHODS
def test_offsets_and_forces_are_those_of_one_rank(method):
    options = CURVED | {"warp": bump, "method": method, "close_gaps": 0.02}
    model = stack(0.3, "offset_ranks_", **options)
    alone = stack(0.3, "offset_alone_", **options, comm=MPI.COMM_SELF)
    offsets = [everywhere(m.problem, m.contact, m.contact.pairing.offset) for m in (model, alone)]
    assert offsets[0] == pytest.approx(offsets[1], abs=1e-12)
    forces = [pressed(m, (0.0, -0.002), (0.01, -0.003)) for m in (model, alone)]
    assert forces[0] == pytest.approx(forces[1], rel=1e-8)


def valley(x):
    """Make the base a valley with a fold at its middle."""
    return np.stack([x[0], x[1] + np.where(x[1] < 1.1, 0.4 * x[1] * abs(x[0] - 0.5), 0.0)])


@pytest.mark.mpi
def test_an_offset_does_not_slip_over_the_fold_of_two_faces():
    """A node above a fold moves and meets the other face: it slips by its way along that face."""
    shape = {"cell": "quadrilateral", "upper": (1, 1), "lower": (2, 1), "close_gaps": 0.5}
    shape |= {"top": ((0.495, 1.3), (0.9, 1.6)), "base": ((0.0, 0.0), (1.0, 1.0))}
    model = stack(0.3, "offset_fold_", **shape, warp=valley)
    pairing, u = model.contact.pairing, model.problem.u
    before = pairing.pairs.face.copy()
    assert np.all(pairing.gaps() == 0.0)
    block = u.function_space.tabulate_dof_coordinates()[:, 1] > 1.25
    u.x.array.reshape(-1, 2)[block, 0] = 0.05
    assert pairing.search()
    moved = pairing.pairs.face != before
    assert abs(pairing.slips()[moved, 0]) == pytest.approx(0.05 / np.hypot(1.0, 0.4), rel=1e-9)


@pytest.mark.quick
@pytest.mark.parametrize("method", ["mortar", "node-to-face"])
def test_a_clearance_opens_and_an_interference_closes_gradually(method):
    """Blocks between plates, lubricated: each micrometre of interference is a strain of both."""
    parts = {}
    for k, name in enumerate(("lower", "upper")):
        msh = box((0.0, float(k)), (1.0, k + 1.0), (4, 3), "quadrilateral")
        sides = tagged_facets(msh, *(lambda x, z=z: np.isclose(x[1], z) for z in (k, k + 1.0)))
        groups = {"bottom": (1, (1,)), "top": (1, (2,))}
        parts[name] = ff.NamedMesh(msh, None, sides, groups)
    model = ff.join_meshes(parts, MPI.COMM_WORLD)
    V = fem.functionspace(model.mesh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(100.0, 0.0))
    bcs = []
    for axis, facets in (
        (1, model.facets("lower/bottom")),
        (1, model.facets("upper/top")),
        (0, mesh.locate_entities_boundary(model.mesh, 1, lambda x: np.isclose(x[0], 0.0))),
    ):
        dofs = fem.locate_dofs_topological(V.sub(axis), 1, facets)
        bcs.append(fem.dirichletbc(fem.Constant(model.mesh, 0.0), dofs, V.sub(axis)))
    clearance = fem.Constant(model.mesh, 0.01)
    obstacle = ff.DeformableObstacle(model.surface("lower/top"), method=method, clearance=clearance)
    contact = ff.Contact(model.surface("upper/bottom"), obstacle, ff.Frictionless())
    problem = ff.FrictionalContactProblem(
        ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v),
        u,
        contact=contact,
        bcs=bcs,
        petsc_options_prefix=f"clearance_{method}_",
    )
    report = problem.solve()
    assert report.contacts[0].open == problem.comm.allreduce(contact.surface.num_owned)
    assert np.allclose(contact.pairing.gaps(), 0.01, atol=1e-12)
    for interference in (1e-3, 4e-3, 0.01, 2e-3):
        clearance.value = -interference
        report = problem.solve()
        assert report.certified
        assert np.allclose(contact.nodal().c[:, 0], 100.0 * interference / 2.0, rtol=1e-9)
        assert report.contacts[0].penetration < 1e-12
    clearance.value = 1e-3
    assert problem.solve().contacts[0].stick == 0
    with pytest.raises(ff.ContactInputError, match="clearance"):
        ff.DeformableObstacle(model.surface("lower/top"), clearance="tight")
