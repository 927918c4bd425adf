"""Viscous relaxation: an arch under a growing load snaps through and lands on a floor."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from models import by_place, tagged_facets

#: Half-span, rise and thickness of the arch, and depth of the floor below its ends (m).
HALF, RISE, THICK, FLOOR = 1.0, 0.2, 0.06, 0.1
LOAD = 6.0  # Pa, beyond the limit load


def arch(comm, prefix, mu):
    """Build the clamped arch; return problem, stored energy, loads, relaxation and their setter."""
    msh = mesh.create_rectangle(
        comm, [[-HALF, 0.0], [HALF, THICK]], [32, 2], mesh.CellType.quadrilateral
    )
    ends, top, bottom = (
        lambda x: np.isclose(abs(x[0]), HALF),
        lambda x: np.isclose(x[1], THICK),
        lambda x: np.isclose(x[1], 0.0),
    )
    tags = tagged_facets(msh, bottom, top, ends)
    msh.geometry.x[:, 1] += RISE * (1.0 - (msh.geometry.x[:, 0] / HALF) ** 2)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V, name="u"), ufl.TestFunction(V)
    relaxation, load = ff.ViscousRelaxation(u), fem.Constant(msh, 0.0)
    stored = ff.bulk.stored_energy(ff.bulk.neo_hooke_energy(u, ff.bulk.Elastic(1e4, 0.3)), ufl.dx)
    weight = -load * v[1] * ufl.ds(2, domain=msh, subdomain_data=tags)
    held = fem.locate_dofs_topological(V, 1, tags.find(3))
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v) - weight + relaxation.residual(v),
        u,
        contact=ff.Contact(
            ff.ContactSurface(msh, tags, 1, "arch"),
            ff.RigidPlane((0.0, -FLOOR), (0.0, 1.0)),
            mu if isinstance(mu, ff.FrictionLaw) else ff.Coulomb(mu),
        ),
        bcs=[fem.dirichletbc(fem.Function(V), held)],
        petsc_options_prefix=prefix,
        settings=ff.StepSettings(fallbacks=0),
    )
    return problem, stored, weight, relaxation, lambda t: setattr(load, "value", np.asarray(t))


def path(loads, problem, **options):
    """Return the stepper from no load to the full one."""
    return ff.LoadStepper(
        problem, loads, end=LOAD, step=LOAD / 10, smallest=LOAD / 40, progress=False, **options
    )


class Film(ff.Coulomb):
    """Friction that grows with the slip rate."""

    def limit(self, pressure, sliding):
        return (0.1 + 0.5 * sliding.rate) * pressure


@pytest.mark.quick
def test_the_times_of_the_increments_add_up_to_the_step(comm):
    """A law that depends on the slip rate sees slip over time in each of them."""
    problem, _, _, relaxation, loads = arch(comm, "rates_", Film(0.0))
    seen = []

    def update():
        (state,) = problem.accepted
        seen.append((problem.num_steps, float(problem.dt.value), state))

    records = path(loads, problem, relaxation=relaxation, update=update).run()
    snap = next(r for r in records if r.relaxed)
    dts = [dt for k, dt, _ in seen if snap.report.step - snap.relaxed < k <= snap.report.step]
    n = snap.relaxed
    assert n > 2
    assert len(dts) == n
    assert sum(dts) == pytest.approx(snap.step, rel=1e-13)
    assert dts[:-1] == pytest.approx([snap.step / (k * (k + 1)) for k in range(1, n)], rel=1e-12)
    assert dts[-1] == pytest.approx(snap.step / n, rel=1e-12)
    for record in (r for r in records if not r.relaxed):
        assert (record.report.step, record.step) in [(k, dt) for k, dt, _ in seen]
    slipped = 0.0
    for _, dt, state in seen:
        rate = np.linalg.norm(state.slip, axis=1) / dt
        pressure = np.maximum(state.c[:, 0] - state.r * state.gap, 0.0)
        assert state.limit == pytest.approx((0.1 + 0.5 * rate) * pressure, rel=1e-9, abs=1e-9)
        slipped = max(slipped, np.max(rate[pressure > 0.0], initial=0.0))
    assert comm.allreduce(slipped, MPI.MAX) > 0.0


@pytest.mark.mpi
def test_relaxation_takes_the_arch_through_the_snap(comm):
    """The energy that the snap sets free is the defect; all comes to rest in a certified state."""
    problem, stored, weight, relaxation, loads = arch(comm, "snap_", 0.3)
    audit = ff.EnergyAudit(problem, stored, weight)
    records = path(loads, problem, relaxation=relaxation, audit=audit).run()
    snap = next(r for r in records if r.relaxed)
    after = [r for r in records if r.time > snap.time]
    assert snap.relaxed > 1
    assert snap.failed
    assert not any(r.relaxed for r in after)
    assert relaxation.damping.value == 0.0
    assert all(r.report.certified for r in records)
    assert snap.energy.defect > 0.05
    assert max(abs(r.energy.defect) for r in after) < 0.01 * snap.energy.defect
    assert min(r.energy.smallest_dissipation for r in records) >= -1e-12
    floor = records[-1].report.contacts[0]
    assert floor.open < 31
    assert floor.force[1] > 0.0


def test_rest_does_not_depend_on_the_way(comm):
    """Without friction: relaxation and a Newton step that jumps across find the same state."""
    states = []
    for relaxed in (True, False):
        problem, _, _, relaxation, loads = arch(comm, f"rest_{relaxed}_", 0.0)
        if not relaxed:
            problem.settings = ff.StepSettings()
        records = path(loads, problem, relaxation=relaxation if relaxed else None).run()
        assert any(r.relaxed for r in records) == relaxed
        states.append(by_place(problem.u))
    assert states[0] == pytest.approx(states[1], abs=1e-9)


def test_without_relaxation_the_path_ends_at_the_limit_load(comm):
    problem, _, _, _, loads = arch(comm, "limit_", 0.3)
    stepper = path(loads, problem)
    with pytest.raises(ff.StepperFailed, match="snaps"):
        stepper.run()
    assert 0.2 * LOAD <= stepper.time < 0.3 * LOAD
    assert problem.num_steps > 0


def test_a_snap_without_end_is_reported(comm, monkeypatch):
    """The state is the last accepted one and the damping is off."""
    monkeypatch.setattr("fenicsx_friction.loading.relaxation.MAX_INCREMENTS", 1)
    problem, _, _, relaxation, loads = arch(comm, "endless_", 0.3)
    stepper = path(loads, problem, relaxation=relaxation)
    dts = []
    with pytest.raises(ff.StepperFailed):
        for record in stepper:
            dts.append(record.step)
    assert float(problem.dt.value) == dts[-1]
    assert relaxation.damping.value == 0.0
    assert problem.u.x.array == pytest.approx(problem.u_old.x.array, abs=0.0)
    assert problem.certify().certified


def test_a_relaxation_that_is_not_in_the_residual_is_refused(comm):
    problem, _, _, _, loads = arch(comm, "forgotten_", 0.3)
    with pytest.raises(ff.ContactInputError, match=r"add relaxation\.residual\(v\)"):
        path(loads, problem, relaxation=ff.ViscousRelaxation(problem.u))
