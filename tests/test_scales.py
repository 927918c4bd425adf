"""Residuals are measured by the forces that meet, in any unit, for each body and contact."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

import fenicsx_friction as ff
from bodies import box, joined, stack
from fenicsx_friction.surfaces.bodies import number_bodies
from models import block, tagged_facets, with_contact

#: Units of length (m) and of stress (Pa): their products of all kinds stay within floating point.
UNITS = [(1e-9, 1e-12), (1e-9, 1e12), (1e6, 1e-12), (1e6, 1e12), (1e-3, 1e-3)]


def pressed_and_dragged(length: float, modulus: float, prefix: str):
    """Return iterations and forces (in units of modulus and length) of the example of README."""
    model = block("hexahedron", 0.3, prefix, energy="finite", length=length, modulus=modulus)
    iterations, forces = [], []
    for z, x, y in ((-0.01, 0, 0), (-0.01, 0.002, 0), (-0.01, 0.02, 0), (-0.01, 0.02, 0.02)):
        model.move(x * length, y * length, z * length)
        report = model.problem.solve()
        assert report.certified
        iterations.append([s.iterations for s in report.substeps])
        forces.append(np.array(report.contacts[0].force) / (modulus * length**2))
    return iterations, np.array(forces)


def test_any_units_give_the_same_solution_in_the_same_iterations():
    iterations, forces = pressed_and_dragged(1.0, 1.0, "unit_")
    assert np.max(abs(forces)) > 0.02
    for k, (length, modulus) in enumerate(UNITS):
        again, scaled = pressed_and_dragged(length, modulus, f"unit{k}_")
        assert again == iterations
        assert scaled == pytest.approx(forces, rel=1e-9, abs=1e-9 * np.max(abs(forces)))


@pytest.mark.mpi
def test_any_units_give_the_same_contact_of_two_bodies():
    found = []
    for k, (length, modulus) in enumerate([(1.0, 1.0), (1e-5, 1e3), (1e-9, 1e-12), (1e6, 1e12)]):
        model = stack(
            0.4, f"stack{k}_", E=modulus, warp=lambda x, length=length: length * x, nu=0.3
        )
        iterations, forces = [], []
        for x, z in ((0.0, -0.02), (0.03, -0.02), (0.05, -0.02)):
            model.move(x * length, 0.0, z * length)
            report = model.problem.solve()
            assert report.certified
            iterations.append(report.iterations)
            forces.append(np.array(report.contacts[0].force) / (modulus * length**2))
        found.append((iterations, np.array(forces)))
    (iterations, forces), *others = found
    for again, scaled in others:
        assert again == iterations
        assert scaled == pytest.approx(forces, rel=1e-9, abs=1e-9 * np.max(abs(forces)))


def two_blocks(moduli, prefix, mu=0.3, gap=1.0):
    """Return two blocks side by side on one plane, of one contact surface, and their tops."""
    size, n = np.array([1.0, 0.5]), (4, 2)
    parts = [
        box(corner, corner + size, n, "quadrilateral") for corner in ([0.0, 0.0], [1.0 + gap, 0.0])
    ]
    msh = joined(MPI.COMM_WORLD, *parts)
    tags = tagged_facets(msh, lambda x: np.isclose(x[1], 0.0), lambda x: np.isclose(x[1], 0.5))
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    young = fem.Function(fem.functionspace(msh, ("DG", 0)))
    young.interpolate(lambda x: np.where(x[0] < 1.0 + gap / 2.0, *moduli))
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(young, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    top = fem.Function(V)
    held = fem.locate_dofs_topological(V, 1, tags.find(2))
    surface = ff.ContactSurface(msh, tags, 1)
    contact = ff.Contact(surface, ff.RigidPlane((0.0, 0.0), (0.0, 1.0)), ff.Coulomb(mu))
    bcs = [fem.dirichletbc(top, held)]
    problem = ff.FrictionalContactProblem(
        F, u, contact=contact, bcs=bcs, petsc_options_prefix=prefix
    )
    return problem, top


def forces_of_blocks(problem):
    """Return the contact forces on the two blocks."""
    (contact,) = problem.contacts
    forces = contact.nodal_area()[:, None] * contact.nodal_traction()
    first = contact.surface.x[:, 0] < 1.2
    parts = np.stack([forces[first].sum(axis=0), forces[~first].sum(axis=0)])
    return problem.comm.allreduce(parts, MPI.SUM)


@pytest.mark.parametrize("ratio", [1.0, 1e6, pytest.param(2e9, marks=pytest.mark.mpi), 2e11, 1e15])
def test_a_soft_block_beside_a_stiff_one_is_as_exact_as_alone(ratio):
    reference, found = [], []
    for modulus, forces in ((1.0, reference), (ratio, found)):
        problem, top = two_blocks((modulus, 1.0), f"soft{ratio:.0g}_{modulus:.0g}_")
        for x, y in ((0.0, -1e-3), (0.01, -1e-3), (0.004, -2e-3)):
            top.x.array[:] = np.tile([x, y], len(top.x.array) // 2)
            assert problem.solve().certified
            forces.append(forces_of_blocks(problem))
    reference, found = np.array(reference), np.array(found)
    assert abs(reference[1, 1, 0] / reference[1, 1, 1]) == pytest.approx(0.3, rel=1e-9)
    error = abs(found - [[ratio], [1.0]] * reference)
    assert np.all(error < 1e-9 * np.max(abs(reference)) * np.array([[ratio], [1.0]]))


@pytest.mark.mpi
def test_contact_too_faint_beside_its_displacements_is_said_to_be_unresolved():
    problem, top = two_blocks((1.0, 1.0), "faint_")
    top.x.array[:] = np.tile([0.0, -1e-13], len(top.x.array) // 2)
    assert problem.solve().certified
    assert forces_of_blocks(problem)[0, 1] > 0.0
    top.x.array[:] = np.tile([1.0, -1e-13], len(top.x.array) // 2)
    with pytest.raises(ff.StepFailed, match="too faint to be resolved"):
        problem.solve()
    # What can be resolved is solved: pressed as steel by a few MPa, dragged by a metre.
    top.x.array[:] = np.tile([1.0, -1e-5], len(top.x.array) // 2)
    report = problem.solve()
    assert report.certified
    tangential, normal = forces_of_blocks(problem)[0]
    assert abs(tangential / normal) == pytest.approx(0.3, rel=1e-6)


@pytest.mark.mpi
def test_bodies_are_counted_on_any_number_of_ranks():
    parts = [box([2.0 * k, 0.0], [2.0 * k + 1.0, 1.0], (3, 3), "triangle") for k in range(5)]
    msh = joined(MPI.COMM_WORLD, *parts)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    number, body = number_bodies(V)
    assert number == 5
    x = np.floor(V.tabulate_dof_coordinates()[:, 0] / 2.0 + 1e-9).astype(int)
    pairs = set(zip(x.tolist(), body.tolist(), strict=True))
    everything = set().union(*MPI.COMM_WORLD.allgather(pairs))
    assert len(everything) == 5  # one to one, and the same on all ranks


@pytest.mark.parametrize("r_p", [pytest.param(1.0, marks=pytest.mark.mpi), 1e-3, 1e9])
def test_the_certificate_does_not_believe_r_p(r_p):
    """A scale of the rows that is far from the stiffness may cost a solution, not its truth."""
    model = block("hexahedron", 0.3, f"r{r_p:g}_", n=(2, 2, 1))
    model.move(0.0, 0.0, -0.01)
    plain = model.problem.solve()
    other = block("hexahedron", 0.3, f"other{r_p:g}_", n=(2, 2, 1))
    contact = ff.Contact(
        other.contact.surface, other.contact.obstacle, other.contact.friction, r_p=r_p
    )
    problem = with_contact(other, contact, f"again{r_p:g}_")
    other.move(0.0, 0.0, -0.01)
    try:
        report = problem.solve()
    except ff.StepFailed:
        return
    force = np.array(report.contacts[0].force)
    assert force == pytest.approx(np.array(plain.contacts[0].force), rel=1e-8, abs=1e-8)
    assert report.certificate.penetration < 1e-9 * 0.01


@pytest.mark.parametrize("ratio", [1e3, 1e6])
def test_a_stiff_block_slides_on_a_soft_base(ratio):
    """The secondary surface is the stiff one: its stiffness says nothing of the gap."""
    model = stack(0.3, f"stiff{ratio:g}_", cell="quadrilateral", E=(ratio, 1.0), **FLAT)
    for x, y in ((0.0, -0.01), (0.05, -0.01)):
        model.move(x, y)
        report = model.problem.solve()
        assert report.certified
        assert report.iterations < 100  # 62 here, 698 if the stiff side decides
    tangential, normal = report.contacts[0].force
    assert normal > 0.0
    assert tangential == pytest.approx(-0.3 * normal, rel=0.05)  # but for the slope of the dent


#: A block on a base of two dimensions, the base wider.
FLAT = {
    "upper": (5, 5),
    "lower": (4, 4),
    "top": ((0.1, 1.0), (0.9, 1.8)),
    "base": ((0.0, 0.0), (1.0, 1.0)),
    "energy": "small",
}
