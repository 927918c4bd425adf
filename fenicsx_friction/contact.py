# SPDX-License-Identifier: MIT
"""One contact: a surface of the body, a rigid obstacle and a friction law."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from . import laws
from .compat import bc_space_contains, unrolled_bc_dofs
from .errors import ContactInputError
from .friction import FrictionLaw
from .obstacles import Kinematics, Obstacle, kinematics
from .surface import ContactSurface

#: A normal this close to the span of the prescribed directions counts as prescribed.
PRESCRIBED_NORMAL = 1e-8

#: A node with slip rows this fraction outside the cone is at a false root.
FALSE_ROOT = 1e-6


class Contact:
    """Unilateral contact with friction of a surface against a rigid obstacle.

    Args:
        surface: The contact surface of the body.
        obstacle: The rigid obstacle.
        friction: The friction law.
        r_p: Scale (Pa/m) of the complementarity functions, the paper's ``r_p``. By default
            each node's diagonal bulk stiffness over its area, which is of the size of ``E/L_c``.

    Attributes:
        c: Multipliers ``(c_n, c_1[, c_2])``, tractions on the body in the contact frame (Pa).
        c_stick: Multipliers of the stick predictor, frozen for the slip corrector (Pa).
        r: The scale ``r_p`` at each node (Pa/m).
        slipping: 1 at the nodes where the corrector uses the slip rows (15), else 0.
        slip_scale: The length of :func:`~fenicsx_friction.laws.blended_slip` (m).
        free: 1 for the free directions of the contact frame, 0 for the prescribed ones.
        hint: Direction whose tangential part is the first tangent.
    """

    def __init__(
        self,
        surface: ContactSurface,
        obstacle: Obstacle,
        friction: FrictionLaw,
        *,
        r_p: float | None = None,
    ) -> None:
        if r_p is not None and not 0.0 < r_p < float("inf"):
            raise ContactInputError(f"r_p = {r_p} must be positive and finite (Pa/m).")
        self.surface, self.obstacle, self.friction, self._r_p = surface, obstacle, friction, r_p
        Q, S = surface.Q, surface.S
        self.c = fem.Function(Q, name="contact_traction")
        self.c_stick = fem.Function(Q, name="stick_traction")
        self.free = fem.Function(Q, name="free_directions")
        self.free.x.array[:] = 1.0
        self.hint = fem.Function(Q, name="tangent_hint")
        self.r = fem.Function(S, name="r_p")
        self.slipping = fem.Function(S, name="slipping")
        self.slip_scale = fem.Function(S, name="slip_scale")
        self.slip_scale.x.array[:] = 1.0

    @property
    def tangential(self) -> list[int]:
        """Indices of the tangential components of the multiplier."""
        return list(range(1, self.surface.mesh.geometry.dim))

    def bind(self, u: fem.Function, u_old: fem.Function) -> None:
        """Derive the kinematics for the displacement ``u`` and its last accepted value."""
        if hasattr(self, "kinematics"):
            raise ContactInputError(
                f"Contact '{self.surface.name}' already belongs to a problem; make another Contact "
                "(its surface can be shared)."
            )
        self._u, self._parent_dofs = u, self.surface.parent_dofs(u.function_space)
        X = ufl.SpatialCoordinate(self.surface.mesh)
        self.kinematics: Kinematics = kinematics(self.obstacle, X + u, u - u_old, self.hint)
        # A prescribed tangential direction neither slips nor carries friction here.
        self.slip = ufl.as_vector(
            [self.free[k] * self.kinematics.slip[k - 1] for k in self.tangential]
        )
        self.c_t = ufl.as_vector([self.c[k] for k in self.tangential])
        self.pressure = laws.positive(self.c[0] - self.r * self.kinematics.gap)
        self.limit = self.friction.limit(self.pressure)
        self._evaluate = self.surface.evaluator(
            ufl.as_vector([self.kinematics.gap, *self.slip, self.limit])
        )
        # Beside the gap, because UFL folds mu = 0 to an expression that no form can hold.
        limits = [self.friction.limit(pressure) for pressure in (ufl.as_ufl(1.0), self.c[0])]
        self._evaluate_law = self.surface.evaluator(ufl.as_vector([self.kinematics.gap, *limits]))
        self._traction = self.surface.evaluator(self.kinematics.traction(self.c))

    # -- the rows of the three kinds of substep ------------------------------------------

    def stick_rows(self, eps: Expr) -> Expr:
        """Rows of the stick predictor, eq. (14)."""
        H = laws.closed(self.kinematics.gap, self.c[0], self.r)
        return self._rows(eps, laws.stick_row(self.slip, self.c_t, self.r, H))

    def projection_rows(self, eps: Expr) -> Expr:
        """Rows of the natural map."""
        pressure = laws.ramp(self.c[0] - self.r * self.kinematics.gap, eps)
        limit = self.friction.limit(pressure)
        return self._rows(eps, laws.projection_row(self.slip, self.c_t, limit, self.r, eps))

    def slip_rows(self, eps: Expr, xi: Expr, sign: float) -> Expr:
        """Slip rows (15) at the ``slipping`` nodes, projection rows at the others."""
        stick = ufl.as_vector([self.c_stick[k] for k in self.tangential])
        w = laws.blended_slip(self.slip, stick, xi, self.slip_scale, sign)
        slip = laws.slip_row(self.c_t, self.friction.limit(self.c[0]), w, self.slip_scale)
        other = laws.projection_row(self.slip, self.c_t, self.limit, self.r, ufl.as_ufl(0.0))
        return self._rows(eps, self.slipping * slip + (1.0 - self.slipping) * other)

    def _rows(self, eps: Expr, tangential: Expr) -> Expr:
        """Stack the normal row on the tangential ones."""
        normal = laws.normal_row(self.kinematics.gap, self.c[0], self.r, eps)
        return ufl.as_vector([normal, *tangential])

    # -- nodal values --------------------------------------------------------------------

    def nodal(self) -> dict[str, npt.NDArray[np.floating]]:
        """Return the owned nodes' ``gap, slip, limit, c, r, area`` as plain arrays."""
        n = self.surface.num_owned
        values = self._evaluate()
        return {
            "gap": values[:, 0],
            "slip": values[:, 1:-1],
            "limit": values[:, -1],
            "c": self.c.x.array.reshape(-1, self.surface.Q.dofmap.index_map_bs)[:n].copy(),
            "r": self.r.x.array[:n].copy(),
            "area": self.surface.area.x.array[:n].copy(),
        }

    def gap_and_friction(self) -> tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]:
        """Return the owned nodes' gaps (m) and friction limits at unit pressure."""
        gap, friction, _ = self._evaluate_law().T
        return gap, friction

    def check_friction(self) -> None:
        """Raise a ContactInputError, on all ranks, unless the friction limit is ``>= 0``."""
        _, limit = self.gap_and_friction()
        bad = [
            f"{value:g} at ({', '.join(f'{xi:.6g}' for xi in x)})"
            for x, value in zip(self.surface.x, limit, strict=True)
            if not value >= 0.0
        ]
        found = self.surface.mesh.comm.allgather(bad)
        if any(found):
            raise ContactInputError(
                f"Contact '{self.surface.name}': the friction limit at unit pressure (mu) must be "
                f">= 0 at every contact node; it is {next(b[0] for b in found if b)}."
            )

    def freeze_stick(self, *, violated_only: bool = True) -> int:
        """Freeze the stick traction for the slip rows and choose the nodes that get them.

        Args:
            violated_only: Choose the nodes whose stick traction leaves the cone, or else all nodes
                in contact (without a stick traction eq. (12) would be 0/0).

        Returns:
            How many owned nodes were chosen.
        """
        n, values = self.surface.num_owned, self.nodal()
        traction = np.linalg.norm(values["c"][:, 1:], axis=1)
        chosen = (traction > 0.0) & (values["c"][:, 0] >= values["r"] * values["gap"])
        if violated_only:
            chosen &= traction > values["limit"]
        self.c_stick.x.array[:] = self.c.x.array
        self.slipping.x.array[:n] = chosen
        # The elastic displacement under the stick force: a slip length free of units.
        self.slip_scale.x.array[:n] = np.where(chosen, traction / values["r"], 1.0)
        self.slipping.x.scatter_forward()
        self.slip_scale.x.scatter_forward()
        return int(np.sum(chosen))

    def has_false_root(self) -> bool:
        """Tell whether a node with slip rows is outside the cone; collective.

        ``c_t |w| + mu c_n w = 0`` holds at ``w = 0`` for any traction.
        """
        n = self.surface.num_owned
        traction = np.linalg.norm(self.nodal()["c"][:, 1:], axis=1)
        limit = self._evaluate_law()[:, 2]
        slack = FALSE_ROOT * np.max(traction, initial=0.0)
        outside = traction > limit * (1.0 + FALSE_ROOT) + slack
        found = np.any(outside & (self.slipping.x.array[:n] > 0.5))
        return bool(self.surface.mesh.comm.allreduce(bool(found), MPI.LOR))

    def stiffness_force(self) -> npt.NDArray[np.floating]:
        """Return stiffness times displacement (N) at each owned node, which rounding goes with."""
        n, bs = self.surface.num_owned, self._u.function_space.dofmap.index_map_bs
        u = self._u.x.array.reshape(-1, bs)[self._parent_dofs[:n]]
        stiffness = self.r.x.array[:n] * self.surface.area.x.array[:n]
        return np.asarray(stiffness * np.linalg.norm(u, axis=1))

    def nodal_traction(self) -> npt.NDArray[np.floating]:
        """Return the owned nodes' traction vectors on the body in global axes (Pa)."""
        return self._traction()

    # -- set-up from the boundary conditions and the bulk stiffness ------------------------

    def set_scale(self, stiffness_diagonal: fem.Function) -> None:
        """Set ``r_p`` at each node from the diagonal of the bulk stiffness (N/m)."""
        V = stiffness_diagonal.function_space
        bs = V.dofmap.index_map_bs
        if self._r_p is not None:
            self.r.x.array[:] = self._r_p
            return
        diagonal = stiffness_diagonal.x.array.reshape(-1, bs)[self._parent_dofs].mean(axis=1)
        self.r.x.array[:] = diagonal / self.surface.area.x.array
        self.r.x.scatter_forward()

    def scale_r(self, factor: float) -> None:
        """Multiply ``r_p`` at all nodes."""
        self.r.x.array[:] *= factor

    def pin_prescribed(
        self, V: fem.FunctionSpace, bcs: list[fem.DirichletBC]
    ) -> list[fem.DirichletBC]:
        """Find the prescribed contact directions and constrain their multipliers to zero.

        The tangent frame of a node with one prescribed Cartesian direction is turned so that
        its first tangent takes that direction; then the multiplier of a prescribed tangent has
        no work to do (the boundary condition carries the reaction) and its row would repeat
        the boundary condition. A node whose normal displacement is prescribed takes no part.

        Returns:
            The homogeneous conditions on the multipliers, one a component.
        """
        Q, gdim = self.surface.Q, V.mesh.geometry.dim
        fixed = self._fixed_components(V, bcs)
        normal = fem.Function(Q)
        self._set_hint(np.zeros_like(fixed), np.tile(np.eye(gdim)[0], (len(fixed), 1)))
        n = self.surface.num_owned
        normal.x.array.reshape(-1, gdim)[:n] = self.surface.evaluator(self.kinematics.normal)()
        normal.x.scatter_forward()
        normals = normal.x.array.reshape(-1, gdim)
        self._set_hint(fixed, normals)
        held_normal = np.linalg.norm(np.where(fixed, 0.0, normals), axis=1) < PRESCRIBED_NORMAL
        pinned = np.zeros_like(fixed)
        for k in range(1, gdim):
            pinned[:, k] = fixed.sum(axis=1) >= k
        pinned[held_normal] = True
        self.free.x.array[:] = np.where(pinned, 0.0, 1.0).ravel()
        return [
            fem.dirichletbc(
                0.0,
                (np.flatnonzero(pinned[:, k]) * gdim + k).astype(np.int32),
                Q.sub(k),
            )
            for k in range(gdim)
        ]

    def _fixed_components(
        self, V: fem.FunctionSpace, bcs: list[fem.DirichletBC]
    ) -> npt.NDArray[np.bool_]:
        """Return, for each local contact node, which Cartesian components are prescribed."""
        fixed = fem.Function(V)
        for bc in bcs:
            if bc_space_contains(V, bc):
                fixed.x.array[unrolled_bc_dofs(bc)] = 1.0
        fixed.x.scatter_forward()
        return fixed.x.array.reshape(-1, V.dofmap.index_map_bs)[self._parent_dofs] > 0.5

    def _set_hint(self, fixed: npt.NDArray[np.bool_], normals: npt.NDArray[np.floating]) -> None:
        """Point the hint along a single prescribed axis, else along the most tangential one."""
        axis = np.where(fixed.sum(axis=1) == 1, fixed.argmax(axis=1), abs(normals).argmin(axis=1))
        self.hint.x.array[:] = np.eye(normals.shape[1])[axis].ravel()
