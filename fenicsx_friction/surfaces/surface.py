# SPDX-License-Identifier: MIT
"""The contact surface: tagged facets, their submesh, multiplier space, nodes and nodal areas."""

from __future__ import annotations

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
from ..base.validators import flag, integer, text
from ..laws.bulk import circumference
from .elements import check_mesh, is_global
from .facets import checked_facets
from .nodal_dofs import dofs_on_facets, has_quadratic_dofs, has_vertex_dofs
from .rings import ROUNDING, check_rings

#: Collocation at the nodes, by the degree of the surface: each contact equation involves one node
#: only. The Gauss-Lobatto points of degree 3 are the nodes of degree 2, with Simpson's weights.
RULES = {
    1: {"quadrature_rule": "vertex", "quadrature_degree": 1},
    2: {"quadrature_rule": "GLL", "quadrature_degree": 3},
}


class ContactSurface:
    """Facets of a mesh that may come into contact.

    Contact is collocated at the nodes: the multipliers are continuous tractions on the submesh of
    the facets, and a quadrature rule whose points are the nodes makes every row node-local. By
    default the nodes are the vertices.

    Args:
        msh: Mesh of the body (2D or 3D); its cells may be curved.
        facet_tags: Facet tags of ``msh``.
        tag: The tag of the contact facets.
        name: Name used in messages and reports.
        degree: 1 for nodes at the vertices; 2 for nodes at all dofs of a displacement of degree 2,
            on the edges of triangles and quadrilaterals and the faces of hexahedra, against rigid
            obstacles.
        axisymmetric: The mesh is a half-plane, x the radius and y the axis. Forces and areas are
            those of the full ring, as in residuals whose measures are multiplied by ``2 pi r``,
            see ``bulk.circumference``.

    Attributes:
        degree: As given.
        axisymmetric: As given.
        mesh: The mesh of the body.
        submesh: The mesh of the contact facets.
        entity_map: Relates ``submesh`` to ``mesh``.
        entities: (cell, local facet) pairs integrated on this rank.
        Q: Multiplier space: Lagrange vectors ``(c_n, c_1[, c_2])`` on the submesh, Pa.
        S: Scalar Lagrange space on the submesh, with one dof a node.
        area: Nodal areas (m² in 3D and of rings, m per unit depth in 2D), Function in ``S``.
        size: Area without the circumference of rings, Function in ``S``.

    Raises:
        ContactInputError: If the tag marks no facet, or facets that are not on the boundary, if
            the tags are those of another mesh, if contact cannot be solved on the mesh, or if
            shape functions of the degree have no weight at its vertices.
    """

    def __init__(
        self,
        msh: mesh.Mesh,
        facet_tags: mesh.MeshTags,
        tag: int,
        name: str = "contact",
        *,
        degree: int = 1,
        axisymmetric: bool = False,
    ) -> None:
        self.mesh, self.name = check_mesh(msh), text(name, "The name of a contact surface")
        self.degree = _checked_degree(degree, msh, name)
        facets = checked_facets(msh, facet_tags, tag, name)
        self.submesh, self.entity_map, self._vertex_map, _ = mesh.create_submesh(
            msh, msh.topology.dim - 1, facets
        )
        self.entities = exterior_facet_entities(msh, facets)
        self.S, self.Q = self.space(()), self.space((msh.geometry.dim,))
        self._parent_dofs: list[tuple[fem.FunctionSpace, npt.NDArray[np.int32]]] = []
        self.axisymmetric = flag(axisymmetric, f"Contact surface '{name}': axisymmetric")
        self.size = self._integral(self.measure())
        self.area = self.size
        if axisymmetric:
            check_rings(msh, name)
            self.area = self._integral(self.measure(exact=True), circumference(msh))
        self._check_area()

    def _integral(self, measure: ufl.Measure, weight: Expr | float = 1.0) -> fem.Function:
        """Return the integrals of the shape functions of the nodes."""
        result = fem.Function(self.S, name="area")
        form = weight * ufl.TestFunction(self.S) * measure
        result.x.array[:] = self._assemble(form, self.S).ravel()
        return result

    def _check_area(self) -> None:
        """Raise on all ranks unless every node has an area; collective."""
        least = ROUNDING * self.size.x.array[: self.num_owned]
        empty = self.x[~(self.area.x.array[: self.num_owned] > least)]
        found = [part for part in self.mesh.comm.allgather(empty.tolist()) if part]
        if found:
            where = ", ".join(f"{value:.6g}" for value in found[0][0])
            raise ContactInputError(
                f"Contact surface '{self.name}': the facets at node ({where}) have no area; "
                + (
                    "rings of degree 2 have none on the axis: leave degree = 1."
                    if self.axisymmetric
                    else "mend the mesh, whose nodes coincide there."
                )
            )

    def space(self, shape: tuple[int, ...]) -> fem.FunctionSpace:
        """Return the space of arrays of numbers at the nodes."""
        cell = self.submesh.basix_cell()
        element = basix.ufl.element("Lagrange", cell, self.degree, shape=shape)
        return fem.functionspace(self.submesh, element)

    def measure(self, *, exact: bool = False) -> ufl.Measure:
        """Return the measure on the parent mesh: of collocation, or an exact one."""
        rule = {} if exact else RULES[self.degree]
        data = [(1, self.entities)]
        return ufl.Measure("ds", domain=self.mesh, subdomain_data=data, metadata=rule)(1)

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

    def evaluator(self, expression: Expr) -> NodalExpression:
        """Return an object that evaluates a UFL expression at the contact nodes."""
        return NodalExpression(self, expression)

    def reader(self, f: fem.Function) -> Callable[[], npt.NDArray[np.floating]] | None:
        """Return what reads a Function at the nodes, ``None`` without values there."""
        V, n = f.function_space, self.num_owned
        if is_global(V):
            return lambda: np.tile(f.x.array, (n, 1))
        if not self.has_values_of(V):
            return None
        dofs, rows = self.parent_dofs(V)[:n], f.x.array.reshape(-1, V.dofmap.index_map_bs)
        return lambda: rows[dofs]  # a view of the values, which is read very often

    def _assemble(self, form: ufl.Form, space: fem.FunctionSpace) -> npt.NDArray[np.floating]:
        """Assemble a linear form on the submesh; return owned and ghost values."""
        compiled_form = compiled(fem.form, self.mesh.comm)(form, entity_maps=[self.entity_map])
        vector = fem.assemble_vector(compiled_form)
        return _accumulate(vector, space.dofmap.index_map_bs)

    def has_values_of(self, V: fem.FunctionSpace) -> bool:
        """Tell whether a space has its value at each node as one (blocked) dof."""
        if V.mesh is self.submesh:
            same = V.dofmap.dof_layout.num_dofs == self.S.dofmap.dof_layout.num_dofs
            dim = self.submesh.topology.dim
        else:
            same, dim = V.mesh is self.mesh, self.mesh.topology.dim - 1
        return same and (has_vertex_dofs(V) if self.degree == 1 else has_quadratic_dofs(V, dim))

    def parent_dofs(self, V: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """Return, for each local contact node, the (blocked) dof of ``V`` there.

        Raises:
            ContactInputError: If ``V`` is not a Lagrange space with a dof at every node.
        """
        for space, dofs in self._parent_dofs:
            if space is V:
                return dofs
        if not self.has_values_of(V):
            raise ContactInputError(
                f"Contact surface '{self.name}': the displacement space needs exactly one "
                f"(blocked) dof at each {'vertex' if self.degree == 1 else 'node'}, its element is "
                f"{V.ufl_element()}. Use a continuous Lagrange space of vectors"
                f"{'' if self.degree == 1 else f' of degree {self.degree}'}."
            )
        dofs = np.full(len(self.area.x.array), -1, dtype=np.int32)
        if V.mesh is self.submesh:
            dofs[self.S.dofmap.list] = V.dofmap.list
            return dofs
        dofs[self.S.dofmap.list] = dofs_on_facets(V, self.S, self.entity_map, self._vertex_map)
        self._parent_dofs.append((V, dofs))
        return dofs


class NodalExpression:
    """Evaluates a UFL expression at the nodes of a contact surface, by collocation.

    The integral of ``expression * q`` with the points of the nodes is area times nodal value.

    Args:
        surface: The contact surface.
        expression: UFL scalar or vector over the parent mesh and the submesh.
    """

    def __init__(self, surface: ContactSurface, expression: Expr) -> None:
        self._surface = surface
        self._space = surface.space(expression.ufl_shape)
        q = ufl.TestFunction(self._space)
        self._form = compiled(fem.form, surface.mesh.comm)(
            ufl.inner(expression, q) * surface.measure(), entity_maps=[surface.entity_map]
        )

    def __call__(self) -> npt.NDArray[np.floating]:
        """Return the values at the owned nodes, one row a node."""
        n = self._surface.num_owned
        values = _accumulate(fem.assemble_vector(self._form), self._space.dofmap.index_map_bs)
        return values[:n] / self._surface.size.x.array[:n, None]


def _checked_degree(degree: int, msh: mesh.Mesh, name: str) -> int:
    """Return the degree of a surface, or raise."""
    integer(degree, f"Contact surface '{name}': degree")
    if degree not in RULES:
        raise ContactInputError(
            f"Contact surface '{name}': degree = {degree} must be 1 (nodes at the vertices) or 2 "
            "(at all nodes of a displacement of degree 2)."
        )
    if degree > 1 and msh.basix_cell() == basix.CellType.tetrahedron:
        raise ContactInputError(
            f"Contact surface '{name}': degree = {degree} on the triangles of tetrahedra: there "
            "the integrals of the vertices' shape functions are zero, so that no forces at the "
            "nodes balance a pressure. Leave degree = 1, or take hexahedra."
        )
    return degree


def _accumulate(vector: la.Vector, bs: int) -> npt.NDArray[np.floating]:
    """Add ghost contributions to their owners and return all values, one row a node."""
    vector.scatter_reverse(la.InsertMode.add)
    vector.scatter_forward()
    return vector.array.reshape(-1, bs).copy()
