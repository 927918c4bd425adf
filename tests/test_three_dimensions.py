"""3D blocks pressed on a plane and swept along an L-shaped path with reversal and release."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fenicsx_friction.loading.energy import EnergyAudit
from fenicsx_friction.verification.exact import ExactReference
from models import L_PATH, block, gathered


@pytest.mark.parametrize("corrector", ["projection", "ramp"])
@pytest.mark.parametrize("mu", [0.3, 1.0])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_sweep_equals_the_exact_reference(cell, mu, corrector):
    model = block(cell, mu, f"sweep_{corrector}_", corrector=corrector)
    exact = ExactReference(model.problem)
    states = set()
    for displacement in L_PATH:
        model.move(*displacement)
        expected = exact.advance()
        report = model.problem.solve()
        c = model.contact.nodal().c
        scale = max(np.max(np.abs(expected.c)), 1e-3)  # Pa; the last step opens all
        assert c == pytest.approx(expected.c, abs=1e-7 * scale)
        totals = report.contacts[0]
        states |= {name for name in ("open", "stick", "slip") if getattr(totals, name)}
    assert states == {"open", "stick", "slip"}
    assert totals.open == len(c)


@pytest.mark.mpi
def test_rotated_block_has_the_same_tractions():
    """Any plane: rotating block, plane and path turns forces and changes nothing else."""
    turn = Rotation.from_euler("xyz", [20.0, -35.0, 50.0], degrees=True).as_matrix()
    forces, pressures = [], []
    for rotation in (None, turn):
        model = block("hexahedron", 0.5, "turn_", rotation=rotation)
        for displacement in L_PATH[:5]:
            model.move(*displacement)
            report = model.problem.solve()
        forces.append(model.frame @ np.array(report.contacts[0].force))
        pressures.append(np.sort(gathered(model.problem)[1][:, 0]))
    assert forces[1] == pytest.approx(forces[0], rel=1e-9, abs=1e-9)
    assert pressures[1] == pytest.approx(pressures[0], rel=1e-9, abs=1e-9)


@pytest.mark.mpi
def test_finite_strain_force_equals_reaction_and_turns_with_the_sweep():
    model = block("hexahedron", 0.4, "finite_", energy="finite")
    audit = EnergyAudit(model.problem, model.stored)
    for displacement in ((0, 0, -0.06), (0.1, 0, -0.06), (0.1, 0.1, -0.06), (0, 0.1, -0.06)):
        model.move(*displacement)
        report = model.problem.solve()
        balance = audit.update()
        force = np.array(report.contacts[0].force)
        # The reaction at the held top balances the contact force.
        held = model.problem.constrained_dofs
        momentum = model.problem.balance.momentum()
        held = held[held < len(momentum)]
        reaction = np.array([np.sum(momentum[held[held % 3 == k]]) for k in range(3)])
        reaction = model.problem.comm.allreduce(reaction)
        assert -reaction == pytest.approx(force, abs=1e-9 * np.linalg.norm(force))
        assert np.hypot(*force[:2]) <= 0.4 * force[2] * (1 + 1e-12)
        assert balance.smallest_dissipation >= -1e-12
    assert force[0] > 0  # friction opposes the last sweep, to -x


def test_symmetry_planes_pin_the_multiplier_and_keep_the_solution():
    """A quarter with symmetry planes equals the whole block under a symmetric load."""
    from mpi4py import MPI

    import ufl
    from dolfinx import fem, mesh

    import fenicsx_friction as ff
    from models import tagged_facets

    def press(n, lower, prefix, symmetric):
        msh = mesh.create_box(
            MPI.COMM_SELF, [[lower, lower, 0.0], [1.0, 1.0, 0.5]], n, mesh.CellType.hexahedron
        )
        tags = tagged_facets(
            msh,
            lambda x: np.isclose(x[2], 0.0),
            lambda x: np.isclose(x[2], 0.5),
            lambda x: np.isclose(x[0], 0.0) & symmetric,
            lambda x: np.isclose(x[1], 0.0) & symmetric,
        )
        V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
        u, v = fem.Function(V), ufl.TestFunction(V)
        stored = ff.bulk.stored_energy(
            ff.bulk.small_strain_energy(u, ff.bulk.Elastic(1000.0, 0.3)), ufl.dx
        )
        top = fem.Function(V)
        top.x.array[2::3] = -0.01
        bcs = [fem.dirichletbc(top, fem.locate_dofs_topological(V, 2, tags.find(2)))]
        if symmetric:
            bcs += [
                fem.dirichletbc(
                    0.0, fem.locate_dofs_topological(V.sub(k), 2, tags.find(3 + k)), V.sub(k)
                )
                for k in range(2)
            ]
        contact = ff.Contact(
            ff.ContactSurface(msh, tags, 1), ff.RigidPlane((0, 0, 0), (0, 0, 2.0)), ff.Coulomb(0.2)
        )
        problem = ff.FrictionalContactProblem(
            ufl.derivative(stored, u, v), u, contact=contact, bcs=bcs, petsc_options_prefix=prefix
        )
        report = problem.solve()
        x, c, displacement = gathered(problem)
        corner = (x[:, 0] > -1e-9) & (x[:, 1] > -1e-9)
        return x[corner], c[corner], displacement[corner], report, contact

    x, c, u, whole, _ = press((6, 6, 2), -1.0, "whole_", False)
    X, C, U, quarter, contact = press((3, 3, 2), 0.0, "quarter_", True)
    assert X == pytest.approx(x, abs=1e-12)
    assert C[:, 0] == pytest.approx(c[:, 0], rel=1e-9, abs=1e-9)
    assert U == pytest.approx(u, abs=1e-12)
    assert 4 * quarter.contacts[0].force[2] == pytest.approx(whole.contacts[0].force[2], rel=1e-10)
    # 7 nodes on the planes: one pinned tangent each, two at the corner.
    assert np.sum(contact.free.x.array == 0.0) == 8
