# SPDX-License-Identifier: MIT
"""The contact surface: tagged facets, their submesh, multiplier space, nodes and nodal areas."""

from collections.abc import Callable

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la, mesh
from ufl.core.expr import Expr

from ..base.compat import exterior_facet_entities
from ..base.compilation import compiled
from ..base.errors import ContactInputError
from ..base.validators import text
from .elements import check_mesh, is_global
from .facets import checked_facets

#: Collocation at the vertices: each contact equation involves one node only.
VERTEX_RULE = {"quadrature_rule": "vertex", "quadrature_degree": 1}


class ContactSurface:
    """Facets of a mesh that may come into contact.

    Contact is collocated at the vertices: the multipliers are continuous P1/Q1 tractions on the
    submesh of the facets, and the vertex quadrature rule makes every row node-local.

    Args:
        msh: Mesh of the body (2D or 3D); its cells may be curved.
        facet_tags: Facet tags of ``msh``.
        tag: The tag of the contact facets.
        name: Name used in messages and reports.

    Attributes:
        mesh: The mesh of the body.
        submesh: The mesh of the contact facets.
        entity_map: Relates ``submesh`` to ``mesh``.
        entities: (cell, local facet) pairs integrated on this rank.
        Q: Multiplier space: P1 vectors ``(c_n, c_1[, c_2])`` on the submesh, Pa.
        S: Scalar P1 space on the submesh.
        area: Nodal areas (m² in 3D, m per unit depth in 2D), Function in ``S``.

    Raises:
        ContactInputError: If the tag marks no facet, or facets that are not on the boundary, if
            the tags are those of another mesh, or if contact cannot be solved on the mesh.
    """

    def __init__(
        self, msh: mesh.Mesh, facet_tags: mesh.MeshTags, tag: int, name: str = "contact"
    ) -> None:
        self.mesh, self.name = check_mesh(msh), text(name, "The name of a contact surface")
        facets = checked_facets(msh, facet_tags, tag, name)
        self.submesh, self.entity_map, self._vertex_map, _ = mesh.create_submesh(
            msh, msh.topology.dim - 1, facets
        )
        self.entities = exterior_facet_entities(msh, facets)
        cell = self.submesh.basix_cell()
        scalar = basix.ufl.element("Lagrange", cell, 1)
        self.S = fem.functionspace(self.submesh, scalar)
        self.Q = fem.functionspace(
            self.submesh, basix.ufl.blocked_element(scalar, shape=(msh.geometry.dim,))
        )
        self._parent_dofs: list[tuple[fem.FunctionSpace, npt.NDArray[np.int32]]] = []
        self.area = fem.Function(self.S, name="area")
        self.area.x.array[:] = self._assemble(
            ufl.TestFunction(self.S) * self.measure(), self.S
        ).reshape(-1)
        self._check_area()

    def _check_area(self) -> None:
        """Raise on all ranks unless every node has an area; collective."""
        empty = self.x[~(self.area.x.array[: self.num_owned] > 0.0)]
        found = [part for part in self.mesh.comm.allgather(empty.tolist()) if part]
        if found:
            where = ", ".join(f"{value:.6g}" for value in found[0][0])
            raise ContactInputError(
                f"Contact surface '{self.name}': the facets at node ({where}) have no area; mend "
                "the mesh, whose nodes coincide there."
            )

    def measure(self, data: list | None = None, tag: int = 1) -> ufl.Measure:
        """Return the collocation measure on the parent mesh (entity ids of ``data``)."""
        data = [(1, self.entities)] if data is None else data
        ds = ufl.Measure("ds", domain=self.mesh, subdomain_data=data, metadata=VERTEX_RULE)
        return ds(tag)

    @property
    def num_owned(self) -> int:
        """Number of contact nodes owned by this rank."""
        return int(self.S.dofmap.index_map.size_local)

    @property
    def x(self) -> npt.NDArray[np.floating]:
        """Reference coordinates (m) of the owned nodes, one row a node."""
        return self.S.tabulate_dof_coordinates()[: self.num_owned]

    @property
    def nodes(self) -> npt.NDArray[np.int64]:
        """Global numbers of the owned contact nodes."""
        return np.arange(*self.S.dofmap.index_map.local_range)

    def evaluator(self, expression: Expr) -> "NodalExpression":
        """Return an object that evaluates a UFL expression at the contact nodes."""
        return NodalExpression(self, expression)

    def reader(self, f: fem.Function) -> Callable[[], npt.NDArray[np.floating]] | None:
        """Return what reads a Function at the nodes, ``None`` without values there."""
        V = f.function_space
        if is_global(V):
            return lambda: np.tile(f.x.array, (self.num_owned, 1))
        if not (is_nodal(V) if V.mesh is self.submesh else has_vertex_dofs(V)):
            return None
        if V.mesh is not self.submesh and V.mesh is not self.mesh:
            return None
        dofs, bs = self.parent_dofs(V)[: self.num_owned], V.dofmap.index_map_bs
        return lambda: f.x.array.reshape(-1, bs)[dofs]

    def _assemble(self, form: ufl.Form, space: fem.FunctionSpace) -> npt.NDArray[np.floating]:
        """Assemble a linear form on the submesh; return owned and ghost values."""
        compiled_form = compiled(fem.form, self.mesh.comm)(form, entity_maps=[self.entity_map])
        vector = fem.assemble_vector(compiled_form)
        return _accumulate(vector, space.dofmap.index_map_bs)

    def parent_dofs(self, V: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """Return, for each local contact node, the (blocked) dof of ``V`` at its vertex.

        Raises:
            ContactInputError: If ``V`` is not a Lagrange space with a dof at every vertex.
        """
        for space, dofs in self._parent_dofs:
            if space is V:
                return dofs
        if V.mesh is self.submesh and is_nodal(V):
            return self._own_dofs(V)
        if V.mesh is not self.mesh or not has_vertex_dofs(V):
            raise ContactInputError(
                f"Contact surface '{self.name}': the displacement space needs exactly one "
                f"(blocked) dof at each vertex, its element {V.ufl_element()} has "
                f"{len(V.dofmap.dof_layout.entity_dofs(0, 0))}. Use a continuous Lagrange space of "
                "vectors."
            )
        dofs = self._find_parent_dofs(V)
        self._parent_dofs.append((V, dofs))
        return dofs

    def _own_dofs(self, V: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """Return the dof of a nodal space of the submesh at each local node."""
        dofs = np.zeros(len(self.area.x.array), dtype=np.int32)
        dofs[self.S.dofmap.list] = V.dofmap.list
        return dofs

    def _find_parent_dofs(self, V: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """Find the dofs at the vertices, by any cell that has the vertex."""
        topology, tdim = self.mesh.topology, self.mesh.topology.dim
        topology.create_connectivity(0, tdim)
        vertex_cells, cells = topology.connectivity(0, tdim), topology.connectivity(tdim, 0)
        corners = cells.array.reshape(-1, len(basix.geometry(self.mesh.basix_cell())))
        facets = self.submesh.topology.connectivity(tdim - 1, 0)
        shape = self.S.dofmap.list.shape
        number = int(facets.array.max(initial=-1)) + 1
        parent = self._vertex_map.sub_topology_to_topology(
            np.arange(number, dtype=np.int32), inverse=False
        )
        vertices = parent[facets.array[: np.prod(shape)].reshape(shape)]
        cell = vertex_cells.array[vertex_cells.offsets[vertices]]
        local = np.argmax(corners[cell] == vertices[..., None], axis=-1)
        layout = [V.dofmap.dof_layout.entity_dofs(0, i)[0] for i in range(corners.shape[1])]
        dofs = np.full(self.S.dofmap.index_map.size_local + self.S.dofmap.index_map.num_ghosts, -1)
        dofs[self.S.dofmap.list] = V.dofmap.list[cell, np.array(layout)[local]]
        return dofs.astype(np.int32)


class NodalExpression:
    """Evaluates a UFL expression at the nodes of a contact surface, by collocation.

    The integral of ``expression * q`` with the vertex rule is area times nodal value.

    Args:
        surface: The contact surface.
        expression: UFL scalar or vector over the parent mesh and the submesh.
    """

    def __init__(self, surface: ContactSurface, expression: Expr) -> None:
        self._surface = surface
        shape = expression.ufl_shape
        cell = surface.submesh.basix_cell()
        element = basix.ufl.element("Lagrange", cell, 1, shape=shape)
        self._space = fem.functionspace(surface.submesh, element)
        q = ufl.TestFunction(self._space)
        self._form = compiled(fem.form, surface.mesh.comm)(
            ufl.inner(expression, q) * surface.measure(), entity_maps=[surface.entity_map]
        )

    def __call__(self) -> npt.NDArray[np.floating]:
        """Return the values at the owned nodes, one row a node."""
        n = self._surface.num_owned
        values = _accumulate(fem.assemble_vector(self._form), self._space.dofmap.index_map_bs)
        return values[:n] / self._surface.area.x.array[:n, None]


def has_vertex_dofs(V: fem.FunctionSpace) -> bool:
    """Tell whether a space, not a part of one, has one (blocked) dof at each vertex: its value."""
    whole = len(V.component()) == 0
    at_vertex = len(V.dofmap.dof_layout.entity_dofs(0, 0)) == 1
    return whole and at_vertex and V.dofmap.index_map_bs == np.prod(V.value_shape, dtype=int)


def is_nodal(V: fem.FunctionSpace) -> bool:
    """Tell whether a space has dofs at the vertices only."""
    corners = len(basix.geometry(V.mesh.basix_cell()))
    return has_vertex_dofs(V) and V.dofmap.dof_layout.num_dofs == corners


def _accumulate(vector: la.Vector, bs: int) -> npt.NDArray[np.floating]:
    """Add ghost contributions to their owners and return all values, one row a node."""
    vector.scatter_reverse(la.InsertMode.add)
    vector.scatter_forward()
    return vector.array.reshape(-1, bs).copy()
