# SPDX-License-Identifier: MIT
"""Contact results as DOLFINx objects on the contact submesh, for any writer."""

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem, mesh

from ..base.errors import ContactInputError
from ..base.validators import instance, shown
from ..contact.contact import Contact
from ..problem import FrictionalContactProblem


class ContactFields:
    """Fields of one contact in the last accepted step.

    ``scalars`` and ``vectors`` each share mesh and element, so that one ``VTXWriter`` takes each::

        fields = ContactFields(problem)
        with VTXWriter(msh.comm, "contact.bp", fields.scalars) as writer:
            ...
            problem.solve()
            fields.update()
            writer.write(t)

    Args:
        problem: The problem.
        contact: One of its contacts; may be left out if there is only one.

    Attributes:
        gap: Gap (m).
        pressure: Normal traction ``c_n`` (Pa).
        path: Accumulated length of slip (m).
        state: 0 open, 1 stick, 2 slip.
        natural_map: The certificate's natural-map residual of each node (Pa).
        traction: Contact traction on the body in global axes (Pa).
        tangential: Its tangential part (Pa).
        slip: Slip increment of the step in global axes (m).
        displacement: Displacement of the nodes (m), to warp the surface by.
    """

    def __init__(self, problem: FrictionalContactProblem, contact: Contact | None = None) -> None:
        instance(problem, FrictionalContactProblem, "problem", "a FrictionalContactProblem")
        if contact is None and len(problem.contacts) > 1:
            raise ContactInputError(
                f"The problem has {len(problem.contacts)} contacts; say which one."
            )
        if contact is not None and not any(contact is k for k in problem.contacts):
            raise ContactInputError(
                f"contact = {shown(contact)} is none of the problem's contacts; give one of "
                "problem.contacts."
            )
        self._problem = problem
        self._contact = problem.contacts[0] if contact is None else contact
        self._index = problem.contacts.index(self._contact)
        surface = self._contact.surface
        W = surface.space((surface.mesh.geometry.dim,))
        self.gap = fem.Function(surface.S, name="gap")
        self.pressure = fem.Function(surface.S, name="pressure")
        self.path = fem.Function(surface.S, name="slip_path")
        self.state = fem.Function(surface.S, name="state")
        self.natural_map = fem.Function(surface.S, name="natural_map")
        self.traction = fem.Function(W, name="traction")
        self.tangential = fem.Function(W, name="tangential_traction")
        self.slip = fem.Function(W, name="slip")
        self.displacement = fem.Function(W, name="displacement")

    @property
    def scalars(self) -> list[fem.Function]:
        """The scalar fields."""
        return [self.gap, self.pressure, self.path, self.state, self.natural_map]

    @property
    def vectors(self) -> list[fem.Function]:
        """The vector fields."""
        return [self.traction, self.tangential, self.slip, self.displacement]

    def update(self) -> None:
        """Take the values of the last accepted step; collective.

        Raises:
            ContactInputError: If no step was accepted yet.
        """
        if not self._problem.accepted:
            raise ContactInputError("There is no accepted step yet: call problem.solve() first.")
        nodal, contact = self._problem.accepted[self._index], self._contact
        normals, traction = contact.pairing.normals(), contact.nodal_traction()
        pressure = nodal.c[:, 0]
        _set(self.gap, nodal.gap)
        _set(self.pressure, pressure)
        _set(self.path, contact.path.x.array[: len(pressure)])
        _set(self.state, nodal.states())
        _set(self.natural_map, np.max(nodal.natural_map(), axis=0, initial=0.0))
        _set(self.traction, traction)
        _set(self.tangential, traction - pressure[:, None] * normals)
        _set(self.slip, contact.slip_increment)
        _set(self.displacement, contact.pairing.side.owned(self._problem.u_old.x.array))

    def state_tags(self) -> mesh.MeshTags:
        """Return the states as tags of the submesh's vertices: 0 open, 1 stick, 2 slip."""
        submesh = self._contact.surface.submesh
        submesh.topology.create_connectivity(0, submesh.topology.dim)
        num = submesh.topology.index_map(0).size_local + submesh.topology.index_map(0).num_ghosts
        values = np.zeros(num, dtype=np.int32)
        cells = submesh.topology.connectivity(submesh.topology.dim, 0)
        dofs = self.state.function_space.dofmap.list
        corners = len(basix.geometry(submesh.basix_cell()))
        vertices = cells.array.reshape(len(dofs), corners)
        values[vertices] = np.rint(self.state.x.array[dofs[:, :corners]])
        tags = mesh.meshtags(submesh, 0, np.arange(num, dtype=np.int32), values)
        tags.name = "state"
        return tags


def _set(function: fem.Function, values: npt.NDArray[np.generic]) -> None:
    """Set the owned values of a Function, one row a node, and update its ghosts."""
    flat = np.asarray(values).ravel()
    function.x.array[: len(flat)] = flat
    function.x.scatter_forward()
