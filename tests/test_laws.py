"""The equations of laws.py as numbers, without meshes: closed forms, limits, roots, kinks."""

import math

import numpy as np
import pytest
import ufl
from ufl.core.expr import Expr

from fenicsx_friction import laws

R = 50.0  # r_p in these tests


def value(expression: Expr) -> float:
    """Evaluate a scalar UFL expression of numbers."""
    return float(ufl.as_ufl(expression)(()))


def vector(expression: Expr) -> np.ndarray:
    """Evaluate a UFL vector of numbers."""
    return np.array([value(expression[i]) for i in range(expression.ufl_shape[0])])


def numbers(*values: float) -> Expr:
    """Make a UFL vector of numbers that UFL does not fold away."""
    return ufl.as_vector([ufl.as_ufl(float(v)) for v in values])


@pytest.mark.parametrize("eps", [1e-3, 1.0, 1e6])
@pytest.mark.parametrize("x", [-3.0, -0.1, 0.2, 5.0])
def test_ramp_is_the_two_branch_formula_13(x, eps):
    alpha = math.log(2.0) / eps
    x *= eps
    if x >= 0:
        expected = x + math.log1p(math.exp(-alpha * x)) / alpha
    else:
        expected = x + (-alpha * x + math.log1p(math.exp(alpha * x))) / alpha
    assert value(laws.ramp(ufl.as_ufl(x), ufl.as_ufl(eps))) == pytest.approx(expected, rel=1e-14)


def test_ramp_at_zero_is_eps_and_never_overflows():
    assert value(laws.ramp(ufl.as_ufl(0.0), ufl.as_ufl(0.25))) == pytest.approx(0.25, rel=1e-15)
    assert value(laws.ramp(ufl.as_ufl(-1e12), ufl.as_ufl(1e-9))) == 0.0
    assert value(laws.ramp(ufl.as_ufl(1e12), ufl.as_ufl(1e-9))) == 1e12


@pytest.mark.parametrize("x", [-2.0, 0.0, 3.0])
def test_ramp_converges_to_the_positive_part_from_above(x):
    errors = [
        value(laws.ramp(ufl.as_ufl(x), ufl.as_ufl(eps))) - max(x, 0.0)
        for eps in (1.0, 0.1, 1e-2, 0.0)
    ]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] == 0.0


@pytest.mark.quick
@pytest.mark.parametrize(
    ("gap", "pressure", "holds"),
    [(0.0, 3.0, True), (0.1, 0.0, True), (0.1, 3.0, False), (-0.1, 0.0, False), (0.0, -1.0, False)],
)
def test_normal_row_vanishes_exactly_on_signorini(gap, pressure, holds):
    row = value(laws.normal_row(ufl.as_ufl(gap), ufl.as_ufl(pressure), ufl.as_ufl(R), 0.0))
    assert (abs(row) < 1e-14) == holds


def test_normal_row_traces_a_hyperbola_like_curve_above_the_axes():
    """With eps > 0 the root has both gap and pressure positive (Fig. 3)."""
    eps, gap = 0.5, 0.02
    low, high = 0.0, 10.0
    for _ in range(60):
        mid = (low + high) / 2
        row = value(laws.normal_row(ufl.as_ufl(gap), ufl.as_ufl(mid), ufl.as_ufl(R), eps))
        low, high = (mid, high) if row > 0 else (low, mid)
    # <a - b>_eps = a means 2^(-a/eps) + 2^(-b/eps) = 1 for a = r g and b = c_n.
    assert 2 ** (-R * gap / eps) + 2 ** (-mid / eps) == pytest.approx(1.0, rel=1e-9)


SLIDING = [
    # slip increment, traction, limit: does the law hold?
    ((0.0, 0.0), (0.3, 0.4), 1.0, True),  # stick inside the cone
    ((0.0, 0.0), (0.6, 0.8), 1.0, True),  # on the cone, about to slip
    ((-0.3, -0.4), (0.6, 0.8), 1.0, True),  # slip opposite to the traction
    ((0.3, 0.4), (0.6, 0.8), 1.0, False),  # slip along the traction
    ((-0.4, 0.3), (0.6, 0.8), 1.0, False),  # slip across
    ((-0.3, -0.4), (0.3, 0.4), 1.0, False),  # slip inside the cone
    ((0.0, 0.0), (1.2, 1.6), 1.0, False),  # outside the cone
    ((0.2, 0.1), (0.0, 0.0), 0.0, True),  # open: free to move
    ((0.0, 0.0), (0.1, 0.0), 0.0, False),  # open: no traction
]


@pytest.mark.quick
@pytest.mark.parametrize(("slip", "traction", "limit", "holds"), SLIDING)
@pytest.mark.parametrize("r", [0.1, 1.0, 100.0])
def test_projection_row_vanishes_exactly_on_coulomb(slip, traction, limit, holds, r):
    arguments = numbers(*slip), numbers(*traction), ufl.as_ufl(limit), ufl.as_ufl(r)
    row = laws.projection_row(*arguments, ufl.as_ufl(0.0))
    assert bool(np.linalg.norm(vector(row)) < 1e-13 * r) == holds


@pytest.mark.parametrize(("slip", "traction", "limit", "holds"), SLIDING)
def test_slip_row_has_the_slip_states_and_the_false_root(slip, traction, limit, holds):
    row = laws.slip_row(numbers(*traction), ufl.as_ufl(limit), numbers(*slip), ufl.as_ufl(0.1))
    zero = bool(np.linalg.norm(vector(row)) < 1e-14)
    # w = 0 is a root for every traction, outside the cone too: why a certificate is needed.
    assert zero == (holds or slip == (0.0, 0.0))


def test_blend_starts_at_the_radial_return_of_the_stick_force():
    stick, mu_cn = np.array([3.0, 4.0]), 2.0
    w = laws.blended_slip(numbers(0.7, -0.1), numbers(*stick), 1.0, 0.01)
    returned = mu_cn * stick / 5.0
    assert vector(laws.slip_row(numbers(*returned), mu_cn, w, 0.01)) == pytest.approx(
        np.zeros(2), abs=1e-15
    )
    printed = laws.blended_slip(numbers(0.7, -0.1), numbers(*stick), 1.0, 0.01, sign=1.0)
    assert vector(laws.slip_row(numbers(*-returned), mu_cn, printed, 0.01)) == pytest.approx(
        np.zeros(2), abs=1e-15
    )


def test_blend_ends_at_the_true_slip():
    w = laws.blended_slip(numbers(0.7, -0.1), numbers(3.0, 4.0), 0.0, 0.01)
    assert vector(w) == pytest.approx([0.7, -0.1], abs=0)


def test_stick_row_binds_closed_nodes_and_frees_open_ones():
    closed = laws.closed(ufl.as_ufl(0.0), ufl.as_ufl(1.0), R)
    opened = laws.closed(ufl.as_ufl(0.1), ufl.as_ufl(0.0), R)
    touching = laws.closed(ufl.as_ufl(0.0), ufl.as_ufl(0.0), R)
    assert (value(closed), value(opened), value(touching)) == (1.0, 0.0, 1.0)
    s, c_t = numbers(0.2, 0.0), numbers(0.0, 3.0)
    assert vector(laws.stick_row(s, c_t, R, closed)) == pytest.approx([10.0, 0.0])
    assert vector(laws.stick_row(s, c_t, R, opened)) == pytest.approx([0.0, 3.0])


@pytest.mark.parametrize("y", [(0.0, 0.0), (1.0, 0.0), (1e-200, 0.0), (1e150, 1e150)])
@pytest.mark.parametrize("limit", [0.0, 1.0])
def test_derivatives_are_finite_at_the_kinks(y, limit):
    a = ufl.variable(numbers(*y))
    for function in (laws.norm(a) * a, laws.projection(a, ufl.as_ufl(limit), ufl.as_ufl(0.0))):
        jacobian = ufl.algorithms.apply_derivatives.apply_derivatives(
            ufl.algorithms.apply_algebra_lowering.apply_algebra_lowering(ufl.diff(function, a))
        )
        entries = [value(jacobian[i, j]) for i in range(2) for j in range(2)]
        assert np.all(np.isfinite(entries))


@pytest.mark.parametrize("y", [(0.0, 0.0), (0.3, -0.2), (3.0, 4.0)])
@pytest.mark.parametrize("limit", [0.0, 1.0])
def test_rounded_projection_converges_to_the_exact_one(y, limit):
    length = np.hypot(*y)
    exact = np.array(y) * min(1.0, limit / length if length else 1.0)
    errors = []
    for eps in (1e-1, 1e-3, 1e-6):
        point = vector(laws.projection(numbers(*y), ufl.as_ufl(limit), ufl.as_ufl(eps)))
        assert np.linalg.norm(point) <= limit + eps
        errors.append(np.linalg.norm(point - exact))
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-5
