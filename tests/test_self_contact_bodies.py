"""Bodies of one surface that meet in several places: as the same ones with two surfaces a place."""

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from dolfinx.la import InsertMode

import fenicsx_friction as ff
from bodies import box, joined
from fenicsx_friction.obstacles import against_faces, roles
from folds import stored

QUADS = "quadrilateral"
GAP = 1e-4


def near(a, b):
    return np.abs(a - b) < 1e-9


class Bodies:
    """Bodies, some of whose nodes are moved.

    Args:
        msh: The bodies.
        prefix: Of the PETSc options.
        held: A marker of each set of nodes that is moved.
        faces: Markers of the faces of pairs: secondary, primary, secondary, ...; ``None`` for one
            surface that meets itself.
    """

    def __init__(self, msh, prefix, held, faces=None):
        msh.topology.create_connectivity(1, 2)
        facets = np.sort(mesh.exterior_facet_indices(msh.topology))
        middle = mesh.compute_midpoints(msh, 1, facets).T
        values = np.ones(len(facets), dtype=np.int32)
        for tag, marker in enumerate(faces or [], 2):
            values[marker(middle)] = tag
        tags = mesh.meshtags(msh, 1, facets, values)
        V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        u, v = fem.Function(V), ufl.TestFunction(V)
        springs = 1e-3 * ufl.inner(u, v) * ufl.dx(metadata={"quadrature_degree": 2})
        self.residual = ufl.derivative(stored(u), u, v) + springs
        self.dofs = {k: fem.locate_dofs_geometrical(V, marker) for k, marker in held.items()}
        self.moved = {k: fem.Function(V) for k in held}
        bcs = [fem.dirichletbc(self.moved[k], self.dofs[k]) for k in held]

        def face(tag):
            return ff.ContactSurface(msh, tags, tag, f"face{tag}")

        if faces is None:
            contacts = [ff.Contact(face(1), ff.SelfContact(), ff.Coulomb(0.3))]
        else:
            contacts = [
                ff.Contact(
                    face(tag),
                    ff.DeformableObstacle(face(tag + 1), method="node-to-face"),
                    ff.Coulomb(0.3),
                )
                for tag in range(2, 2 + len(faces), 2)
            ]
        self.problem = ff.FrictionalContactProblem(
            self.residual, u, bcs=bcs, contact=contacts, petsc_options_prefix=prefix
        )

    def solve(self, **ways):
        """Move sets of nodes; returns the report."""
        for name, way in ways.items():
            f = self.moved[name]
            f.x.array[:] = np.tile(way, len(f.x.array) // 2)
        report = self.problem.solve()
        assert report.certified
        return report

    def force(self, name):
        """Return the force on a set of nodes."""
        b = fem.assemble_vector(fem.form(self.residual))
        b.scatter_reverse(InsertMode.add)
        n = b.index_map.size_local
        own = self.dofs[name][self.dofs[name] < n]
        total = b.array.reshape(-1, 2)[own].sum(axis=0)
        return MPI.COMM_WORLD.allreduce(total)


def cut(msh, keep, move=None):
    """Return the cells of a mesh on MPI.COMM_SELF whose centers are kept, with nodes moved."""
    x, cells = msh.geometry.x[:, :2].copy(), msh.geometry.dofmaps[0]
    cells = cells[keep(*x[cells].mean(axis=1).T)]
    used = np.unique(cells)
    number = np.full(len(x), -1)
    number[used] = np.arange(len(used))
    x, cells = x[used], number[cells].astype(np.int64)
    x = x if move is None else move(x)
    domain = basix.ufl.element("Lagrange", QUADS, 1, shape=(2,))
    return mesh.create_mesh(MPI.COMM_SELF, cells, domain, x)


def bricks(prefix, *, one):
    """M is pressed sideways on L by its edge, and A on the top of M, beside that edge."""
    M = box([0.0, 0.0], [1.2, 0.8], [3, 4], QUADS)
    A = box([0.02, 0.8 + GAP], [0.18, 1.2 + GAP], [2, 2], QUADS)
    L = box([-0.8 - GAP, 0.0], [-GAP, 1.0], [2, 2], QUADS)
    held = {
        "M": lambda x: near(x[0], 1.2),
        "L": lambda x: near(x[0], -0.8 - GAP),
        "A": lambda x: near(x[1], 1.2 + GAP),
    }
    faces = [
        lambda x: near(x[1], 0.8 + GAP),
        lambda x: near(x[1], 0.8) & (x[0] > 0.0),
        lambda x: near(x[0], 0.0),
        lambda x: near(x[0], -GAP),
    ]
    return Bodies(joined(MPI.COMM_WORLD, M, L, A), prefix, held, None if one else faces)


@pytest.mark.mpi
def test_a_body_is_met_beside_an_edge_that_meets_another_one():
    """The edge of M is secondary on L; this says nothing about A, which stands beside it."""
    one, two = bricks("brick_one_", one=True), bricks("brick_two_", one=False)
    for depth in (0.0, 0.004, 0.008, 0.02):
        one.solve(L=(0.02, 0.0), A=(0.0, -depth))
        two.solve(L=(0.02, 0.0), A=(0.0, -depth))
        for name in "MLA":
            assert one.force(name) == pytest.approx(two.force(name), abs=1e-8)
    assert two.force("A")[1] < -0.4


def test_the_report_has_the_squeeze_that_cancels_in_the_force():
    """All that presses A, and all that presses M on L, whichever of them is secondary."""
    one, two = bricks("squeeze_one_", one=True), bricks("squeeze_two_", one=False)
    (whole,) = one.solve(L=(0.02, 0.0), A=(0.0, -0.02)).contacts
    parts = two.solve(L=(0.02, 0.0), A=(0.0, -0.02)).contacts
    assert whole.normal_force == pytest.approx(sum(k.normal_force for k in parts), rel=1e-8)
    assert parts[0].normal_force == pytest.approx(parts[0].force[1], rel=0.02)


def test_prongs_that_were_beside_each_other_meet_end_to_end():
    """At first each prong's end is behind that of the other one, with free space between."""
    plate = mesh.create_rectangle(
        MPI.COMM_SELF, [[-0.3, -0.8], [1.5, 0.5]], [18, 13], mesh.CellType.quadrilateral
    )

    def keep(x, y):
        lower = (x < 0.0) & (y < 0.2) | (x < 0.6) & (y > 0.0) & (y < 0.2)
        return lower | (y < -0.6) | (x > 1.2) | (x > 0.5) & (y > 0.3)

    clip = Bodies(
        joined(MPI.COMM_WORLD, cut(plate, keep)),
        "clip_",
        {
            "lower": lambda x: near(x[0], 0.3) & (x[1] > -0.01) & (x[1] < 0.21),
            "upper": lambda x: near(x[0], 1.3) & (x[1] > 0.29),
        },
    )
    for way in [(0.1, 0.0), (0.2, 0.0), (0.2, -0.15), (0.2, -0.3), (0.11, -0.3)]:
        assert clip.solve(upper=way).contacts[0].open == 104
    for way in (0.1, 0.08, 0.05):
        report = clip.solve(upper=(way, -0.3))
    assert report.contacts[0].normal_force > 0.5
    # The ends as two surfaces give 1.0633.
    assert clip.force("lower") == pytest.approx([1.063, 0.047], abs=2e-3)


@pytest.mark.parametrize("thickness", [0.05, 0.004], ids=["half a face", "a twentieth"])
def test_thin_sheets_on_each_other_are_not_inside_each_other(thickness):
    """How far bodies may overlap at the start is more than the thickness of the sheets."""
    t, gap = thickness, 4e-4
    low, high = 0.4 + gap, 0.4 + 2.0 * gap + t
    block = box([0.0, 0.0], [0.8, 0.4], [6, 3], QUADS)
    levels = zip((16, 17), (low, high), strict=True)
    sheets = [box([-0.4, z], [1.2, z + t], [n, 2], QUADS) for n, z in levels]
    held = {
        "block": lambda x: near(x[1], 0.0),
        "left": lambda x: near(x[0], -0.4),
        "right": lambda x: near(x[0], 1.2),
    }
    model = Bodies(joined(MPI.COMM_WORLD, block, *sheets), f"sheets_{t}_", held)
    for depth in (0.02, 0.04):
        report = model.solve(left=(0.0, -depth), right=(0.0, -depth))
    assert report.contacts[0].normal_force > 0.0
    total = sum(model.force(name)[1] for name in held)
    assert abs(total) < 1e-3 * model.force("block")[1]


@pytest.mark.parametrize("touch", [1e-5, 1e-4])
def test_a_node_that_only_touches_a_flank_does_not_hold_the_tip(touch, monkeypatch):
    """The tip of a wedge goes 0.3 of a face deep between nodes of a block."""

    def dip(by, name):
        block = box([-0.5, GAP], [0.5, 0.5], [10, 5], QUADS)
        wedge = box([-0.47, -1.0], [0.53, 0.0], [8, 4], QUADS)
        x = wedge.geometry.x
        x[:, 1] -= (1.0 + x[:, 1]) * abs(x[:, 0] - 0.03)
        held = {
            "block": lambda x: near(x[1], 0.5),
            "wedge": lambda x: x[1] <= 0.0,
        }
        model = Bodies(joined(MPI.COMM_WORLD, block, wedge), name, held)
        return model.solve(block=(0.0, -GAP - 0.03 - by)).contacts[0].normal_force

    with pytest.raises(ff.StepFailed, match="1 nodes of 'face1' went through"):
        dip(touch, "touch_")
    monkeypatch.setattr(against_faces, "SHARPER", 1e30)
    assert dip(touch, "net_") < 0.01  # a certificate for next to no force


def posts(prefix, *, one):
    """A fine block on a coarse one on the left; a fine post under its coarse end on the right."""

    def grid(xs, ys):
        x = np.array([[x, y] for x in xs for y in ys])
        i, j = np.meshgrid(np.arange(len(xs) - 1), np.arange(len(ys) - 1), indexing="ij")
        here = (i * len(ys) + j).ravel()
        cells = np.column_stack([here, here + 1, here + len(ys), here + len(ys) + 1])
        domain = basix.ufl.element("Lagrange", QUADS, 1, shape=(2,))
        return mesh.create_mesh(MPI.COMM_SELF, cells, domain, x)

    gap, low = 1e-3, 2e-3

    def keep(x, y):
        return (y < -0.15) | (x < 0.8) | (x > 1.35) & (x < 1.45)

    def lowered(x):
        x[(x[:, 0] > 1.0) & near(x[:, 1], 0.0), 1] -= low
        return x

    xs = [0.0, 0.4, *np.round(np.linspace(0.8, 2.0, 25), 3)]
    B = cut(grid(xs, [-0.4, -0.25, -0.15, -0.1, -0.05, 0.0]), keep, lowered)
    A = grid([*np.linspace(0.0, 0.8, 9), 1.2, 1.6, 2.0], [gap, gap + 0.15, gap + 0.3])
    held = {"B": lambda x: near(x[1], -0.4), "A": lambda x: near(x[1], gap + 0.3)}
    faces = [
        lambda x: near(x[1], gap) & (x[0] < 0.8),
        lambda x: near(x[1], 0.0) & (x[0] < 0.8),
        lambda x: near(x[1], -low),
        lambda x: near(x[1], gap) & (x[0] > 0.8),
    ]
    return Bodies(joined(MPI.COMM_WORLD, B, A), prefix, held, None if one else faces)


def test_the_finer_body_is_that_which_is_finer_where_they_meet():
    one, two = posts("posts_one_", one=True), posts("posts_two_", one=False)
    for model in (one, two):
        model.solve(A=(0.0, -0.003))
    assert one.force("A") == pytest.approx(two.force("A"), abs=0.01 * abs(two.force("A")[1]))


def test_far_faces_would_make_the_coarser_one_secondary(monkeypatch):
    monkeypatch.setattr(roles, "CLOSE", 1e9)
    with pytest.raises((AssertionError, ff.StepFailed)):
        test_the_finer_body_is_that_which_is_finer_where_they_meet()


@pytest.mark.mpi
def test_faces_that_meet_in_two_contacts_are_refused():
    msh = joined(
        MPI.COMM_WORLD,
        box([0.0, 0.0], [1.0, 1.0], [2, 2], QUADS),
        box([0.0, 1.1], [1.0, 2.1], [2, 2], QUADS),
    )
    msh.topology.create_connectivity(1, 2)
    facets = np.sort(mesh.exterior_facet_indices(msh.topology))
    middle = mesh.compute_midpoints(msh, 1, facets)[:, 1]
    skin = mesh.meshtags(msh, 1, facets, np.ones_like(facets))
    sides = mesh.meshtags(msh, 1, facets, (1 + near(middle, 1.0) + 2 * near(middle, 1.1)))
    u = fem.Function(fem.functionspace(msh, ("Lagrange", 1, (2,))))
    low, high = (
        ff.ContactSurface(msh, sides, tag, name) for tag, name in ((2, "low"), (3, "high"))
    )
    whole = ff.ContactSurface(msh, skin, 1, "skin")
    itself = ff.Contact(whole, ff.SelfContact(), ff.Coulomb(0.3))
    pair, back = (
        ff.Contact(a, ff.DeformableObstacle(b, method=method), ff.Coulomb(0.3))
        for a, b, method in ((low, high, "node-to-face"), (high, low, "mortar"))
    )
    for contacts in ([itself, pair], [pair, back], [pair, itself]):
        with pytest.raises(ff.ContactInputError, match="faces of the same two surfaces"):
            ff.FrictionalContactProblem(
                ufl.derivative(stored(u), u, ufl.TestFunction(u.function_space)),
                u,
                contact=contacts,
                petsc_options_prefix="twice_",
            )


# -- cracks ---------------------------------------------------------------------------------------

TURN = 0.3


def cracked(prefix, *, one):
    """A turned block with a closed crack from its left side to its middle, whose lips touch."""
    block = box([0.0, 0.0], [1.0, 1.0], [8, 8], QUADS)
    x, cells = block.geometry.x[:, :2], block.geometry.dofmaps[0].astype(np.int64)
    lip = np.flatnonzero(near(x[:, 1], 0.5) & (x[:, 0] < 0.45))
    number = np.arange(len(x))
    number[lip] = len(x) + np.arange(len(lip))
    above = x[cells].mean(axis=1)[:, 1] > 0.5
    cells[above] = number[cells[above]]
    c, s = np.cos(TURN), np.sin(TURN)
    turn = np.array([[c, -s], [s, c]])
    x = np.concatenate([x, x[lip]]) @ turn.T
    if MPI.COMM_WORLD.rank > 0:
        x, cells = x[:0], cells[:0]
    domain = basix.ufl.element("Lagrange", QUADS, 1, shape=(2,))
    msh = mesh.create_mesh(MPI.COMM_WORLD, cells, domain, x)
    msh.topology.create_connectivity(1, 2)

    def at(y):
        return lambda x: near((turn.T @ x[:2])[1], y)

    held = {"bottom": at(0.0), "top": at(1.0)}
    if one:
        return Bodies(msh, prefix, held), turn
    facets = np.sort(mesh.exterior_facet_indices(msh.topology))
    cell = msh.topology.connectivity(1, 2)
    owner = np.array([cell.links(f)[0] for f in facets], dtype=np.int32)
    above = (turn.T @ mesh.compute_midpoints(msh, 2, owner)[:, :2].T)[1] > 0.5
    # The tip, which both lips have, meets nothing.
    lips = [
        lambda x: at(0.5)(x) & above & ((turn.T @ x[:2])[0] < 0.375),
        lambda x: at(0.5)(x) & ~above,
    ]
    return Bodies(msh, prefix, held, lips), turn


@pytest.mark.mpi
def test_a_closed_crack_is_one_surface_that_meets_itself():
    """Its lips are behind each other by rounding: this is no wall."""
    (one, turn), (two, _) = cracked("crack_one_", one=True), cracked("crack_two_", one=False)
    for way in [(0.0, -0.02), (0.03, -0.02), (-0.03, -0.02), (0.0, 0.02)]:
        reports = [model.solve(top=turn @ way) for model in (one, two)]
        forces = [model.force("top") for model in (one, two)]
        assert forces[0] == pytest.approx(forces[1], abs=2e-3 * np.linalg.norm(forces[1]))
        closed = [r.contacts[0].stick + r.contacts[0].slip for r in reports]
        assert (min(closed) >= 3) == (way[1] < 0.0)
