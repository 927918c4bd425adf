"""Contact fields, resultants and writers."""

import numpy as np
import pytest
from dolfinx.io import VTXWriter

import fenicsx_friction as ff
from models import L_PATH, block, raous


@pytest.mark.quick
@pytest.mark.mpi
def test_fields_are_those_of_the_accepted_step():
    model = block("hexahedron", 0.4, "fields_")
    fields = ff.ContactFields(model.problem)
    with pytest.raises(ff.ContactInputError, match="no accepted step"):
        fields.update()
    total = np.zeros((model.contact.surface.num_owned, 3))
    length = np.zeros(len(total))
    for displacement in L_PATH[:7]:
        model.move(*displacement)
        report = model.problem.solve()
        fields.update()
        n = len(total)
        slip = fields.slip.x.array[: 3 * n].reshape(n, 3)
        total += slip
        length += np.linalg.norm(slip, axis=1)
    assert fields.path.x.array[:n] == pytest.approx(length, abs=1e-15)
    assert np.all(length >= np.linalg.norm(total, axis=1) - 1e-15)
    assert np.max(length, initial=0.0) > 0.005 or n == 0
    # The body's displacement along the plane is what has slipped.
    assert slip[:, 2] == pytest.approx(0.0, abs=1e-18)
    dofs = model.contact.surface.parent_dofs(model.problem.u.function_space)[:n]
    moved = model.problem.u.x.array.reshape(-1, 3)[dofs]
    assert total[:, :2] == pytest.approx(moved[:, :2], abs=1e-14)
    # Traction = pressure along the normal + tangential part; counts of the tags are the report's.
    tangential = fields.tangential.x.array[: 3 * n].reshape(n, 3)
    traction = fields.traction.x.array[: 3 * n].reshape(n, 3)
    pressure = fields.pressure.x.array[:n]
    assert traction - tangential == pytest.approx(pressure[:, None] * [[0, 0, 1]], abs=1e-12)
    assert np.all(np.linalg.norm(tangential, axis=1) <= 0.4 * pressure * (1 + 1e-9) + 1e-12)
    assert np.max(fields.natural_map.x.array, initial=0.0) < 1e-8
    states = np.bincount(fields.state.x.array[:n].astype(int), minlength=3)
    states = model.problem.comm.allreduce(states)
    totals = report.contacts[0]
    assert states.tolist() == [totals.open, totals.stick, totals.slip]
    tags = fields.state_tags()
    owned = model.contact.surface.submesh.topology.index_map(0).size_local
    tagged = model.problem.comm.allreduce(np.bincount(tags.values[:owned], minlength=3))
    assert tagged.tolist() == states.tolist()


@pytest.mark.mpi
def test_resultant_force_and_moment_are_the_reactions():
    """Finite strain: force and moment of contact and of the held top balance, to rounding."""
    model = block("hexahedron", 0.4, "moment_", energy="finite")
    problem = model.problem
    for displacement in ((0, 0, -0.05), (0.05, 0.02, -0.05)):
        model.move(*displacement)
        totals = problem.solve().contacts[0]
    V = problem.u.function_space
    momentum = problem.balance.momentum().reshape(-1, 3)
    x = V.tabulate_dof_coordinates()[: len(momentum)]
    x = x + problem.u.x.array.reshape(-1, 3)[: len(momentum)]
    held = np.unique(problem.constrained_dofs // 3)
    held = held[held < len(momentum)]
    force = problem.comm.allreduce(momentum[held].sum(axis=0))
    moment = problem.comm.allreduce(np.cross(x[held], momentum[held]).sum(axis=0))
    scale = np.linalg.norm(totals.force)
    assert force == pytest.approx(-np.array(totals.force), abs=1e-10 * scale)
    assert moment == pytest.approx(-np.array(totals.moment), abs=1e-9 * scale)


def test_moment_in_two_dimensions():
    model = raous(16, 8, 0.5, "moment2d_")
    totals = model.problem.solve().contacts[0]
    (state,) = model.problem.accepted
    x, y = model.contact.pairing.positions().T
    # On a floor the frame is (y, x): moment about z = x f_y - y f_x.
    expected = np.sum(state.area * (x * state.c[:, 0] - y * state.c[:, 1]))
    assert totals.moment == pytest.approx((expected,), rel=1e-12)


@pytest.mark.mpi
def test_writers_take_the_fields(tmp_path):
    model = raous(8, 4, 0.5, "writer_")
    model.problem.solve()
    fields = ff.ContactFields(model.problem)
    fields.update()
    comm = model.problem.comm
    folder = comm.bcast(tmp_path, root=0)
    for name, functions in (("scalars", fields.scalars), ("vectors", fields.vectors)):
        with VTXWriter(comm, folder / f"{name}.bp", functions) as writer:
            writer.write(1.0)
        assert (folder / f"{name}.bp").exists()


def test_several_contacts_need_a_choice():
    model = raous(4, 4, 0.5, "choice_")
    model.problem.contacts.append(model.contact)
    with pytest.raises(ff.ContactInputError, match="2 contacts; say which"):
        ff.ContactFields(model.problem)
