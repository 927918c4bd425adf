# SPDX-License-Identifier: MIT
"""Rigid tools of any shape, from surface meshes."""

from __future__ import annotations

import copy
import os
import warnings
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from ..base.collective import on_first_rank
from ..base.errors import ContactInputError
from ..base.validators import choice, flag, instance, kind, number, shown
from ..surfaces.elements import nodal_on_facets
from ..surfaces.face_cells import FACE_CELLS
from ..surfaces.faces import Faces
from ..surfaces.soundness import Soundness, cleaned, cut_quadrilaterals
from .rigid import MovedObstacle, check_dimension
from .search import SearchPolicy, check_positive
from .side import Side
from .surface_file import read_surface
from .surface_pairing import SurfacePairing
from .weighted_surface import WeightedSurface

#: From this number of faces on a warning says that all ranks hold all of them.
MANY = 1_000_000


@dataclass(frozen=True, eq=False)
class RigidSurface(MovedObstacle):
    """A rigid tool whose surface is made of triangles, or of line segments in 2D.

    Each node of the contact surface meets one face at a time, as with ``DeformableObstacle``'s
    ``"node-to-face"``. Faces are found at the beginning of a step and again after it was solved,
    until they do not change. Slip leads over any number of faces. The normals must point out of the
    tool, towards the deformable body: those of triangles whose nodes turn counter-clockwise as seen
    from there; the tool is on the left of a segment's way, the body on the right. All ranks hold
    all faces. Displacements of degree 2 or more meet the tool on average over the faces round each
    node, as other rigid obstacles; points beyond the tool's edges do not count.

    Attributes:
        points: Coordinates, (points, 2 or 3).
        faces: Points of each face: (faces, 3), or (faces, 4) in cyclic order, which are cut into
            triangles; (faces, 2) in 2D.
        scale: Factor of the coordinates, such as 1e-3 for files in mm.
        flip: Turn all normals round.
        orient: Turn faces round that are oriented against most of those connected with them;
            otherwise such faces are an error.
        open_edges: ``"warn"`` of open edges and edges of more than two faces, ``"error"``, or
            ``"allow"``. A tool may be open where contact never comes to its edges.
        search: How far nodes see faces, see ``SearchPolicy``; by default twice the mean facet of
            the body, or of the tool if that is larger.
        close_gaps: Gaps and overlaps up to this (m) at the start count as closed, as in a bore
            where both sides are made of plane facets.
        surface: The faces, without those that have no area; found from the above.
        soundness: What was found in the mesh: counts of open edges and other defects.
        planes: The face that each node meets, in UFL; found by the pairing.
    """

    points: npt.ArrayLike = field(repr=False)
    faces: npt.ArrayLike = field(repr=False)
    scale: float = field(default=1.0, kw_only=True)
    flip: bool = field(default=False, kw_only=True)
    orient: bool = field(default=False, kw_only=True)
    open_edges: str = field(default="warn", kw_only=True)
    search: SearchPolicy | None = field(default=None, kw_only=True)
    close_gaps: float | None = field(default=None, kw_only=True)
    surface: Faces = field(init=False, repr=False)
    soundness: Soundness = field(init=False)
    planes: fem.Function | None = field(init=False, default=None, repr=False)

    def __post_init__(self) -> None:
        """Check all arguments and the mesh."""
        super().__post_init__()
        number(self.scale, "The scale of a RigidSurface", above=0.0)
        flag(self.flip, "flip (turn the normals of a RigidSurface round)")
        flag(self.orient, "orient (turn flipped faces of a RigidSurface round)")
        choice(self.open_edges, "open_edges of a RigidSurface", ("warn", "error", "allow"))
        if self.search is not None:
            instance(self.search, SearchPolicy, "The search of a RigidSurface", "SearchPolicy()")
        if self.close_gaps is not None:
            meaning = "the largest gap or overlap (m) that counts as closed at the start"
            check_positive(self.close_gaps, "close_gaps", meaning)
        X, faces = _checked(self.points, self.faces)
        X, faces, found = cleaned(self.scale * X, faces, orient=self.orient)
        if not len(faces):
            raise ContactInputError(f"The mesh of a RigidSurface has no face with an area: {found}")
        self._judge(found)
        cell = FACE_CELLS["interval" if X.shape[1] == 2 else "triangle"]
        faces = faces[:, list(cell.reverse)] if self.flip else faces
        object.__setattr__(self, "surface", Faces(cell, X, faces))
        object.__setattr__(self, "soundness", found)

    @classmethod
    def from_file(
        cls,
        path: str | os.PathLike[str],
        *,
        dimension: int | None = None,
        comm: MPI.Intracomm = MPI.COMM_WORLD,
        **options: Any,
    ) -> RigidSurface:
        """Read a surface mesh: STL, gmsh or any other format of meshio; collective.

        Args:
            path: The file; rank 0 reads it.
            dimension: Of space, 2 or 3; by default 3 if there are triangles or quadrilaterals.
            comm: The ranks of the problem.
            options: Those of a RigidSurface, such as ``scale=1e-3`` for a file in mm.

        Raises:
            ContactInputError: On all ranks, if there is no such file, or no surface in it.
        """
        if dimension is not None:
            choice(dimension, "The dimension of a RigidSurface", (2, 3))
        read = on_first_rank(comm, lambda: read_surface(path, dimension))
        points, faces = comm.bcast(read)
        return cls(points, faces, **options)

    def _judge(self, found: Soundness) -> None:
        """Raise or warn of what was found."""
        text = f"The mesh of a RigidSurface has {found}."
        if found.flipped and not self.orient:
            raise ContactInputError(
                f"{text} Nodes do not meet flipped faces: orient all alike in the program that "
                "made the mesh, or with orient=True."
            )
        holes = bool(found.open_edges or found.branches)
        if holes and self.open_edges == "error":
            raise ContactInputError(
                f"{text} Close it, or take open_edges='allow' if contact stays away from its edges."
            )
        removed = found.degenerate + found.double > 0
        if removed or (holes and self.open_edges == "warn"):
            cure = (
                " Contact must stay away from open edges; open_edges='allow' says that it does."
                if holes
                else ""
            )
            warnings.warn(text + cure, stacklevel=5)
        if found.faces > MANY:
            warnings.warn(
                f"A RigidSurface of {found.faces} faces: each rank holds and searches all of them. "
                "A coarser mesh, or only the part that may come into contact, costs less.",
                stacklevel=5,
            )

    def near(self, side: Side, *, nodal: bool = True) -> RigidSurface:
        """Return the same tool with room for the plane that each node of a side meets."""
        check_dimension(self.surface.X.shape[1], side.d, "A RigidSurface")
        found = copy.copy(self)
        planes = fem.Function(side.surface.space((2 * side.d + 2,)), name="planes")
        object.__setattr__(found, "planes", planes)
        return found

    def gap_and_normal(self, X: Expr, u: Expr) -> tuple[Expr, Expr]:
        """Return gap and normal of the plane of the face that a node meets.

        Displacements are added to the distance at rest, as with a RigidPlane. A node that meets no
        face has a constant gap.
        """
        d, planes = len(X), ufl.as_vector(self.planes)
        normal, point = (ufl.as_vector([planes[i + k] for i in range(d)]) for k in (0, d))
        start, meets = planes[2 * d], planes[2 * d + 1]
        if self.motion is None:
            return start + meets * ufl.dot(normal, u), normal
        turned = meets * self.motion.turned(normal)
        away = u - self.motion.displacement(point)
        moved = ufl.dot(turned, X - point) + ufl.dot(normal + turned, away)
        return start + meets * moved, normal + turned

    def meet(self, side: Side) -> SurfacePairing | WeightedSurface:
        """Return the pairing of a side's nodes with the tool; collective.

        Raises:
            ContactInputError: If multipliers are at all nodes of a displacement of degree 2.
        """
        if side.surface.degree > 1:
            raise ContactInputError(
                f"Contact surface '{side.surface.name}' has degree = {side.surface.degree}: its "
                "nodes do not meet a RigidSurface. Leave degree = 1, which averages over the "
                "faces, or describe the tool by RigidSphere, RigidCylinder or an ImplicitObstacle."
            )
        nodal = nodal_on_facets(side.u.function_space)
        pairing = (SurfacePairing if nodal else WeightedSurface)(self, side)
        if self.close_gaps is not None:
            pairing.close_gaps(self.close_gaps)
        return pairing


def _checked(points: Any, faces: Any) -> tuple[npt.NDArray, npt.NDArray[np.int64]]:
    """Return coordinates, and triangles or segments, or raise."""
    X, table = (_table(a, what) for a, what in ((points, "points"), (faces, "faces")))
    d = X.shape[1]
    if d not in (2, 3) or X.dtype.kind not in "iuf" or not np.all(np.isfinite(X)):
        raise ContactInputError(
            f"The points of a RigidSurface must be finite numbers, (points, 2 or 3); they are "
            f"{X.shape} of {X.dtype}{'' if X.dtype.kind == 'O' else ', or not finite'}."
        )
    sizes = (2,) if d == 2 else (3, 4)
    if table.shape[1] not in sizes or table.dtype.kind not in "iu":
        raise ContactInputError(
            f"The faces of a RigidSurface in {d}D must be integers, (faces, "
            f"{' or '.join(map(str, sizes))}); they are {table.shape} of {table.dtype}."
        )
    if len(table) == 0 or table.min() < 0 or table.max() >= len(X):
        raise ContactInputError(
            f"The faces of a RigidSurface must have at least one row, of numbers from 0 to "
            f"{len(X) - 1}, those of the points."
        )
    X, table = X.astype(float), table.astype(np.int64)
    return X, cut_quadrilaterals(X, table) if table.shape[1] == 4 else table


def _table(value: Any, what: str) -> npt.NDArray:
    """Return a table of two dimensions, or raise."""
    try:
        table = np.asarray(value)
    except ValueError:
        table = np.zeros(0)
    if table.ndim != 2:
        raise ContactInputError(
            f"The {what} of a RigidSurface = {shown(value)} must be a table, one row each, not "
            f"{kind(value)}."
        )
    return table
