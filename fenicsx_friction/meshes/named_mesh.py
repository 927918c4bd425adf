# SPDX-License-Identifier: MIT
"""A mesh whose groups of cells and facets have names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx.mesh import Mesh, MeshTags

from ..base.errors import ContactInputError
from ..surfaces.surface import ContactSurface

Indices = npt.NDArray[np.int32]


@dataclass(frozen=True)
class NamedMesh:
    """A mesh with tags and the names of their groups.

    Attributes:
        mesh: The mesh.
        cell_tags: Tags of its cells, if any.
        facet_tags: Tags of its facets, if any.
        groups: Dimension and tags of each group, by its name.
    """

    mesh: Mesh
    cell_tags: MeshTags | None
    facet_tags: MeshTags | None
    groups: Mapping[str, tuple[int, tuple[int, ...]]]

    def surface(self, name: str, **options: Any) -> ContactSurface:
        """Return a group of facets as a contact surface of this name; collective.

        Args:
            name: The group.
            options: Of the ``ContactSurface``.

        Raises:
            ContactInputError: If there is no such group.
        """
        tags, (tag, *others) = self._facets(name)
        if others:
            raise ContactInputError(f"The group '{name}' has several tags: take one of its parts.")
        return ContactSurface(self.mesh, tags, tag, name, **options)

    def facets(self, name: str) -> Indices:
        """Return the facets of a group on this rank, for ``fem.locate_dofs_topological``."""
        return _found(*self._facets(name))

    def cells(self, name: str) -> Indices:
        """Return the cells of a group on this rank."""
        return _found(*self._cells(name))

    def ds(self, name: str) -> ufl.Measure:
        """Return the measure of a group of facets."""
        tags, group = self._facets(name)
        return ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)(group)

    def dx(self, name: str) -> ufl.Measure:
        """Return the measure of a group of cells."""
        tags, group = self._cells(name)
        return ufl.Measure("dx", domain=self.mesh, subdomain_data=tags)(group)

    def _facets(self, name: str) -> tuple[MeshTags, tuple[int, ...]]:
        """Return the tags of a group of facets, or raise."""
        return self._group(name, self.facet_tags, 1, "facets")

    def _cells(self, name: str) -> tuple[MeshTags, tuple[int, ...]]:
        """Return the tags of a group of cells, or raise."""
        return self._group(name, self.cell_tags, 0, "cells")

    def _group(
        self, name: str, tags: MeshTags | None, codim: int, what: str
    ) -> tuple[MeshTags, tuple[int, ...]]:
        """Return the tags of a group, or raise."""
        dim = self.mesh.topology.dim - codim
        known = [key for key, (d, _) in self.groups.items() if d == dim]
        if name not in known or tags is None:
            listed = ", ".join(f"'{key}'" for key in known) or "none"
            raise ContactInputError(
                f"There is no group of {what} named '{name}'; there are: {listed}."
            )
        return tags, self.groups[name][1]


def _found(tags: MeshTags, group: tuple[int, ...]) -> Indices:
    """Return the entities with one of several tags, ascending."""
    return np.asarray(tags.indices[np.isin(tags.values, group)], dtype=np.int32)
