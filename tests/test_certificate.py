"""The certificate: zero on solutions, first order in any violation, deaf to nothing."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fenicsx_friction.base.groups import Groups
from fenicsx_friction.certificate.certificate import certify
from fenicsx_friction.certificate.nodal_state import OPEN, SLIP, STICK, NodalState
from fenicsx_friction.certificate.scales import Scales

MU, R = 0.5, 100.0
REAL = st.floats(-3.0, 3.0)


def solved(gap=(0.1, 0.0, 0.0)) -> NodalState:
    """An open, a sticking and a slipping node in 3D that fulfil the law."""
    c = np.array([[0.0, 0.0, 0.0], [2.0, 0.6, -0.3], [4.0, 1.2, -1.6]])
    slip = np.array([[0.3, -0.1], [0.0, 0.0], [-0.06, 0.08]])
    return at_pressure(NodalState(np.array(gap), slip, np.zeros(3), c, *constants()))


def constants():
    return np.full(3, R), np.full(3, 0.25), np.ones((3, 3), dtype=bool)


def at_pressure(state: NodalState) -> NodalState:
    """Set the limit as Coulomb's law does."""
    return replace(state, limit=MU * np.maximum(state.c[:, 0] - state.r * state.gap, 0.0))


def scales(**options) -> Scales:
    """One body under a force of 1 N and its contact, whose largest traction is that of solved()."""
    sizes = {"largest": [1.0, np.hypot(4.0, 2.0)], "before": [0.0] * 2, "hidden": [0.0] * 2}
    sizes |= {"given": [0.0] * 2, "length": [0.0] * 2} | options
    values = {name: np.array(entries) for name, entries in sizes.items()}
    return Scales(**values, noise=0.0 * values["largest"], lenient=values["largest"] < 0.0)


def certificate(state: NodalState, *, equilibrium=0.0, sizes=None, **options):
    options = {"boundary": 0.0, "pushed": 0.0, "tolerance": 1e-9} | options
    return certify(
        MPI.COMM_SELF,
        [state],
        surfaces=[Groups(np.zeros(len(state.gap), dtype=int), 1)],
        scales=sizes or scales(),
        unbalanced=(np.array([equilibrium]), np.zeros(1)),
        **options,
    )


@pytest.mark.quick
def test_solution_is_certified_and_its_states_are_told():
    result = certificate(solved())
    assert result.certified
    assert result.relative < 1e-15
    assert solved().states().tolist() == [OPEN, STICK, SLIP]


VIOLATIONS = {
    "penetration": ("gap", 1, -1e-3, "penetration"),
    "gap under pressure": ("gap", 1, 1e-3, "complementarity"),
    "tension": ("c", (0, 0), -1e-3, "tension"),
    "traction at an open node": ("c", (0, 1), 1e-3, "cone"),
    "outside the cone": ("c", (2, 1), 1.2 + 1e-3, "cone"),
    "slip of a sticking node": ("slip", (1, 0), 1e-3, "alignment"),
    "slip reversed": ("slip", (2,), (0.06, -0.08), "alignment"),
    "slip turned": ("slip", (2,), (-0.08, -0.06), "alignment"),
    "traction reversed": ("c", (2, slice(1, 3)), (-1.2, 1.6), "alignment"),
    "slip inside the cone": ("c", (2, 1), 1.1, "tangential_map"),
}


@pytest.mark.quick
@pytest.mark.parametrize("name", VIOLATIONS)
def test_each_violation_is_seen_and_named(name):
    field, index, value, entry = VIOLATIONS[name]
    state = solved()
    array = getattr(state, field).copy()
    array[index] = value
    result = certificate(at_pressure(replace(state, **{field: array})))
    assert not result.certified
    assert result.relative > 1e-5
    assert getattr(result, entry) > 1e-6


def test_other_friction_coefficient_is_no_solution():
    assert not certificate(replace(solved(), limit=0.9 * solved().limit)).certified
    assert not certificate(replace(solved(), limit=0.0 * solved().limit)).certified


@pytest.mark.parametrize("field", ["gap", "slip", "c", "limit"])
def test_nan_is_never_certified(field):
    state = solved()
    array = getattr(state, field).copy()
    array.flat[0] = np.nan
    assert not certificate(replace(state, **{field: array})).certified
    assert not certificate(state, equilibrium=float("nan")).certified


def test_equilibrium_is_part_of_the_certificate():
    assert certificate(solved(), equilibrium=1e-10).certified
    assert not certificate(solved(), equilibrium=1e-8).certified


def test_missed_boundary_values_are_not_certified():
    assert not certificate(solved(), boundary=1e-8).certified
    assert not certificate(solved(), boundary=float("inf")).certified


def test_nodes_pushed_in_by_conditions_are_not_certified():
    assert not certificate(solved(), pushed=1e-12).certified


def test_each_body_is_measured_by_its_own_forces():
    """A residual that is nothing beside the forces of a stiff body is an error of a soft one."""
    state, group = solved(), [Groups(np.array([0, 0, 1]), 2)]
    options = {"surfaces": group, "boundary": 0.0, "pushed": 0.0, "tolerance": 1e-9}
    largest = np.array([1e12, 1.0, 1e12, 4.5])
    sizes = Scales(largest, *(np.zeros(4) for _ in range(5)), np.zeros(4, dtype=bool))
    for unbalanced, good in (([1e2, 1e-10], True), ([1e2, 1e-8], False), ([1e4, 0.0], False)):
        result = certify(
            MPI.COMM_SELF,
            [state],
            scales=sizes,
            unbalanced=(np.array(unbalanced), np.zeros(2)),
            **options,
        )
        assert result.certified == good
    c = state.c.copy()
    c[2, 1] += 1e-6
    wrong = certify(
        MPI.COMM_SELF, [replace(state, c=c)], scales=sizes, unbalanced=(np.zeros(2),) * 2, **options
    )
    assert not wrong.certified


def test_forces_that_rounding_hides_are_not_certified():
    """Beside large displacements rounding takes the place of the tolerance, up to a point."""
    rounding = [1e-7, 0.0]
    assert certificate(solved(), equilibrium=5e-8, sizes=scales(hidden=rounding)).certified
    assert not certificate(solved(), equilibrium=2e-7, sizes=scales(hidden=rounding)).certified
    faint = certificate(solved(), sizes=scales(hidden=[1e-5, 0.0]))
    assert not faint.resolved
    assert not faint.certified


def test_nothing_but_rounding_is_no_contact():
    """Tractions below what rounding leaves of given displacements are none."""
    state = solved()
    noise = replace(state, c=1e-17 * state.c, slip=0.0 * state.slip, gap=np.full(3, 1e-19))
    faint = {"largest": [1.0, 5e-17], "hidden": [0.0, 1e-15], "given": [0.0, 1e-15]}
    assert certificate(noise, sizes=scales(**faint, length=[0.0, 1e-17])).certified
    assert not certificate(noise, sizes=scales(**faint, length=[0.0, 1e-20])).certified
    assert not certificate(noise, sizes=scales(**faint | {"given": [0.0, 0.0]})).certified


def test_negative_limits_and_dissipation_are_not_certified():
    """On a disk of negative radius the natural map vanishes for friction along the slip."""
    one = [np.array(a) for a in ([0.0], [[-1.0, 0.0]], [-0.5], [[1.0, 0.5, 0.0]], [1.0], [1.0])]
    driven = NodalState(*one, np.ones((1, 3), dtype=bool))
    driven = replace(driven, slip=np.array([[1.0, 0.0]]))
    assert not certificate(driven).certified
    result = certificate(replace(driven, own_map=np.zeros(1)))
    assert result.natural_map < 1e-12  # the residual of a law of its own
    assert result.negative_limit == 0.5
    assert result.negative_dissipation == 0.5
    assert not result.solved


def test_a_held_node_takes_no_part():
    state = solved()
    gap = state.gap.copy()
    gap[0] = -1.0
    free = state.free.copy()
    free[0] = False
    broken = at_pressure(replace(state, gap=gap))
    assert not certificate(broken).certified
    held = certificate(replace(broken, free=free))
    assert held.certified
    assert held.penetration == 1.0  # that of all nodes is told


@given(c_n=REAL, c_t=st.tuples(REAL, REAL), gap=REAL, slip=st.tuples(REAL, REAL))
def test_natural_map_vanishes_only_on_the_law(c_n, c_t, gap, slip):
    """Against the conditions (3)-(5) written out; and it moves solutions onto the law."""
    one = [np.array(a) for a in ([gap], [slip], [0.0], [[c_n, *c_t]], [R], [1.0])]
    state = at_pressure(NodalState(*one, np.ones((1, 3), dtype=bool)))
    normal, tangential = (float(m[0]) for m in state.natural_map())
    length, slipped = float(np.hypot(*c_t)), float(np.hypot(*slip))
    signorini = max(0.0, -gap, -c_n, min(max(gap, 0.0), max(c_n, 0.0)))
    assert (normal < 1e-12) == (signorini < 1e-12 or abs(min(c_n, R * gap)) < 1e-12)
    if normal < 1e-12:
        limit = MU * max(c_n, 0.0)
        power = limit * slipped + np.dot(c_t, slip)
        lawful = length <= limit + 1e-9 and abs(power) < 1e-9
        assert lawful or tangential > 1e-12
        if tangential < 1e-13:
            assert length <= limit + 1e-9
            assert abs(power) <= 1e-9
