# SPDX-License-Identifier: MIT
"""Which meshes and displacement elements contact is exact for, and how it acts on them."""

from typing import Any

import basix
import numpy as np
from dolfinx import fem, mesh

from ..base.errors import ContactInputError
from ..base.validators import instance

#: Cells whose facets are of one kind, with a nodal contact element.
CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
WORKS = (
    "What works are vectors of continuous Lagrange elements of any degree, and MINI (P1 with a "
    'bubble): fem.functionspace(mesh, ("Lagrange", k, (gdim,))), or a basix.ufl.blocked_element '
    "of the scalar element."
)


def check_mesh(msh: Any) -> mesh.Mesh:
    """Return the mesh if contact can be solved on it, or raise a ContactInputError."""
    instance(msh, mesh.Mesh, "The mesh", "a dolfinx.mesh.Mesh")
    tdim, gdim = msh.topology.dim, msh.geometry.dim
    kinds = [cell.name for cell in msh.topology.entity_types[tdim]]
    if len(kinds) != 1 or kinds[0] not in CELLS:
        raise ContactInputError(
            f"The mesh has cells of kind {', '.join(kinds)}; contact needs cells of one kind out "
            f"of {', '.join(CELLS)}."
        )
    if gdim != tdim:
        raise ContactInputError(
            f"The mesh is of dimension {tdim} in a space of dimension {gdim}; contact needs solid "
            f"bodies: make it with points of {tdim} coordinates."
        )
    if msh.geometry.x.dtype != np.float64:
        raise ContactInputError(
            f"The mesh has coordinates of type {msh.geometry.x.dtype}; make it with dtype=float64."
        )
    return msh


def check_displacement(u: fem.Function) -> None:
    """Raise a ContactInputError unless contact is exact for the displacement.

    The scalar element must be continuous, with one dof at each vertex, the value there.
    """
    V = u.function_space
    gdim = check_mesh(V.mesh).geometry.dim
    if u.x.array.dtype != np.float64:
        raise ContactInputError(
            f"The displacement has values of type {u.x.array.dtype}; make it with dtype=float64 "
            "(and a real build of PETSc)."
        )
    if V.component():
        raise ContactInputError(
            "The displacement is a part of another space; give a Function of a space of its own, "
            "and several unknowns as a list u=[u, p] with a block of F each."
        )
    element = V.ufl_element()
    if V.dofmap.index_map_bs != gdim or element.reference_value_shape != (gdim,):
        raise ContactInputError(
            f"The displacement, of {element}, has {V.dofmap.index_map_bs} components in {gdim} "
            f"dimensions. {WORKS}"
        )
    if reason := _unfit(element.sub_elements[0]):
        raise ContactInputError(f"The displacement's element {element} {reason}. {WORKS}")
    curved = V.mesh.geometry.cmaps[0].degree
    if (degree := degree_on_facets(V)) < curved:
        raise ContactInputError(
            f"The displacement has degree {degree} on the facets of a mesh whose geometry has "
            f"degree {curved}: its nodes do not follow curved facets. Take a displacement of "
            f"degree {curved}, or a mesh with a coordinate element of degree {degree}."
        )


def _unfit(scalar: Any) -> str | None:
    """Return why contact at the vertices is not exact for a scalar element, or None."""
    if scalar.discontinuous or scalar.basix_sobolev_space != basix.SobolevSpace.H1:
        return "is not continuous"
    at_vertices = scalar.entity_dofs[0]
    if any(len(dofs) != 1 for dofs in at_vertices):
        return "has not exactly one dof at each vertex"
    values = scalar.tabulate(0, basix.geometry(scalar.cell_type))[0]
    expected = np.zeros_like(values)
    for vertex, (dof,) in enumerate(at_vertices):
        expected[vertex, dof] = 1.0
    if not np.allclose(values, expected, atol=1e-10):
        return "has vertex dofs that are not the values there"
    between = any(dofs for entities in scalar.entity_dofs[1:-1] for dofs in entities)
    if between and not getattr(scalar.basix_element, "interpolation_is_identity", False):
        return "has dofs on edges or facets that are not values at points"
    return None


def is_global(V: fem.FunctionSpace) -> bool:
    """Tell whether a Function of the space is the same everywhere (of a real element)."""
    return getattr(V.ufl_element(), "family_name", None) == "real"


def degree_on_facets(V: fem.FunctionSpace) -> int:
    """Return the degree of a displacement's shape functions on facets."""
    return len(V.ufl_element().sub_elements[0].entity_dofs[1][0]) + 1


def nodal_on_facets(V: fem.FunctionSpace) -> bool:
    """Tell whether facets have dofs of the displacement at their vertices only."""
    return not any(_between(V))


def _between(V: fem.FunctionSpace) -> list[int]:
    """Return how many dofs the edges and facets of a cell have, without those inside the cell."""
    scalar = V.ufl_element().sub_elements[0]
    return [len(dofs) for entities in scalar.entity_dofs[1:-1] for dofs in entities]
