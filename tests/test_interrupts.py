"""A solve that is left by an interrupt or any exception is back at the last accepted state."""

import hashlib
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from dolfinx import fem

import fenicsx_friction as ff
from bodies import stack
from fenicsx_friction.equations.contact_terms import ContactTerms
from fenicsx_friction.increment import correctors
from models import block

PACKAGE = str(Path(ff.__file__).parent)
#: Interrupts at random times of one run of the test.
INTERRUPTS = 12


def fingerprint(problem) -> str:
    """Hash all that a step changes."""
    digest = hashlib.sha256()
    functions = [*problem.state, problem.u_old]
    for k in problem.contacts:
        functions += [f for f in vars(k).values() if isinstance(f, fem.Function)]
        digest.update(k.slip_increment.tobytes())
        if k.pairing.deformable:
            pairs = k.pairing.pairs
            digest.update(pairs.face.tobytes())
    for f in functions:
        if f.name not in FROZEN:
            digest.update(f.x.array.tobytes())
    digest.update(repr((problem.num_steps, len(problem.accepted))).encode())
    return digest.hexdigest()


#: Functions that hold nothing between the substeps of one step.
FROZEN = ("stick_traction", "slipping", "slip_scale", "pairs")


def reached(model, move):
    """Return the force after a step to a position, from the state the model is in."""
    model.move(*move)
    report = model.problem.solve()
    assert report.certified
    return np.array(report.contacts[0].force)


def again_soon(unraisable) -> None:
    """Interrupt once more: Python swallows what is raised in finalisers and by its collector."""
    assert issubclass(unraisable.exc_type, KeyboardInterrupt)
    signal.setitimer(signal.ITIMER_REAL, 1e-4)


@pytest.mark.parametrize("kind", ["rigid", "condensed", "deformable"])
def test_interrupts_at_random_times_change_nothing(kind, monkeypatch):
    def make(prefix):
        if kind == "deformable":
            return stack(0.4, prefix)
        energy = {"rigid": "finite", "condensed": "small"}[kind]
        return block("hexahedron", 0.3, prefix, n=(6, 5, 3), energy=energy)

    first, second = (0.0, 0.0, -0.01), (0.01, 0.004, -0.01)
    reference = make(f"undisturbed_{kind}_")
    reached(reference, first)
    expected = reached(reference, second)
    reference.problem.solve()  # compiled by now
    model = make(f"interrupted_{kind}_")
    reached(model, first)
    begin = time.perf_counter()
    third = make(f"timed_{kind}_")
    reached(third, first)
    before = fingerprint(model.problem)
    begin = time.perf_counter()
    reached(third, second)
    duration = time.perf_counter() - begin

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(sys, "unraisablehook", again_soon)
    usual, rng, hits = signal.signal(signal.SIGALRM, interrupt), np.random.default_rng(5), 0
    try:
        for _ in range(4 * INTERRUPTS):
            model.move(*second)
            signal.setitimer(signal.ITIMER_REAL, duration * rng.uniform(0.02, 0.9))
            try:
                model.problem.solve()
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            except KeyboardInterrupt:
                hits += 1
                assert fingerprint(model.problem) == before
                if hits == INTERRUPTS:
                    break
            else:  # a fast machine was done before: once more from the start
                model = make(f"interrupted{rng.integers(10**6)}_{kind}_")
                reached(model, first)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, usual)
    assert hits == INTERRUPTS
    assert reached(model, second) == pytest.approx(expected, rel=1e-12, abs=1e-12)


class Stop(Exception):
    """An exception that no one below knows."""


@pytest.mark.parametrize("where", ["polish", "commit", "present", "residual"])
@pytest.mark.parametrize("solver", ["condensed", "full"])
def test_exceptions_anywhere_change_nothing(where, solver, monkeypatch):
    model = block("hexahedron", 0.3, f"left_{where}_", solver=solver)
    reached(model, (0.0, 0.0, -0.01))
    before = fingerprint(model.problem)
    calls = 0

    def fails(*_, **__):
        raise Stop

    def later(original):
        def wrapped(*arguments):
            nonlocal calls
            calls += 1
            if calls == 3:
                raise Stop
            return original(*arguments)

        return wrapped

    model.move(0.01, 0.0, -0.01)
    with monkeypatch.context() as patch, pytest.raises(Stop):
        if where == "polish":
            patch.setattr(correctors, "polish", fails)
        elif where == "commit":
            patch.setattr(ff.Contact, "commit", fails)
        elif where == "present":
            patch.setattr(ff.Contact, "present", later(ff.Contact.present))
        else:
            patch.setattr(ContactTerms, "add_residual", later(ContactTerms.add_residual))
        model.problem.solve()
    assert fingerprint(model.problem) == before
    assert np.isfinite(reached(model, (0.01, 0.0, -0.01))).all()


def test_a_monitor_that_raises_leaves_the_last_state():
    model = block("hexahedron", 0.3, "monitor_")
    reached(model, (0.0, 0.0, -0.01))
    before = fingerprint(model.problem)

    def monitor(report):
        raise Stop

    model.problem.monitor = monitor
    model.move(0.01, 0.0, -0.01)
    with pytest.raises(Stop):
        model.problem.solve()
    model.problem.monitor = None
    assert fingerprint(model.problem) == before


def interrupted(line, call):
    """Make a call, interrupted at a line of the package counted from its start; tell whether."""
    left = [line]

    def trace(frame, event, _):
        if not frame.f_code.co_filename.startswith(PACKAGE):
            return None
        left[0] -= event == "line"
        if left[0] == 0:
            raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


@pytest.mark.parametrize("kind", ["rigid", "deformable"])
def test_kinematics_after_an_interrupt_at_any_line_are_those_of_the_displacement(kind):
    make = {"rigid": lambda p: block("hexahedron", 0.3, p), "deformable": lambda p: stack(0.3, p)}
    model = make[kind](f"line_{kind}_")
    model.move(0.0, 0.0, -0.01)
    model.problem.solve()
    pairing, u = model.contact.pairing, model.problem.u
    places = [u.x.array.copy(), u.x.array + 1e-3 * np.sin(np.arange(u.x.array.size))]

    def found(place):
        u.x.array[:] = places[place]
        pairing.update()
        field, weights = pairing.derivatives()
        return [pairing.values().copy(), field.copy(), pairing.weights(), np.asarray(weights)]

    expected = [found(0), found(1)]
    line = 0
    while True:
        line += 1
        for place in (0, 1):  # the displacement goes back, or stays
            found(0)
            if not interrupted(line, lambda: found(1)):
                assert line > 20
                return
            for now, right in zip(found(place), expected[place], strict=True):
                assert np.array_equal(now, right)


def test_an_interrupt_leaves_the_whole_system_in_use(monkeypatch):
    """Wherever it comes: here just after the solver of the boundary was taken."""
    model = block("hexahedron", 0.3, "left_in_use_")
    reached(model, (0.0, 0.0, -0.01))
    solvers = model.problem.solvers
    solvers.now = solvers._boundary
    model.move(0.01, 0.0, -0.01)
    with monkeypatch.context() as patch, pytest.raises(Stop):
        patch.setattr(correctors, "polish", lambda *_, **__: (_ for _ in ()).throw(Stop))
        model.problem.solve()
    assert solvers.now is solvers.full
    assert model.problem.solve().certified
