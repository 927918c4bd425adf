"""The load stepper: exact times, transactions, cuts, error control, events, messages."""

import csv
import io
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from rich.console import Console

import fenicsx_friction as ff
from fenicsx_friction.increment import advance as step
from fenicsx_friction.increment.snapshot import ProblemSnapshot
from fenicsx_friction.loading import stepper as stepper_module
from fenicsx_friction.loading.energy import EnergyAudit
from fenicsx_friction.loading.failures import StepperFailed
from fenicsx_friction.loading.stepper import LoadStepper
from models import L_PATH, block, gathered, raous, tagged_facets


@dataclass
class Swept:
    """A 2D block held at its top, pressed and swept by a moving floor."""

    problem: ff.FrictionalContactProblem
    contact: ff.Contact
    motion: ff.RigidMotion
    stored: ufl.Form

    def loads(self, t: float) -> None:
        """Press, sweep, turn the floor a little."""
        self.motion.translation.value = [0.03 * t * (2.0 - t), 0.02 * t]
        self.motion.angle.value = 0.01 * t


def swept(prefix, mu=0.4, **settings) -> Swept:
    msh = mesh.create_rectangle(
        MPI.COMM_WORLD, [[0.0, 0.0], [1.0, 0.5]], [8, 3], mesh.CellType.quadrilateral
    )
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 0.5))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    energy = ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(E=100.0, nu=0.3))
    stored = ff.bulk.stored_energy(energy, ufl.dx)
    held = fem.locate_dofs_topological(V, 1, tags.find(2))
    motion = ff.RigidMotion(msh)
    floor = ff.RigidPlane((0.0, 0.0), (0.0, 1.0), motion=motion)
    contact = ff.Contact(ff.ContactSurface(msh, tags, 1), floor, ff.Coulomb(mu))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(np.zeros(2), held, V)],
        petsc_options_prefix=prefix,
        settings=ff.StepSettings(**settings),
    )
    return Swept(problem, contact, motion, stored)


def fingerprint(problem) -> list[bytes]:
    """Return all values of a problem that may change in a step."""
    functions = [*problem.unknowns, problem.u_old]
    constants = [problem.dt]
    for k in problem.contacts:
        functions += [k.c, k.path, k.hint, k.c_stick, k.slipping, k.slip_scale, k.r]
        if (motion := k.obstacle.motion) is not None:
            constants += [motion.translation, motion._old_translation]
            constants += [motion.angle, motion._old_angle]
    values = [f.x.array.tobytes() for f in functions] + [c.value.tobytes() for c in constants]
    states = [a.tobytes() for s in problem.accepted for a in (s.gap, s.slip, s.c, s.limit)]
    slip = [k.slip_increment.tobytes() for k in problem.contacts]
    return [*values, *states, *slip, str(problem.num_steps).encode()]


def failing(problem, monkeypatch, fails):
    """Let ``solve`` do its work and fail all the same when ``fails(call)`` says so."""
    solve, calls = problem.solve, []

    def fail():
        calls.append(float(problem.dt.value))
        report = solve()
        if fails(len(calls)):
            raise ff.StepFailed("Made to fail; on purpose.", report)
        return report

    monkeypatch.setattr(problem, "solve", fail)
    return calls


def follow(points):
    """Return the way through points at times 0, 1, 2, ... as a function of time."""
    points = np.array(points)
    return lambda t: [np.interp(t, np.arange(len(points)), column) for column in points.T]


# -- times ---------------------------------------------------------------------------------------


@pytest.mark.mpi
def test_steps_end_exactly_at_stops_and_end():
    model = raous(4, 4, 0.5, "stops_")
    stops, seen = (1.0 / 3.0, 0.5, 0.7000000000000001), []
    stepper = LoadStepper(
        model.problem,
        lambda t: (seen.append(t), model.load(t, t)),
        end=1.0,
        start=0.1,
        step=0.1,
        stops=stops,
    )
    records = stepper.run()
    times = [record.time for record in records]
    assert set(stops) <= set(times)
    assert times[-1] == 1.0 == stepper.time
    assert times == sorted(times) == seen
    assert np.allclose(np.diff([0.1, *times]), [record.step for record in records])
    assert max(record.step for record in records) <= 0.1 * (1 + 1e-6)
    assert len(times) == 3 + 2 + 2 + 3  # no slivers
    assert [record.report.step for record in records] == list(range(1, len(times) + 1))
    assert all(len(set(MPI.COMM_WORLD.allgather(t))) == 1 for t in times)


def test_tenths_make_ten_steps():
    """Sums of 0.1 miss 1.0 by rounding; no eleventh step of 1e-16 must follow."""
    model = raous(4, 4, 0.5, "tenths_")
    records = LoadStepper(model.problem, lambda t: model.load(t, t), end=1.0, step=0.1).run()
    assert len(records) == 10
    assert float(model.problem.dt.value) == records[-1].step == pytest.approx(0.1)


def test_steps_grow_when_easy_and_not_beyond_the_largest():
    model = raous(4, 4, 0.5, "grow_")
    stepper = LoadStepper(
        model.problem, lambda t: model.load(t, t), end=1.0, step=0.1, largest=0.2, stops=[0.11]
    )
    steps = [record.step for record in stepper]
    assert steps[:3] == pytest.approx([0.1, 0.01, 0.15])  # a stop does not make steps small
    assert max(steps) == pytest.approx(0.2)
    model = raous(4, 4, 0.5, "no_ease_")
    stepper = LoadStepper(
        model.problem, lambda t: model.load(t, t), end=1.0, step=0.25, largest=1.0, easy=0
    )
    assert [record.step for record in stepper] == [0.25] * 4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"end": -1.0}, "path"),
        ({"largest": 0.01}, "smallest <= step"),
        ({"smallest": 0.2}, "smallest <= step"),
        ({"stops": [0.5, 2.0]}, r"\[0.5, 2.0\] must not go beyond the end, 1.0: 2.0 does"),
    ],
)
def test_impossible_paths_are_refused(arguments, message):
    model = raous(2, 2, 0.5, "refused_")
    with pytest.raises(ff.ContactInputError, match=message):
        LoadStepper(model.problem, lambda t: None, **({"end": 1.0, "step": 0.1} | arguments))


# -- transactions --------------------------------------------------------------------------------


@pytest.mark.mpi
def test_snapshot_goes_back_over_accepted_steps_bit_for_bit():
    model = swept("snapshot_")
    stepper = LoadStepper(model.problem, model.loads, end=1.0, step=0.2)
    steps = iter(stepper)
    next(steps), next(steps)
    kept, before = ProblemSnapshot(model.problem), fingerprint(model.problem)
    next(steps), next(steps)
    assert sum(a != b for a, b in zip(before, fingerprint(model.problem), strict=True)) > 10
    kept.restore()
    assert fingerprint(model.problem) == before
    # And the same way again gives the same.
    model.loads(0.6)
    assert model.problem.solve().certified


@pytest.mark.mpi
@pytest.mark.parametrize(("error", "call"), [(None, 1), (1e9, 1), (1e9, 2), (1e9, 3)])
def test_failure_leaves_the_last_accepted_step_bit_for_bit(error, call, monkeypatch):
    """Also after whole and half steps that had been committed on trial."""
    model = swept("rollback_")
    model.loads(0.2)
    model.problem.solve()
    before, settings = fingerprint(model.problem), model.problem.settings
    per_attempt = 1 if error is None else call
    calls = failing(model.problem, monkeypatch, lambda n: n % per_attempt == 0)
    stepper = LoadStepper(
        model.problem, model.loads, start=0.2, end=1.0, step=0.4, smallest=0.1, error=error
    )
    with pytest.raises(StepperFailed, match=r"Made to fail") as failure:
        stepper.run()
    assert fingerprint(model.problem) == before
    assert model.problem.settings is settings
    assert model.problem.monitor is None
    assert stepper.time == failure.value.time == 0.2
    assert [f.step for f in failure.value.failed] == pytest.approx([0.4, 0.2, 0.1])
    assert len(calls) == 3 * per_attempt


@pytest.mark.mpi
def test_other_exceptions_leave_the_last_accepted_step_too():
    model = swept("exception_")

    def loads(t):
        model.loads(t)
        if t > 0.5 and model.problem.comm.rank == 0:  # on one rank only
            raise ZeroDivisionError("user's mistake")

    stepper, states = LoadStepper(model.problem, loads, end=1.0, step=0.25), []
    with pytest.raises((ZeroDivisionError, RuntimeError), match="user's mistake"):
        for _ in stepper:
            states.append(fingerprint(model.problem))
    assert len(states) == 2
    assert fingerprint(model.problem) == states[-1]


@pytest.mark.mpi
def test_cut_steps_equal_fixed_steps_of_the_same_sizes(monkeypatch):
    model = swept("cut_")
    failing(model.problem, monkeypatch, lambda n: n in (2, 3, 6))
    records = LoadStepper(model.problem, model.loads, end=1.0, step=0.25).run()
    assert [len(record.failed) for record in records][:2] == [0, 2]
    assert sum(len(record.failed) for record in records) == 3
    assert records[1].failed[0].reason == "Made to fail"
    assert records[1].step == pytest.approx(0.0625)
    fixed = swept("fixed_")
    for record in records:
        fixed.loads(record.time)
        fixed.problem.solve()
    (_, c, u), (_, c_fixed, u_fixed) = gathered(model.problem), gathered(fixed.problem)
    assert c == pytest.approx(c_fixed, abs=1e-9 * np.max(abs(c_fixed)))
    assert u == pytest.approx(u_fixed, abs=1e-9 * np.max(abs(u_fixed)))
    assert model.problem.num_steps == fixed.problem.num_steps == len(records)


def test_uncertified_reports_are_failures_whatever_the_settings(monkeypatch):
    model = raous(4, 4, 1.0, "settings_", raise_on_uncertified=False, tolerance=1e-300)
    stepper = LoadStepper(
        model.problem, lambda t: model.load(t, t), end=1.0, step=0.1, smallest=0.05
    )
    with pytest.raises(StepperFailed, match="no certified solution"):
        stepper.run()
    assert model.problem.num_steps == 0
    assert model.problem.settings.raise_on_uncertified is False


def test_functions_of_the_user_are_history_too(monkeypatch):
    model = swept("history_")
    steps = fem.Function(fem.functionspace(model.problem.u.function_space.mesh, ("DG", 0)))

    def count():
        steps.x.array[:] += 1.0

    failing(model.problem, monkeypatch, lambda n: n == 5)  # the second half of the second step
    stepper = LoadStepper(
        model.problem, model.loads, end=1.0, step=0.5, error=1e9, history=[steps], update=count
    )
    for record in stepper:
        assert np.all(steps.x.array == record.report.step)


@pytest.mark.mpi
def test_a_loop_may_be_left_and_taken_up_again():
    model, whole = swept("left_"), swept("whole_")
    times = []
    stepper = LoadStepper(model.problem, model.loads, end=1.0, step=0.5, error=1e9)
    for record in stepper:
        times.append(record.time)
        assert float(model.motion.angle.value) == 0.01 * record.time  # in the middle of a pair
        break
    times += [record.time for record in stepper]
    assert times == [
        r.time for r in LoadStepper(whole.problem, whole.loads, end=1.0, step=0.5, error=1e9)
    ]
    assert np.array_equal(model.problem.u.x.array, whole.problem.u.x.array)


# -- hard problems -------------------------------------------------------------------------------


def test_hard_sweep_fails_at_once_and_passes_in_cut_steps():
    """A finite-strain block squeezed by 3/4 of its height while swept by more than it."""
    model = block("hexahedron", 2.0, "hard_", energy="finite", fallbacks=0)
    way = np.array([0.6, 0.0, -0.38])
    stepper = LoadStepper(
        model.problem, lambda t: model.move(*(t * way)), end=1.0, step=1.0, smallest=1e-2
    )
    records = stepper.run()
    assert len(records) > 1
    assert records[0].failed
    assert all(record.report.certified for record in records)
    held = model.problem.constrained_dofs
    values = np.zeros_like(model.problem.u.x.array)
    model.problem.bcs[0].set(values)
    assert model.problem.u.x.array[held] == pytest.approx(values[held], abs=1e-12)


@pytest.mark.mpi
def test_cycling_nodes_are_named_with_their_states(monkeypatch):
    """Full Newton steps alone cycle at mu = 20."""
    monkeypatch.setattr(step, "FALLBACKS", ())
    model = raous(16, 16, 20.0, "cycling_")
    stepper = LoadStepper(
        model.problem, lambda t: model.load(3 * t, t / 2), end=1.0, step=1.0, smallest=1.0
    )
    with pytest.raises(StepperFailed, match=r"Cycling nodes: \d+, states in the last") as failure:
        stepper.run()
    lines = str(failure.value).splitlines()
    named = [line for line in lines if "changes" in line]
    assert len(named) == 5
    assert all("of 'contact' at (" in line and " -> " in line for line in named)
    assert len(set(MPI.COMM_WORLD.allgather(str(failure.value)))) == 1


def test_failure_is_explained():
    model = raous(8, 8, 1.0, "explained_")
    stepper = LoadStepper(
        model.problem, lambda t: model.load(3 * t, 1 - 2 * t), end=1.0, step=0.5, smallest=0.2
    )
    with pytest.raises(StepperFailed) as failure:
        stepper.run()
    message = str(failure.value)
    assert "No step from time 0.5 was accepted, down to 0.2" in message
    assert "step 0.5: Step 2 has no certified solution" in message
    assert "Dominant residual: " in message
    assert "of 'contact' at (" in message
    assert "Smaller steps did not help" in message
    assert "Try a smaller load step" not in message
    assert isinstance(failure.value.report, ff.StepReport)
    # It is no dead end: other loads go on from the last accepted step.
    stepper = LoadStepper(
        model.problem, lambda t: model.load(1.5 - t, t), start=0.5, end=1.0, step=0.25
    )
    assert [record.report.step for record in stepper] == [2, 3]


# -- error control -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def turning():
    """Step counts and final tractions of a partially slipping 3D history by tolerance."""
    results = {}

    def way(t):
        """Turn in a circle under a falling pressure."""
        return 0.004 * np.sin(t), 0.004 * (1.0 - np.cos(t)), -0.01 + 0.002 * t

    for error in (0.1, 1e-2, 1e-3, None):
        model = block("hexahedron", 0.4, f"turning_{error}_")
        model.move(*way(0.0))
        model.problem.solve()
        size = 1.5 if error else 0.03
        stepper = LoadStepper(
            model.problem, lambda t, m=model: m.move(*way(t)), end=3.0, step=size, error=error
        )
        records = stepper.run()
        results[error] = records, gathered(model.problem)[1]
    return results


def test_tighter_tolerances_take_more_steps_and_come_nearer(turning):
    _, reference = turning[None]
    counts, errors = [], []
    for error in (0.1, 1e-2, 1e-3):
        records, c = turning[error]
        assert all(0.0 <= record.error <= error for record in records)
        assert records[-1].time == 3.0
        counts.append(len(records))
        errors.append(np.max(np.linalg.norm(c - reference, axis=1)) / np.max(abs(reference)))
    assert counts == sorted(set(counts))
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.01 < 0.05 < errors[0]


def test_error_control_gives_up_when_the_tolerance_cannot_be_met():
    model = block("hexahedron", 0.4, "strict_")
    way = follow([(0, 0, -0.01), (0.02, 0.0, -0.01), (0.02, 0.02, -0.01)])
    model.move(*way(0.0))
    model.problem.solve()
    before = fingerprint(model.problem)
    stepper = LoadStepper(
        model.problem,
        lambda t: model.move(*way(t)),
        end=2.0,
        step=0.5,
        smallest=0.2,
        error=1e-9,
    )
    with pytest.raises(StepperFailed, match="two half steps differ by") as failure:
        stepper.run()
    assert "allow a larger error" in str(failure.value)
    assert fingerprint(model.problem) == before


@pytest.mark.mpi
def test_ranks_take_the_same_steps_as_one():
    times = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        model = raous(16, 16, 1.0, "ranks_", comm=comm)

        def loads(t, model=model):
            model.load(2.0 * min(t, 1.0 - t), min(1.0, 2.0 * t))

        stepper = LoadStepper(model.problem, loads, end=1.0, step=0.2, error=1e-2)
        times.append([record.time for record in stepper])
    assert times[0] == pytest.approx(times[1], rel=1e-6)
    assert len(set(MPI.COMM_WORLD.allgather(tuple(times[0])))) == 1


# -- audit, events, display ----------------------------------------------------------------------


@pytest.mark.mpi
def test_audit_sees_each_half_step_once_and_no_trial():
    model, plain = swept("audit_"), swept("plain_")
    stepper = LoadStepper(
        model.problem,
        model.loads,
        end=1.0,
        step=0.5,
        error=0.2,
        audit=EnergyAudit(model.problem, model.stored),
    )
    records = stepper.run()
    audit = EnergyAudit(plain.problem, plain.stored)
    for record in records:
        plain.loads(record.time)
        plain.problem.solve()
        expected = audit.update()
        scale = abs(expected.external_work) + 1e-3 * abs(expected.stored)
        for name in ("external_work", "stored", "dissipation", "defect"):
            value = getattr(record.energy, name)
            assert value == pytest.approx(getattr(expected, name), abs=1e-6 * scale)
    assert sum(record.energy.dissipation for record in records) > 0.0


#: Up, press, slide, a little back, up: times 0 to 4.
SEQUENCE = [(0, 0, 0.01), (0, 0, -0.01), (0.05, 0, -0.01), (0.0495, 0, -0.01), (0.05, 0, 0.01)]


@pytest.mark.mpi
def test_event_log_of_stick_slip_stick_and_lift(tmp_path):
    model = block("hexahedron", 0.6, "events_", n=(2, 1, 1))
    path = MPI.COMM_WORLD.bcast(tmp_path) / "events.csv"
    way = follow(SEQUENCE)
    stepper = LoadStepper(
        model.problem, lambda t: model.move(*way(t)), end=4.0, step=1.0, events=path
    )
    handed_out = []
    for record in stepper:
        handed_out += record.events
        MPI.COMM_WORLD.barrier()
        with path.open(newline="") as file:  # complete after each step
            rows = list(csv.reader(file))
        assert rows[0] == ["step", "node", "x", "from", "to"]
        assert len(rows) == 1 + len(handed_out)
        MPI.COMM_WORLD.barrier()
    written = [(int(row[0]), int(row[1]), row[3], row[4]) for row in rows[1:]]
    assert written == [(e.step, e.node, e.before, e.after) for e in handed_out]
    assert written == sorted(written, key=lambda row: row[:2])
    states = ["open", "stick", "slip", "stick", "open"]
    for node in range(6):
        of_node = [row for row in written if row[1] == node]
        assert [row[0] for row in of_node] == [1, 2, 3, 4]
        assert [row[2] for row in of_node] == states[:-1]
        assert [row[3] for row in of_node] == states[1:]
    corners = {tuple(float(x) for x in row[2].split()) for row in rows[1:]}
    assert {tuple(np.round(x, 9)) for x in corners} == {
        (x, y, 0.0) for x in (0.0, 0.6, 1.2) for y in (0.0, 0.9)
    }


def test_a_later_stepper_continues_the_event_log(tmp_path):
    model = block("hexahedron", 0.6, "later_", n=(2, 1, 1))
    path, way = tmp_path / "events.csv", follow(SEQUENCE)
    path.write_text("of an earlier run\n")
    for start in (0.0, 2.0):
        stepper = LoadStepper(
            model.problem,
            lambda t: model.move(*way(t)),
            start=start,
            end=start + 2.0,
            step=1.0,
            events=path,
        )
        stepper.run()
    lines = path.read_text().splitlines()
    assert lines[0] == "step,node,x,from,to"
    assert [line.split(",")[0] for line in lines[1:]] == [
        str(k) for k in (1, 2, 3, 4) for _ in "6nodes"
    ]


@pytest.mark.parametrize("shown", [True, False])
def test_progress_is_shown_on_terminals_only_and_only_when_wanted(shown, monkeypatch):
    model, screen = raous(4, 4, 0.5, "display_"), io.StringIO()
    monkeypatch.setattr(
        stepper_module, "Console", lambda: Console(file=screen, force_terminal=True, width=120)
    )
    stepper = LoadStepper(
        model.problem, lambda t: model.load(t, t), end=1.0, step=0.5, progress=shown
    )
    stepper.run()
    assert ("step 2 to 1: 0.5 in" in screen.getvalue()) == shown
    assert ("100%" in screen.getvalue()) == shown


def test_a_long_path_returns_to_where_nothing_touches():
    """The L-shaped sweep of the other tests, with interpolated steps."""
    model, way = block("hexahedron", 0.3, "l_path_"), follow([(0, 0, 0), *L_PATH])
    stepper = LoadStepper(
        model.problem, lambda t: model.move(*way(t)), end=float(len(L_PATH)), step=0.5
    )
    records = stepper.run()
    assert len(records) == 2 * len(L_PATH)
    assert records[-1].report.contacts[0].stick == records[-1].report.contacts[0].slip == 0
