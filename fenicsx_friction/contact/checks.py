# SPDX-License-Identifier: MIT
"""Checks of one contact: its surface, obstacle and friction law, tried on the displacement."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.core.expr import Expr

from ..base.collective import on_all_ranks
from ..base.domains import check_terminals, not_finite
from ..base.errors import ContactInputError
from ..base.validators import call
from ..laws.friction import FrictionLaw, Sliding, limit_at
from ..obstacles.deformable import DeformableObstacle
from ..obstacles.kinematics import Array
from ..obstacles.rigid import RigidObstacle
from ..surfaces.elements import degree_on_facets
from ..surfaces.faces import check_surfaces
from ..surfaces.surface import ContactSurface
from .contact import Contact

#: A metric is symmetric up to this fraction of its largest entry.
ASYMMETRY = 1e-10


def check_contact(contact: Contact, u: fem.Function) -> None:
    """Raise a ContactInputError if surface, obstacle and law do not fit the displacement.

    Collective: what a gap or a law of the user raises on one rank is raised on all.
    """
    msh, surface, obstacle = u.function_space.mesh, contact.surface, contact.obstacle
    if surface.mesh is not msh:
        raise ContactInputError(f"Contact surface '{surface.name}' lies on another mesh than u.")
    _check_degree(surface, u)
    if isinstance(obstacle, DeformableObstacle):
        check_surfaces(surface, obstacle.primary)
    if obstacle.motion is not None and obstacle.motion.mesh is not msh:
        raise ContactInputError(
            f"The motion of the obstacle of contact '{surface.name}' was made with another mesh "
            "than that of u; make it with RigidMotion(u.function_space.mesh)."
        )
    if isinstance(obstacle, RigidObstacle):
        on_all_ranks(msh.comm, lambda: _check_gap(obstacle, surface))
    on_all_ranks(msh.comm, lambda: _check_law(contact.friction, surface))


def _check_degree(surface: ContactSurface, u: fem.Function) -> None:
    """Check that nodes between the vertices are those of the displacement."""
    found = degree_on_facets(u.function_space)
    if surface.degree not in (1, found):
        raise ContactInputError(
            f"Contact surface '{surface.name}': degree = {surface.degree} needs a displacement of "
            f"this degree on facets, for its nodes are those of the displacement; it has degree "
            f"{found}. Leave degree = 1."
        )


def check_normals(contact: Contact) -> None:
    """Raise a ContactInputError, on all ranks, where a rigid obstacle has no gap or normal.

    Args:
        contact: A contact that is bound to a displacement.
    """
    surface = contact.surface
    if not isinstance(contact.obstacle, RigidObstacle):
        return
    name = type(contact.obstacle).__name__
    gaps = contact.pairing.gaps()
    if bad := _first(surface, ~np.isfinite(gaps), gaps):
        raise ContactInputError(
            f"The gap of the {name} of contact '{surface.name}' is {bad[0]} at node {bad[1]}, not "
            "finite. Look at its shape and its motion."
        )
    lengths = np.linalg.norm(contact.pairing.normals(), axis=1)
    # A gradient too large for floats has no length, either.
    if bad := _first(surface, ~(abs(lengths - 1.0) < 0.5), lengths):
        raise ContactInputError(
            f"The {name} of contact '{surface.name}' has no normal at node {bad[1]}: the gradient "
            "of its gap is zero or not finite there. Move the obstacle, or give a gap with a "
            "gradient of about length one."
        )


def check_friction(contact: Contact) -> None:
    """Raise a ContactInputError, on all ranks, unless limit and metric of the law are possible."""
    surface, law, sliding = contact.surface, contact.friction, contact.rows.sliding
    for pressure, name, values in (
        (1.0, "unit pressure (mu)", contact.friction_at_unit_pressure()),
        (0.0, "pressure 0 (adhesion)", contact.friction_without_pressure()),
    ):
        if bad := _first(surface, ~((values >= 0.0) & (values < np.inf)), values):
            limit = limit_at(law, pressure, sliding, surface.mesh)
            raise ContactInputError(
                f"Contact '{surface.name}': the friction limit at {name} must be >= 0 and finite "
                f"at every contact node; it is {bad[0]} at {bad[1]}{not_finite(limit)}."
            )
    check_metrics([contact])


def check_metrics(contacts: Sequence[Contact]) -> None:
    """Raise a ContactInputError, on all ranks, unless metrics are symmetric and positive."""
    for contact in contacts:
        _check_metric(contact)


def _check_metric(contact: Contact) -> None:
    """Check the metric of one contact."""
    metrics = contact.metrics()
    if metrics is None:
        return
    size = np.max(abs(metrics), axis=(1, 2), initial=0.0)
    turned = np.max(abs(metrics - metrics.transpose(0, 2, 1)), axis=(1, 2), initial=0.0)
    positive = np.linalg.det(metrics) > 0.0
    positive &= np.trace(metrics, axis1=1, axis2=2) > 0.0
    good = np.isfinite(size) & positive & (turned <= ASYMMETRY * size)
    if bad := _first(contact.surface, ~good, [m.tolist() for m in metrics]):
        raise ContactInputError(
            f"Contact '{contact.surface.name}': {type(contact.friction).__name__}.metric must be a "
            f"symmetric and positive definite tensor at every contact node; it is {bad[0]} at "
            f"{bad[1]}. Else friction would drive the slip."
        )


def _first(
    surface: ContactSurface, bad: npt.NDArray[np.bool_], values: Sequence[Any] | Array
) -> tuple[str, str] | None:
    """Return the value at the first bad node of all ranks, and its place; collective."""
    nodes = [
        (
            str(values[i]) if isinstance(values, list) else f"{values[i]:g}",
            f"({', '.join(f'{xi:.6g}' for xi in surface.x[i])})",
        )
        for i in np.flatnonzero(bad)[:1]
    ]
    found = [part for part in surface.mesh.comm.allgather(nodes) if part]
    return found[0][0] if found else None


def _check_gap(obstacle: RigidObstacle, surface: ContactSurface) -> None:
    """Check that a gap is a scalar of the body's mesh that changes with the point."""
    name = type(obstacle).__name__
    point = ufl.variable(ufl.SpatialCoordinate(surface.mesh))
    what = f"The gap of the {name} of contact '{surface.name}'"
    gap = call(obstacle.gap, what, point)
    check_terminals(gap, [surface.mesh, surface.submesh], what, arguments=False)
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
    """Check what a law returns; nothing here is collective."""
    name, d, meshes = type(law).__name__, surface.mesh.geometry.dim, [surface.mesh, surface.submesh]
    pressure, length = (fem.Constant(surface.mesh, 1.0) for _ in range(2))
    slip = _vector(surface, d - 1)
    tangents = tuple(_vector(surface, d) for _ in range(d - 1))
    x = ufl.SpatialCoordinate(surface.mesh)
    sliding = Sliding(slip, length, length, tangents, x)
    what = f"{name}.limit(pressure, sliding) of contact '{surface.name}'"
    limit = call(law.limit, what, pressure, sliding)
    check_terminals(limit, meshes, what, arguments=False)
    for fixed in (0.0, 1.0):
        call(limit_at, f"{what}, at pressure {fixed:g},", law, fixed, sliding, surface.mesh)

    def metric(sliding: Sliding) -> Expr:
        """Return the law's metric, the identity for None."""
        tensor = law.metric(sliding)
        return ufl.Identity(d - 1) if tensor is None else tensor

    what = f"{name}.metric(sliding) of contact '{surface.name}'"
    check_terminals(call(metric, what, sliding, shape=(d - 1, d - 1)), meshes, what)

    def inverse(sliding: Sliding) -> Expr:
        """Return the inverse of the metric, worked out."""
        return apply_algebra_lowering(ufl.inv(metric(sliding)))

    call(inverse, f"The inverse of {what}", sliding, shape=(d - 1, d - 1))
    if not law.certifiable:
        what = f"{name}.row(s, c_t, limit, r, eps) of contact '{surface.name}'"
        row = call(law.row, what, slip, slip, limit, length, length, shape=(d - 1,))
        check_terminals(row, meshes, what)


def _vector(surface: ContactSurface, components: int) -> fem.Constant:
    """Return a constant vector."""
    values: npt.NDArray[np.floating] = np.ones(components)
    return fem.Constant(surface.mesh, values)
