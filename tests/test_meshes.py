# SPDX-License-Identifier: MIT
"""Meshes with names: from gmsh, and joined of bodies that were meshed apart."""

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff

COMM = MPI.COMM_WORLD


def plate(low, high, size, order=1):
    """Make the gmsh model of a rectangle with named sides, in the model that is open."""
    gmsh.model.add(f"plate {low}")
    gmsh.model.occ.addRectangle(*low, 0.0, *np.subtract(high, low))
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [1], name="steel")
    for tag, name in enumerate(("bottom", "right", "top", "left"), start=1):
        gmsh.model.addPhysicalGroup(1, [tag], tag=10 + tag, name=name)
    gmsh.option.setNumber("Mesh.MeshSizeMin", size)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(order)


def read(low, high, size, order=1):
    """Return a plate of gmsh."""
    if COMM.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Verbosity", 2)
        plate(low, high, size, order)
    try:
        return ff.read_gmsh(gmsh.model, COMM)
    finally:
        if COMM.rank == 0:
            gmsh.finalize()


def length(part, name):
    """Return the length of a group of facets."""
    one = fem.Constant(part.mesh, 1.0)
    return COMM.allreduce(fem.assemble_scalar(fem.form(one * part.ds(name))))


def area(part, name):
    """Return the area of a group of cells."""
    one = fem.Constant(part.mesh, 1.0)
    return COMM.allreduce(fem.assemble_scalar(fem.form(one * part.dx(name))))


@pytest.mark.quick
@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_two_plates_from_gmsh_meet(order, tmp_path):
    """Names of both, and a patch test over faces that do not match."""
    lower, upper = read((0, 0), (2, 1), 0.3, order), read((0, 1), (2, 1.5), 0.21, order)
    model = ff.join_meshes({"lower": lower, "upper": upper}, COMM)
    assert set(model.groups) == {
        *(f"{body}/{side}" for body in ("lower", "upper") for side in
          ("steel", "bottom", "right", "top", "left")),
        *("lower", "upper"),
    }  # fmt: skip
    assert length(model, "lower/top") == pytest.approx(2.0, rel=1e-12)
    assert length(model, "upper/left") == pytest.approx(0.5, rel=1e-12)
    assert area(model, "lower") == pytest.approx(2.0, rel=1e-12)
    assert area(model, "upper/steel") == pytest.approx(1.0, rel=1e-12)
    V = fem.functionspace(model.mesh, ("Lagrange", order, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(100.0, 0.3))
    F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
    F -= ufl.inner(fem.Constant(model.mesh, (0.0, -1.0)), v) * model.ds("upper/top")
    bcs = []
    for axis, side in ((1, "bottom"), (0, "left")):
        for body in ("lower", "upper") if axis == 0 else ("lower",):
            dofs = fem.locate_dofs_topological(V.sub(axis), 1, model.facets(f"{body}/{side}"))
            bcs.append(fem.dirichletbc(fem.Constant(model.mesh, 0.0), dofs, V.sub(axis)))
    contact = ff.Contact(
        model.surface("upper/bottom"),
        ff.DeformableObstacle(model.surface("lower/top")),
        ff.Frictionless(),
    )
    problem = ff.FrictionalContactProblem(
        F, u, contact=contact, bcs=bcs, petsc_options_prefix=f"plates_{order}_"
    )
    assert problem.solve().certified
    assert np.allclose(contact.nodal().c[:, 0], 1.0, atol=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["quadrilateral", "tetrahedron", "hexahedron"])
def test_meshes_without_names(cell):
    """Tags without names are called by their numbers, bodies by their own."""
    kind, d = getattr(mesh.CellType, cell), 2 if cell == "quadrilateral" else 3
    make = mesh.create_rectangle if d == 2 else mesh.create_box
    parts = {}
    for k, name in enumerate(("one", "two")):
        low, high = np.full(d, 2.0 * k), np.full(d, 2.0 * k + 1.0)
        msh = make(COMM, [low, high], [3] * d, kind)
        facets = mesh.locate_entities_boundary(msh, d - 1, lambda x: np.isclose(x[0], low[0]))  # noqa: B023
        tags = mesh.meshtags(msh, d - 1, np.sort(facets), np.full(len(facets), 7, dtype=np.int32))
        parts[name] = ff.NamedMesh(msh, None, tags, {"face": (d - 1, (7,))} if k else {})
    model = ff.join_meshes(parts, COMM)
    assert set(model.groups) == {"one", "one/0", "one/7", "two", "two/0", "two/face"}
    for name in ("one/7", "two/face"):
        assert length(model, name) == pytest.approx(1.0, rel=1e-12)
    assert area(model, "two") == pytest.approx(1.0, rel=1e-12)
    x = model.mesh.geometry.x
    ends = [COMM.allreduce(np.max(x, initial=-9.0), MPI.MAX)]
    assert ends == [3.0]


@pytest.mark.mpi
def test_files_and_scales(tmp_path):
    path = COMM.bcast(tmp_path) / "plate.msh"
    if COMM.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Verbosity", 2)
        plate((0, 0), (2000, 1000), 300)
        gmsh.write(str(path))
        gmsh.finalize()
    COMM.barrier()
    part = ff.read_gmsh(path, COMM, scale=1e-3)
    assert area(part, "steel") == pytest.approx(2.0, rel=1e-12)
    assert part.surface("top").name == "top"
    with pytest.raises(ff.ContactInputError, match=r"no group of facets named 'tops'.*'bottom'"):
        part.surface("tops")
    with pytest.raises(ff.ContactInputError, match=r"no group of cells named 'top'.*'steel'"):
        part.cells("top")
    with pytest.raises(ff.ContactInputError, match="no such file"):
        ff.read_gmsh(path.with_name("other.msh"), COMM)


def test_what_cannot_be_joined():
    square = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    quads = mesh.create_unit_square(MPI.COMM_SELF, 1, 1, mesh.CellType.quadrilateral)
    with pytest.raises(ff.ContactInputError, match="different cells"):
        ff.join_meshes({"a": square, "b": quads}, MPI.COMM_SELF)
    with pytest.raises(ff.ContactInputError, match="at least one"):
        ff.join_meshes({})
    with pytest.raises(ff.ContactInputError, match="part 'a'"):
        ff.join_meshes({"a": 3}, MPI.COMM_SELF)


def renamed(model, old, tag, new):
    """Give a curve group another name."""
    model.removePhysicalName(old)
    model.setPhysicalName(1, tag, new)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.addPhysicalGroup(1, [1, 2], name="both"), "curve 1 .* 'bottom' and 'both'"),
        (lambda m: renamed(m, "bottom", 11, "steel"), "both called 'steel'"),
    ],
)
def test_groups_that_a_mesh_cannot_hold(change, message):
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    try:
        plate((0, 0), (1, 1), 0.5)
        change(gmsh.model)
        with pytest.raises(ff.ContactInputError, match=message):
            ff.read_gmsh(gmsh.model, MPI.COMM_SELF)
        with pytest.raises(ff.ContactInputError, match="name of a file"):
            ff.read_gmsh(3, MPI.COMM_SELF)
    finally:
        gmsh.finalize()


def test_groups_without_names_are_numbered():
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    try:
        plate((0, 0), (1, 1), 0.5)
        gmsh.model.removePhysicalName("top")
        part = ff.read_gmsh(gmsh.model, MPI.COMM_SELF)
    finally:
        gmsh.finalize()
    assert set(part.groups) == {"steel", "bottom", "right", "left", "curve 13"}
    assert len(part.facets("curve 13")) > 0


@pytest.mark.mpi
def test_meshes_that_are_whole_on_each_rank():
    """Those of the first rank count; a body is called without '/'."""
    parts = {name: mesh.create_unit_square(MPI.COMM_SELF, 2, 2) for name in ("a", "b")}
    model = ff.join_meshes(parts, COMM)
    assert area(model, "a") == pytest.approx(1.0, rel=1e-12)
    with pytest.raises(ff.ContactInputError, match="without '/'"):
        ff.join_meshes({"a/b": parts["a"]}, COMM)
