"""Plastic bodies in contact: closed form of a bar; what rejected steps leave of the history."""

import runpy
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from models import tagged_facets
from sweeps import failing

DEMO = runpy.run_path(str(Path(__file__).parents[1] / "demos" / "demo_plasticity.py"))
E, Y, H = DEMO["E"], DEMO["Y"], DEMO["H"]
YIELD = Y / E  # strain
RADIUS = 0.6


class Bar:
    """A bar on the axis of revolution, pressed by a plate or by a ball."""

    def __init__(self, prefix, obstacle=None, mu=0.0, n=3):
        msh = mesh.create_rectangle(
            MPI.COMM_WORLD, [(0, 0), (RADIUS, 1)], [n, n], mesh.CellType.quadrilateral
        )
        tags = tagged_facets(msh, lambda x: np.isclose(x[1], 1.0))
        V, P = fem.functionspace(msh, ("Lagrange", 1, (2,))), fem.functionspace(msh, ("DG", 0))
        u, p = fem.Function(V), fem.Function(P)
        self.metal, self.motion = DEMO["Metal"](u, p), ff.RigidMotion(msh)
        if obstacle is None:
            obstacle = ff.RigidPlane((0, 1), (0, -1), motion=self.motion)
        else:
            obstacle = ff.RigidSphere((0.0, 2.0), 1.0, motion=self.motion)
        bcs = []
        for i in range(2):
            facets = mesh.locate_entities_boundary(msh, 1, lambda x, i=i: np.isclose(x[i], 0.0))
            dofs = fem.locate_dofs_topological(V.sub(i), 1, facets)
            bcs.append(fem.dirichletbc(fem.Constant(msh, 0.0), dofs, V.sub(i)))
        self.contact = ff.Contact(
            ff.ContactSurface(msh, tags, 1, axisymmetric=True),
            obstacle,
            ff.Coulomb(mu) if mu else ff.Frictionless(),
        )
        self.problem = ff.FrictionalContactProblem(
            [
                ufl.derivative(self.metal.energy, w, ufl.TestFunction(w.function_space))
                for w in (u, p)
            ],
            [u, p],
            contact=self.contact,
            bcs=bcs,
            petsc_options_prefix=prefix,
        )

    def stepper(self, loads, **given):
        def move(t):
            self.motion.translation.value[1] = -YIELD * loads(t)

        history, update = self.metal.history, self.metal.update
        return ff.LoadStepper(
            self.problem, move, history=history, update=update, progress=False, **given
        )


@pytest.mark.mpi
def test_a_bar_yields_hardens_and_unloads_in_closed_form():
    """Two plates, any steps: radial return is exact on a straight path."""
    bar, flowed, stresses = Bar("bar_"), 0.0, []
    loads = lambda t: t if t < 4.0 else 8.0 - t  # noqa: E731
    for record in bar.stepper(loads, end=4.6, step=0.9, stops=[4.0]):
        trial = E * (YIELD * loads(record.time) - flowed)
        flowed += max(trial - Y - H * flowed, 0.0) / (E + H)
        stress = E * (YIELD * loads(record.time) - flowed)
        assert bar.contact.nodal().c[:, 0] == pytest.approx(stress, rel=1e-9)
        assert bar.metal.history[1].x.array == pytest.approx(flowed, rel=1e-9, abs=1e-15)
        # Each step starts on the yield surface, within rounding: other ranks may take more.
        assert record.report.iterations < (8 if bar.problem.comm.size == 1 else 40)
        stresses.append(stress)
    assert flowed == pytest.approx(3.0 * YIELD * E / (E + H), rel=1e-12)
    assert 0.0 < stresses[-1] < 0.7 * Y < Y < max(stresses)


# -- rejected steps ----------------------------------------------------------------------------


def ball(prefix):
    return Bar(prefix, obstacle="ball", mu=0.3, n=4)


def press(t):
    return 20.0 * t


@pytest.mark.parametrize(
    ("error", "fails"),
    [pytest.param(None, {2, 3, 6}, marks=pytest.mark.mpi), (1e9, {2, 6, 11})],
)
def test_cut_steps_leave_the_history_of_the_same_steps_without_cuts(error, fails, monkeypatch):
    cut, fixed = ball("cut_"), ball("fixed_")
    failing(cut.problem, monkeypatch, lambda n: n in fails)
    records = cut.stepper(press, end=1.0, step=0.25, error=error).run()
    assert sum(len(record.failed) for record in records) == len(fails)
    for record in records:
        fixed.motion.translation.value[1] = -YIELD * press(record.time)
        fixed.problem.solve()
        fixed.metal.update()
    for one, other in zip(cut.metal.history, fixed.metal.history, strict=True):
        scale = np.max(abs(other.x.array), initial=1e-12)
        assert one.x.array == pytest.approx(other.x.array, abs=1e-9 * scale)
    flowed = fixed.problem.comm.allreduce(np.max(fixed.metal.history[1].x.array), MPI.MAX)
    assert flowed > 5.0 * YIELD


@pytest.mark.mpi
def test_a_failed_path_leaves_the_history_bit_for_bit(monkeypatch):
    """The whole step is solved, and changes the history; its first half fails."""
    bar = ball("failed_")
    bar.stepper(press, end=0.25, step=0.25).run()
    before = [f.x.array.tobytes() for f in bar.metal.history]
    flowed = np.max(bar.metal.history[1].x.array)
    assert bar.problem.comm.allreduce(flowed, MPI.MAX) > YIELD
    failing(bar.problem, monkeypatch, lambda n: n % 2 == 0)
    stepper = bar.stepper(press, start=0.25, end=1.0, step=0.25, smallest=0.125, error=1e9)
    with pytest.raises(ff.StepperFailed, match="Made to fail"):
        stepper.run()
    assert [f.x.array.tobytes() for f in bar.metal.history] == before


@pytest.mark.mpi
def test_a_checkpoint_holds_quadrature_functions(tmp_path):
    comm = MPI.COMM_WORLD
    file = Path(comm.bcast(str(tmp_path))) / "run.h5"
    whole, first, second = (ball(f"{name}_") for name in ("whole", "first", "second"))
    whole.stepper(press, end=1.0, step=0.25).run()
    first.stepper(press, end=0.5, step=0.25, checkpoint=file).run()
    again = second.stepper(press, end=1.0, step=0.25, checkpoint=file)
    for one, other in zip(second.metal.history, first.metal.history, strict=True):
        assert np.array_equal(one.x.array, other.x.array)
    assert [record.time for record in again] == [0.75, 1.0]
    for one, other in zip(second.metal.history, whole.metal.history, strict=True):
        assert one.x.array == pytest.approx(other.x.array, abs=1e-9 * np.max(abs(other.x.array)))


@pytest.mark.mpi
def test_results_hold_means_over_the_quadrature_points(tmp_path):
    comm = MPI.COMM_WORLD
    folder = Path(comm.bcast(str(tmp_path)))
    bar = ball("means_")
    plastic, alpha = bar.metal.history
    twice = 2.0 * alpha + ufl.tr(plastic)  # plastic flow keeps the volume
    results = ff.Results(bar.problem, folder, fields={"alpha": alpha, "twice": twice})
    bar.stepper(press, end=0.25, step=0.25, results=results).run()
    own = alpha.x.array[alpha.function_space.dofmap.list].mean(axis=1)
    cells = alpha.function_space.mesh.topology.index_map(2).size_local
    total = comm.allreduce(np.sum(own[:cells]))
    if comm.rank == 0:
        grid = ff.plot.fields(folder)
        assert np.sum(grid["alpha"]) == pytest.approx(total, rel=1e-12)
        assert grid["twice"] == pytest.approx(2.0 * grid["alpha"], abs=1e-12 * total)
    assert total > 0.0
