"""Problems whose state checkpoints keep: short runs, and problems without forms."""

from types import SimpleNamespace

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, mesh

import fenicsx_friction as ff
from models import raous, tagged_facets

STEPS = 6


# -- runs of six steps; step(k) makes step k, whatever was before --------------------------------


def raous_run(comm):
    """Load and unload the Raous rectangle; friction falls with the slipped way."""
    model = raous(
        12, 8, lambda p, s: 0.3 + 0.2 * ufl.exp(-s.path / 5e-6), "restart_", comm=comm, bbar=False
    )
    loads = [(0.2, 1.0), (0.6, 1.0), (1.0, 1.0), (0.5, 1.0), (0.0, 0.8), (0.7, 0.8)]

    def step(k):
        model.load(*loads[k - 1])
        return model.problem.solve()

    return model.problem, step


def block_run(comm):
    """Sweep a block of MINI tetrahedra in an L over a plane that moves and turns."""
    size = (1.2, 0.9, 0.5)
    msh = mesh.create_box(comm, [[0.0] * 3, size], (3, 2, 1))
    tags = tagged_facets(msh, lambda x: np.isclose(x[2], 0.0), lambda x: np.isclose(x[2], size[2]))
    parts = [basix.ufl.element(*e) for e in (("P", "tetrahedron", 1), ("Bubble", "tetrahedron", 4))]
    mini = basix.ufl.blocked_element(basix.ufl.enriched_element(parts), shape=(3,))
    V = fem.functionspace(msh, mini)
    u, v, top = fem.Function(V, name="u"), ufl.TestFunction(V), fem.Function(V)
    rubber = ff.bulk.Elastic(E=1000.0, nu=0.3)
    stored = ff.bulk.stored_energy(ff.bulk.small_strain_energy(u, rubber), ufl.dx)
    motion = ff.RigidMotion(msh, center=(0.5, 0.3, 0.0))
    contact = ff.Contact(
        ff.ContactSurface(msh, tags, 1),
        ff.RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), motion=motion),
        ff.Coulomb(lambda p, s: 0.3 + 0.2 * ufl.exp(-s.path / 1e-3)),
    )
    problem = ff.FrictionalContactProblem(
        ufl.derivative(stored, u, v),
        u,
        contact=contact,
        bcs=[fem.dirichletbc(top, fem.locate_dofs_topological(V, 2, tags.find(2)))],
        petsc_options_prefix="restart_block_",
    )
    sweep = [(0.0, 0.0), (2.0, 0.0), (12.0, 0.0), (12.0, 8.0), (12.0, 12.0), (8.0, 12.0)]

    def step(k):
        top.x.array[:] = np.tile([*(1e-3 * np.array(sweep[k - 1])), -0.01], len(top.x.array) // 3)
        motion.translation.value = [1e-3 * k, -5e-4 * k, 1e-4 * k]
        motion.angle.value = 2e-3 * k
        problem.dt.value = 0.1 * k
        return problem.solve()

    return problem, step


RUNS = {"raous": raous_run, "block": block_run}


# -- problems without forms: what a checkpoint sees of one -------------------------------------


def bare(msh, unknowns, surfaces=(), motions=()):
    """Return something with the state of a problem on ``msh``."""
    contacts = []
    for k, tag in enumerate(surfaces):
        tags = tagged_facets(msh, lambda x: np.isclose(x[0], 0.0), lambda x: np.isclose(x[0], 1.0))
        motion = ff.RigidMotion(msh) if k in motions else None
        d = msh.geometry.dim
        plane = ff.RigidPlane((0.0,) * d, (1.0,) * d, motion=motion)
        contacts.append(ff.Contact(ff.ContactSurface(msh, tags, tag), plane, ff.Frictionless()))
    functions = [fem.Function(fem.functionspace(msh, element)) for element in unknowns]
    return SimpleNamespace(
        comm=msh.comm,
        u=functions[0],
        unknowns=functions,
        rates=[fem.Function(f.function_space) for f in functions],
        u_old=fem.Function(functions[0].function_space),
        contacts=contacts,
        bodies=[],
        accepted=[],
        num_steps=0,
        dt=fem.Constant(msh, 1.0),
    )


def square(comm, n=6):
    return mesh.create_rectangle(comm, [[0.0, 0.0], [1.0, 1.0]], [n, n])


def two_bodies(comm):
    """Two squares of two triangles and coincident nodes, which nothing connects."""
    x = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 1], [1, 1], [1, 2], [0, 2.0]])
    cells = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    coordinate_element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    if comm.rank > 0:
        x, cells = x[:0], cells[:0]
    return mesh.create_mesh(comm, cells, coordinate_element, x)


def elements(msh):
    """Return the elements of some unknowns, displacement first."""
    cell, d = msh.basix_cell(), msh.geometry.dim
    P1, P2 = (basix.ufl.element("Lagrange", cell, k) for k in (1, 2))
    return [
        basix.ufl.blocked_element(P2, shape=(d,)),
        P1,
        basix.ufl.element("DG", cell, 1, shape=(2,)),
        basix.ufl.quadrature_element(msh.basix_cell(), degree=2),
        basix.ufl.mixed_element([basix.ufl.blocked_element(P2, shape=(d,)), P1]),
    ]


def paint(function):
    """Give each dof a value that depends on its place, its body and its component only."""
    V, msh = function.function_space, function.function_space.mesh
    corners = msh.geometry.x[msh.geometry.dofmaps[0]]
    middle = corners.mean(axis=1)
    body = np.floor(middle[:, 1] - 1e-9) if len(middle) else np.zeros(0)
    element = V.ufl_element()
    if element.family_name == "quadrature":
        places = element.custom_quadrature()[0] @ np.eye(msh.topology.dim)
        reference = [middle[:, None] + 0.1 * np.sum(places, axis=1)[None, :, None]]
        spaces = [(V.dofmap.list, reference[0], 1)]
    else:
        spaces = []
        parts = range(V.num_sub_spaces) if V.dofmap.bs == 1 and V.num_sub_spaces else [None]
        for part in parts:
            W, back = (V, None) if part is None else V.sub(part).collapse()
            x, bs = W.tabulate_dof_coordinates(), W.dofmap.bs
            dofs = W.dofmap.list
            if back is not None:
                x_of, back = x[dofs], np.asarray(back).reshape(-1, bs)
                for c in range(bs):
                    spaces.append((back[dofs, c], x_of + 10.0 * (part + 1), 1))
            else:
                spaces.append((dofs, x[dofs], bs))
    for dofs, x, bs in spaces:
        for c in range(bs):
            value = x @ [1.0, 17.0, 289.0] + 1e3 * (c + 1)
            function.x.array[dofs * bs + c] = value + 1e5 * body[:, None]
    function.x.scatter_forward()


def painted(problem):
    """Paint all functions of a problem and return those that a checkpoint keeps."""
    functions = [*problem.unknowns, problem.u_old]
    for contact in problem.contacts:
        functions += [contact.c, contact.path, contact.hint]
    for function in functions:
        paint(function)
    return functions


def parts(path):
    return list(path.parent.glob(f".{path.name}.*"))
