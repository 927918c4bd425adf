# SPDX-License-Identifier: MIT
"""Checks of one contact: its surface, obstacle and friction law, tried on the displacement."""

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives
from ufl.core.expr import Expr

from ..base.domains import check_terminals
from ..base.errors import ContactInputError
from ..base.validators import call
from ..laws.friction import FrictionLaw, Sliding
from ..obstacles.deformable import DeformableObstacle
from ..obstacles.rigid import RigidObstacle
from ..surfaces.faces import check_surfaces
from ..surfaces.surface import ContactSurface
from .contact import Contact


def check_contact(contact: Contact, u: fem.Function) -> None:
    """Raise a ContactInputError if surface, obstacle and law do not fit the displacement."""
    msh, surface, obstacle = u.function_space.mesh, contact.surface, contact.obstacle
    if surface.mesh is not msh:
        raise ContactInputError(f"Contact surface '{surface.name}' lies on another mesh than u.")
    if isinstance(obstacle, DeformableObstacle):
        check_surfaces(surface, obstacle.primary)
    if obstacle.motion is not None and obstacle.motion.mesh is not msh:
        raise ContactInputError(
            f"The motion of the obstacle of contact '{surface.name}' was made with another mesh "
            "than that of u; make it with RigidMotion(u.function_space.mesh)."
        )
    if isinstance(obstacle, RigidObstacle):
        _check_gap(obstacle, surface)
    _check_law(contact.friction, surface)


def check_normals(contact: Contact) -> None:
    """Raise a ContactInputError, on all ranks, where a rigid obstacle has no normal; collective.

    Args:
        contact: A contact that is bound to a displacement.
    """
    surface = contact.surface
    if not isinstance(contact.obstacle, RigidObstacle):
        return
    bad = surface.x[~np.isfinite(contact.pairing.normals()).all(axis=1)]
    found = [part for part in surface.mesh.comm.allgather(bad.tolist()) if part]
    if found:
        where = ", ".join(f"{value:.6g}" for value in found[0][0])
        raise ContactInputError(
            f"The {type(contact.obstacle).__name__} of contact '{surface.name}' has no normal at "
            f"node ({where}): the gradient of its gap is zero or not finite there. Move the "
            "obstacle, or give a gap with a gradient of about length one."
        )


def _check_gap(obstacle: RigidObstacle, surface: ContactSurface) -> None:
    """Check that a gap is a scalar of the body's mesh that changes with the point."""
    name = type(obstacle).__name__
    point = ufl.variable(ufl.SpatialCoordinate(surface.mesh))
    what = f"The gap of the {name} of contact '{surface.name}'"
    gap = call(obstacle.gap, what, point)
    check_terminals(gap, [surface.mesh, surface.submesh], what)
    gradient = call(
        lambda X: expand_derivatives(ufl.diff(gap, X)),
        f"{what}, differentiated,",
        point,
        shape=point.ufl_shape,
    )
    if isinstance(gradient, ufl.classes.Zero):
        raise ContactInputError(
            f"{what} does not depend on the point X, so that it has no normal; return a distance "
            "that does, such as X[1]."
        )


def _check_law(law: FrictionLaw, surface: ContactSurface) -> None:
    """Check what a law returns, for a variable pressure, for pressure 0 and for pressure 1."""
    name, d, meshes = type(law).__name__, surface.mesh.geometry.dim, [surface.mesh, surface.submesh]
    pressure, length = (fem.Constant(surface.mesh, 1.0) for _ in range(2))
    slip = _vector(surface, d - 1)
    tangents = tuple(_vector(surface, d) for _ in range(d - 1))
    x = ufl.SpatialCoordinate(surface.mesh)
    sliding = Sliding(slip, length, length, tangents, x)
    what = f"{name}.limit(pressure, sliding) of contact '{surface.name}'"
    limit = call(law.limit, what, pressure, sliding)
    check_terminals(limit, meshes, what)
    for fixed in (0.0, 1.0):
        call(law.limit, f"{what}, at pressure {fixed:g},", ufl.as_ufl(fixed), sliding)

    def metric(sliding: Sliding) -> Expr:
        """Return the law's metric, the identity for None."""
        tensor = law.metric(sliding)
        return ufl.Identity(d - 1) if tensor is None else tensor

    what = f"{name}.metric(sliding) of contact '{surface.name}'"
    check_terminals(call(metric, what, sliding, shape=(d - 1, d - 1)), meshes, what)
    if not law.certifiable:
        what = f"{name}.row(s, c_t, limit, r, eps) of contact '{surface.name}'"
        row = call(law.row, what, slip, slip, limit, length, length, shape=(d - 1,))
        check_terminals(row, meshes, what)


def _vector(surface: ContactSurface, components: int) -> fem.Constant:
    """Return a constant vector."""
    values: npt.NDArray[np.floating] = np.ones(components)
    return fem.Constant(surface.mesh, values)
