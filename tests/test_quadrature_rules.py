"""Integrals of one form with several quadrature rules keep their own points."""

import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from fenicsx_friction.base.literals import lifted_form
from test_elements import CELLS, column, lagrange


def assembled(form, cache):
    return fem.assemble_vector(fem.form(form, jit_options={"cache_dir": cache})).array


def residual(cell, energy, *, lifted):
    """The B-bar residual of a sheared column of distorted cells; its moduli are Constants."""
    msh: mesh.Mesh = column(cell)
    u = fem.Function(fem.functionspace(msh, lagrange(cell)))
    u.interpolate(lambda x: 0.02 * (x[: CELLS[cell]] ** 2 + 0.5 * x[0] * x[1]))
    moduli = (fem.Constant(msh, value) for value in (1000.0, 0.499))
    density = getattr(ff.bulk, energy)(u, ff.bulk.Elastic(*moduli))
    stored = ff.bulk.stored_energy(density, ufl.dx, bbar=True)
    F = ufl.derivative(stored, u, ufl.TestFunction(u.function_space))
    return lifted_form(F) if lifted else ufl.algorithms.expand_derivatives(F)


@pytest.mark.parametrize("lifted", [False, True])
@pytest.mark.parametrize(
    ("cell", "energy"),
    [("quadrilateral", "small_strain_energy"), ("hexahedron", "small_strain_energy")]
    + [("quadrilateral", "neo_hooke_energy")],
)
def test_a_rule_of_one_point_leaves_others_their_points(cell, energy, lifted, tmp_path):
    form = residual(cell, energy, lifted=lifted)
    parts = [assembled(ufl.Form([part]), tmp_path) for part in form.integrals()]
    whole = assembled(form, tmp_path)
    assert len(parts) == 2
    assert whole == pytest.approx(sum(parts), rel=0.0, abs=1e-12 * abs(parts[0]).max())
