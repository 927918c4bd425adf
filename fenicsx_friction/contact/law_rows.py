# SPDX-License-Identifier: MIT
"""The rows of one contact in UFL, for the three kinds of substep."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from ..laws import rows
from ..laws.friction import UNLIMITED, FrictionLaw, Sliding, limit_at
from ..obstacles.kinematics import Kinematics

#: Pressures (Pa) at which a law that has friction has some, here or there.
PRESSURES = (1.0, 1e3, 1e6, 1e9, 1e30)


class LawRows:
    """Rows of contact and friction at a node; the same law for any obstacle.

    Args:
        kinematics: Gap, slip and frame of the node.
        friction: The friction law.
        fields: The nodal fields of the contact: ``bonded, c, c_stick, free, path, r, scale,
            slipping, slip_scale``.
        dt: Length of the step (s).
        normal: Name of the normal complementarity function.

    Attributes:
        sliding: What the law knows of the sliding.
        nodal: Gap, slip and traction in the law's disk variables, and the friction limit: at the
            contact pressure, at none, at a unit pressure, at ``c_n``; the length slid.
        own_row: ``R_t`` of a law that states no cone, or ``None``.
        metric: Entries of the law's metric, or ``None`` for the identity.
        reach: The friction limit where much presses and slides, to see whether there is friction.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        friction: FrictionLaw,
        fields: Any,
        dt: fem.Constant,
        normal: str,
    ) -> None:
        self._gap, self._friction, self._f = kinematics.gap, friction, fields
        self._normal_row = rows.NORMAL_ROWS[normal]
        # A prescribed tangential direction neither slips nor carries friction here.
        tangential = range(1, len(kinematics.tangents) + 1)
        slip = ufl.as_vector([fields.free[k] * kinematics.slip[k - 1] for k in tangential])
        length = rows.norm(slip)
        path = fields.path + length
        self.sliding = Sliding(slip, path, length / dt, kinematics.tangents, kinematics.position)
        c_t, stick = (ufl.as_vector([c[k] for k in tangential]) for c in (fields.c, fields.c_stick))
        # In the variables M^-1 c_t, M s every cone is a disk; |M| = 1 keeps their units.
        metric, self.metric = friction.metric(self.sliding), None
        self._scale = ufl.as_ufl(1.0)
        if metric is not None:
            self.metric = ufl.as_vector([metric[i] for i in np.ndindex(metric.ufl_shape)])
            self._scale = abs(ufl.det(metric)) ** (1.0 / len(tangential))
            metric = metric / self._scale
            slip, c_t = metric * slip, ufl.inv(metric) * c_t
            stick = ufl.inv(metric) * stick
        self._metric, self._slip, self._c_t, self._stick = metric, slip, c_t, stick
        limit = self._limit(rows.positive(fields.c[0] - fields.scale * self._gap))
        limits = [limit, self._at(0.0), self._at(1.0)]
        limits.append(self._scale * friction.limit(fields.c[0], self.sliding))
        limits = [self._bonded(ufl.as_ufl(UNLIMITED), limit) for limit in limits]
        self.nodal = ufl.as_vector([self._gap, *slip, *c_t, *limits, path])
        self.reach = self._reach()
        self.own_row = None
        if not friction.certifiable:
            row = friction.row(slip, c_t, limit, fields.scale, ufl.as_ufl(0.0))
            bond = fields.scale * slip
            self.own_row = ufl.as_vector(
                [self._bonded(*pair) for pair in zip(bond, row, strict=True)]
            )

    def _bonded(self, bond: Expr, law: Expr) -> Expr:
        """Return one expression where the node is bonded, another where it is not."""
        return ufl.conditional(ufl.gt(self._f.bonded, 0.5), bond, law)

    def _at(self, pressure: float) -> Expr:
        """Return the law's limit at a pressure."""
        return limit_at(self._friction, pressure, self.sliding, self._f.surface.mesh)

    def _reach(self) -> Expr:
        """Return the limits at some pressures, at rest and sliding, as a vector."""
        msh = self._f.surface.mesh
        far = fem.Constant(msh, 1.0)
        moving = self.sliding._replace(
            slip=ufl.as_vector([far] * len(self.sliding.slip)), path=far, rate=far
        )
        return ufl.as_vector(
            [limit_at(self._friction, p, s, msh) for p in PRESSURES for s in (self.sliding, moving)]
        )

    def stick(self, eps: Expr) -> Expr:
        """Return the rows of the stick predictor, eq. (14); without friction nothing sticks.

        Stick rows there would over-constrain a body on a frictionless support.
        """
        H = rows.closed(self._gap, self._f.c[0], self._f.r)
        rough = ufl.gt(self._at(1.0), 0.0)
        H = ufl.conditional(rough, H, 0.0)
        return self._rows(eps, rows.stick_row(self._slip, self._c_t, self._f.r, H))

    def projection(self, eps: Expr, xi: Expr) -> Expr:
        """Return the rows of the natural map, of the fraction ``1 - xi`` of the friction."""
        pressure = rows.ramp(self._f.c[0] - self._f.r * self._gap, eps)
        limit = (1.0 - xi) * self._limit(pressure)
        return self._rows(eps, self._friction.row(self._slip, self._c_t, limit, self._f.r, eps))

    def slip(self, eps: Expr, xi: Expr, sign: Expr) -> Expr:
        """Return slip rows (15) at the ``slipping`` nodes, projection rows at the others."""
        f = self._f
        w = rows.blended_slip(self._slip, self._stick, xi, f.slip_scale, sign)
        limit = self._scale * self._friction.limit(f.c[0], self.sliding)
        slip = rows.slip_row(self._c_t, limit, w, f.slip_scale)
        limit = self._limit(rows.positive(f.c[0] - f.r * self._gap))
        other = self._friction.row(self._slip, self._c_t, limit, f.r, ufl.as_ufl(0.0))
        return self._rows(eps, f.slipping * slip + (1.0 - f.slipping) * other)

    def _limit(self, pressure: Expr) -> Expr:
        """Return the law's limit in contact, zero where the node is open.

        Only the adhesion is switched off: the rest vanishes with the pressure and stays smooth.
        """
        H = rows.closed(self._gap, self._f.c[0], self._f.r)
        adhesion = self._at(0.0)
        limit = self._friction.limit(pressure, self.sliding) - adhesion + H * adhesion
        return self._scale * limit

    def _rows(self, eps: Expr, tangential: Expr) -> Expr:
        """Stack the normal row on the tangential ones; prescribed directions carry nothing."""
        free, c = self._f.free, self._f.c
        normal = self._normal_row(self._gap, c[0], self._f.r, eps)
        if self._metric is not None:
            tangential = self._metric * tangential
        stick = self._slip if self._metric is None else self._metric * self._slip
        bonds = [-self._f.r * self._gap, *(self._f.r * s for s in stick)]
        laws = [normal, *tangential]
        stacked = [self._bonded(*pair) for pair in zip(bonds, laws, strict=True)]
        return ufl.as_vector(
            [free[k] * row + (1.0 - free[k]) * c[k] for k, row in enumerate(stacked)]
        )
