"""Results in one call: what pyvista and csv read back is right, also after an interrupt."""

import csv
from pathlib import Path

from mpi4py import MPI

import imageio.v3
import numpy as np
import pytest
import pyvista
import ufl
from dolfinx import fem

import fenicsx_friction as ff
from fenicsx_friction.files import series
from fenicsx_friction.files.step_table import StepTable
from models import SIDE, TOP, block, by_place, raous
from sweeps import follow, swept
from test_elements import ring

pytestmark = pytest.mark.mpi
KEPT = []


@pytest.fixture
def folder(tmp_path):
    """A folder that all ranks share."""
    return Path(MPI.COMM_WORLD.bcast(str(tmp_path)))


def on_first(work):
    """Run checks on rank 0 while the others wait."""
    if MPI.COMM_WORLD.rank == 0:
        work()
    MPI.COMM_WORLD.barrier()


def integral(grid, name):
    """Integrate a nodal field over a grid."""
    return grid.integrate_data()[name][0]


@pytest.mark.quick
def test_forces_and_energies_balance_in_what_is_read_back(folder):
    """Raous' rectangle in two steps: table, pressures and displacements agree with the loads."""
    model = raous(12, 6, 0.5, "results_")
    u, load = model.problem.u, model.loads
    strain = ufl.sym(ufl.grad(u))
    fields = {"volume": ufl.tr(strain), "strain": strain, "before": model.problem.u_old}
    results = ff.Results(model.problem, folder / "deep" / "er", fields=fields)
    stepper = ff.LoadStepper(
        model.problem,
        lambda t: model.load(t, 1.0),
        end=1.0,
        step=0.5,
        results=results,
        audit=ff.EnergyAudit(model.problem, model.stored, load),
        progress=False,
    )
    records = stepper.run()
    cells = u.function_space.mesh.topology.index_map(2).size_global
    volume = fem.assemble_scalar(fem.form(ufl.tr(strain) * ufl.dx))
    volume = model.problem.comm.allreduce(volume)
    largest = model.problem.comm.allreduce(np.max(abs(u.x.array)), MPI.MAX)

    def check():
        table = ff.plot.table(results.folder)
        assert table["step"].tolist() == [1, 2] and table["time"].tolist() == [0.5, 1.0]
        assert set(table["contact"]) == {"contact"}
        assert table["force_y"] == pytest.approx(TOP * SIDE, rel=1e-10)
        for k, record in enumerate(records):
            totals = record.report.contacts[0]
            states = [int(table[name][k]) for name in ("open", "stick", "slip")]
            assert states == [totals.open, totals.stick, totals.slip]
            assert table["moment_z"][k] == totals.moment[0]
            assert table["certificate"][k] == record.report.certificate.relative < 1e-8
            assert table["frictional_work"][k] == pytest.approx(table["dissipation"][k])
            sums = table["stored"][k] + table["dissipation"][k] + table["defect"][k]
            assert table["external_work"][k] == pytest.approx(sums)
        bulk = ff.plot.fields(results.folder)
        line = ff.plot.fields(results.folder, "contact")
        assert bulk.n_cells == cells and line.n_cells == 12
        assert integral(line, "pressure") == pytest.approx(table["force_y"][1], rel=1e-10)
        assert integral(line, "traction")[0] == pytest.approx(table["force_x"][1], rel=1e-10)
        assert integral(bulk, "volume") == pytest.approx(volume, rel=1e-6)
        assert bulk["strain"].shape == (cells, 9)
        assert np.max(abs(bulk["displacement"])) == pytest.approx(largest, rel=1e-12)
        assert np.array_equal(bulk["before"], bulk["displacement"])
        _, once = np.unique(line["node"], return_index=True)
        assert np.count_nonzero(line["state"][once] == ff.SLIP) == table["slip"][1] > 0

    on_first(check)


@pytest.mark.parametrize(("cell", "kind"), [("triangle", 69), ("quadrilateral", 70)])
def test_quadratic_displacements_on_curved_cells(folder, cell, kind):
    """The nodes of the bent edges are there; the surface is warped as the body."""
    problem = ring(cell, 4, 2, "results_ring_")
    KEPT.append(problem)
    report = problem.solve()
    results = ff.Results(problem, folder)
    results.write(1.0, report)
    V = problem.u.function_space
    area = fem.assemble_scalar(fem.form(fem.Constant(V.mesh, 1.0) * ufl.dx))
    area, u = problem.comm.allreduce(area), by_place(problem.u)

    def check():
        bulk = ff.plot.fields(folder)
        assert set(bulk.celltypes) == {kind}  # Lagrange cells of VTK
        assert len(np.unique(np.round(bulk.points, 9), axis=0)) == len(u)
        found = bulk["displacement"][:, :2]
        assert np.max(abs(found), axis=0) == pytest.approx(np.max(abs(u), axis=0), rel=1e-12)
        assert integral(bulk, "displacement").shape == (3,)
        fine = bulk.extract_surface(nonlinear_subdivision=4, algorithm="dataset_surface")
        assert fine.area == pytest.approx(area, rel=2e-3)
        surface = ff.plot.fields(folder, problem.contacts[0].surface.name)
        for x, moved in zip(surface.points, surface["displacement"], strict=True):
            nearest = np.argmin(np.linalg.norm(bulk.points - x, axis=1))
            assert np.allclose(bulk.points[nearest], x, atol=1e-12)
            assert np.array_equal(bulk["displacement"][nearest], moved)

    on_first(check)


def script(prefix, folder, count=None):
    """Sweep with adaptive steps, results and a checkpoint."""
    model = swept(prefix)
    KEPT.append(model)
    stepper = ff.LoadStepper(
        model.problem,
        model.loads,
        end=1.0,
        step=0.1,
        easy=6,
        largest=0.3,
        results=ff.Results(model.problem, folder, fields={"uu": ufl.inner(*[model.problem.u] * 2)}),
        checkpoint=folder / "run.h5",
        progress=False,
    )
    for k, _ in enumerate(stepper, 1):
        if k == count:
            break
    MPI.COMM_WORLD.barrier()


def content(folder):
    """Return the table, and times and displacements of the bulk; read all files, count them."""
    found = {}
    for name in ("bulk", "contact"):
        reader = pyvista.PVDReader(str(folder / f"{name}.pvd"))
        times = reader.time_values
        assert (folder / f"{name}.pvd").read_text().count("<DataSet") == len(times)
        grids = [ff.plot.fields(folder, name, k) for k in range(len(times))]
        found[name] = times, [grid["displacement"] for grid in grids]
    with (folder / "contacts.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    return rows, *found["bulk"]


def assert_equal_content(folder, whole):
    (rows, times, grids), (rows_whole, times_whole, grids_whole) = map(content, (folder, whole))
    assert times == times_whole and len(rows) == 1 + len(times)
    for a, b in zip(rows, rows_whole, strict=True):
        assert a[:6] == b[:6]
    for a, b in zip(grids, grids_whole, strict=True):
        assert a == pytest.approx(b, abs=1e-9 * np.max(abs(b)))
    if MPI.COMM_WORLD.size == 1:
        assert rows == rows_whole


#: What is called for the n-th time at an interrupt in the third step; VTKFile twice a step.
INTERRUPTS = {
    "bulk": (series, "VTKFile", 5),
    "contact": (series, "VTKFile", 6),
    "table": (StepTable, "write", 3),
}


@pytest.mark.parametrize("where", ["none", *INTERRUPTS])
def test_an_interrupt_leaves_whole_files_that_are_continued_without_doubles(
    folder, where, monkeypatch
):
    script(f"results_{where}_whole_", folder / "whole")
    if where == "none":
        script("results_none_cut_", folder / "cut", 2)
    else:
        place, name, number = INTERRUPTS[where]
        calls, work = [], getattr(place, name)

        def cut(*arguments):
            calls.append(arguments)
            if len(calls) == number:
                raise KeyboardInterrupt
            return work(*arguments)

        with monkeypatch.context() as changed:
            changed.setattr(place, name, cut)
            with pytest.raises(KeyboardInterrupt):
                script(f"results_{where}_cut_", folder / "cut")

    def check_what_is_left():
        rows, times, grids = content(folder / "cut")
        assert len(rows) == 3 and len(times) == len(grids) == (
            2 if where in ("none", "bulk") else 3
        )
        with (folder / "cut" / "contacts.csv").open("a") as file:
            file.write("3,0.4,cont")  # of a row that a kill has cut off

    on_first(check_what_is_left)
    script(f"results_{where}_rest_", folder / "cut")
    on_first(lambda: assert_equal_content(folder / "cut", folder / "whole"))
    script(f"results_{where}_end_", folder / "cut")  # at its end: nothing happens
    on_first(lambda: assert_equal_content(folder / "cut", folder / "whole"))


def test_a_new_run_begins_anew(folder):
    model = raous(4, 4, 0.5, "results_anew_")
    for _ in range(2):
        results = ff.Results(model.problem, folder)
        model.problem.num_steps = 0
        for time in (0, np.float64(1.0)):  # numbers of any kind
            model.load(0.5 * time, 1.0)
            results.write(time, model.problem.solve())
    on_first(lambda: check_two_steps(folder))


def check_two_steps(folder):
    rows, times, _ = content(folder)
    assert [row[0] for row in rows] == ["step", "1", "2"] and times == [0.0, 1.0]


def test_wrong_input_is_refused_before_the_solve(folder):
    model, other = raous(4, 4, 0.5, "results_in_"), raous(4, 4, 0.5, "results_other_")
    u = model.problem.u
    for fields, words in (
        ({"displacement": u}, "another name"),
        ({"u": 3.0}, r"fields\['u'\]"),
        ({1: u}, "a name in fields"),
        ([u], "a dictionary"),
        ({"a": other.problem.u}, r"fields\['a'\]"),
        ({"a": ufl.grad(ufl.grad(u))}, "a scalar, vector or matrix"),
    ):
        with pytest.raises(ff.ContactInputError, match=words):
            ff.Results(model.problem, folder, fields=fields)
    if MPI.COMM_WORLD.rank == 0:
        (folder / "file").write_text("")
    MPI.COMM_WORLD.barrier()
    with pytest.raises(ff.ContactInputError, match="file' cannot be made"):
        ff.Results(model.problem, folder / "file")
    results = ff.Results(other.problem, folder)
    for bad, words in ((results, "another problem"), ("folder", "results = 'folder'")):
        with pytest.raises(ff.ContactInputError, match=words):
            ff.LoadStepper(
                model.problem, lambda t: model.load(t, t), end=1.0, step=1.0, results=bad
            )
    with pytest.raises(ff.ContactInputError, match="folder: there is no"):
        ff.plot.table(folder)


@pytest.mark.quick
def test_pictures(folder):
    """Their numbers are those of the files."""
    model = block("hexahedron", 0.4, "results_pictures_", n=(4, 3, 2))
    way = follow([(0, 0, 0), (0, 0, -0.02), (0.02, 0.01, -0.02)])
    results = ff.Results(model.problem, folder)
    ff.LoadStepper(
        model.problem,
        lambda t: model.move(*way(t)),
        end=2.0,
        step=0.5,
        results=results,
        progress=False,
    ).run()
    flat = raous(6, 4, 0.5, "results_line_")
    two = ff.Results(flat.problem, folder / "two")
    two.write(1.0, flat.problem.solve())

    def check():
        ff.plot.movie(folder, folder / "way.gif")
        frames = imageio.v3.imread(folder / "way.gif")
        assert len(frames) == len(ff.plot.table(folder)["time"])
        assert np.count_nonzero(frames[0] != frames[-1]) > 100
        table = ff.plot.table(folder)
        axes = ff.plot.curve(folder, "force_x", lambda t: way(t)[0], file=folder / "c.png")
        x, y = axes.lines[0].get_data()
        assert x[-1] == pytest.approx(0.02) and np.array_equal(y, table["force_x"])
        with pytest.raises(ff.ContactInputError, match="no column 'force'"):
            ff.plot.curve(folder, "force")
        axes = ff.plot.contact_line(folder / "two", file=folder / "l.png")
        assert axes.lines[0].get_xdata() == pytest.approx(np.linspace(0.0, SIDE, 7))
        assert sum(len(part.get_offsets()) for part in axes.collections) == 7
        ff.plot.contact_map(folder, file=folder / "m.png").close()
        plotter = ff.plot.deformed(folder, factor=10.0, file=folder / "d.png")
        assert plotter.bounds[5] == pytest.approx(0.5 - 0.2)
        plotter.close()
        for name in "clmd":
            picture = pyvista.read(folder / f"{name}.png")
            colours = picture.point_data.active_scalars
            assert len(np.unique(colours, axis=0)) > 50

    on_first(check)
