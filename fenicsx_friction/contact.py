# SPDX-License-Identifier: MIT
"""One contact: a surface of the body, an obstacle and a friction law."""

import copy
from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from . import frame, laws
from .certificate import OPEN, NodalState
from .conditions import constrained
from .errors import ContactInputError
from .friction import FrictionLaw, Sliding
from .kinematics import Obstacle
from .surface import ContactSurface

#: A node with slip rows this fraction outside the cone is at a false root.
FALSE_ROOT = 1e-6
#: A node touches at gaps below this fraction of its facets' size.
TOUCH = 1e-8


class Contact:
    """Unilateral contact with friction of a surface against an obstacle.

    Args:
        surface: The contact surface of the body.
        obstacle: A rigid obstacle, or the surface of a deformable body.
        friction: The friction law.
        r_p: Scale (Pa/m) of the complementarity functions, the paper's ``r_p``. By default
            each node's diagonal bulk stiffness over its area, which is of the size of ``E/L_c``.

    Attributes:
        c: Multipliers ``(c_n, c_1[, c_2])``, tractions on the body in the contact frame (Pa).
        path: Length slid in contact up to the last accepted step (m).
        c_stick: Multipliers of the stick predictor, frozen for the slip corrector (Pa).
        r: The scale ``r_p`` at each node (Pa/m).
        slipping: 1 at the nodes where the corrector uses the slip rows (15), else 0.
        slip_increment: Slip of the last accepted step (m), global vectors of the owned nodes.
        slip_scale: The length of :func:`~fenicsx_friction.laws.blended_slip` (m).
        free: 1 for the free directions of the contact frame, 0 for the prescribed ones.
        hint: Direction whose tangential part is the first tangent.
        parent_dofs: The (blocked) dof of the displacement at each local node.
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
        # Contacts of one surface need spaces of their own: conditions go by space, and what one
        # contact pins would be pinned in all.
        surface = copy.copy(surface)
        surface.Q = surface.Q.clone()
        self.surface, self.obstacle, self.friction, self._r_p = surface, obstacle, friction, r_p
        Q, S = surface.Q, surface.S
        self.c = fem.Function(Q, name="contact_traction")
        self.c_stick = fem.Function(Q, name="stick_traction")
        self.free = fem.Function(Q, name="free_directions")
        self.free.x.array[:] = 1.0
        self.hint = fem.Function(Q, name="tangent_hint")
        self.path = fem.Function(S, name="slip_path")
        self.r = fem.Function(S, name="r_p")
        self.slipping = fem.Function(S, name="slipping")
        self.slip_scale = fem.Function(S, name="slip_scale")
        self.slip_scale.x.array[:] = 1.0

    def bind(self, u: fem.Function, u_old: fem.Function, dt: fem.Constant, normal: str) -> None:
        """Derive kinematics and law for the displacement ``u`` and its last accepted value.

        Args:
            u: Displacement.
            u_old: Displacement of the last accepted step.
            dt: Length of the step (s).
            normal: Name of the normal complementarity function.
        """
        if hasattr(self, "kinematics"):
            raise ContactInputError(
                f"Contact '{self.surface.name}' already belongs to a problem; make another Contact "
                "(its surface can be shared)."
            )
        self._u, self.parent_dofs = u, self.surface.parent_dofs(u.function_space)
        self._normal_row = laws.NORMAL_ROWS[normal]
        X = ufl.SpatialCoordinate(self.surface.mesh)
        kin = self.obstacle.kinematics(self, u, u_old)
        self.kinematics = kin
        # A prescribed tangential direction neither slips nor carries friction here.
        tangential = range(1, u.function_space.mesh.geometry.dim)
        slip = ufl.as_vector([self.free[k] * kin.slip[k - 1] for k in tangential])
        length = laws.norm(slip)
        self.sliding = Sliding(slip, self.path + length, length / dt, kin.tangents, X + u)
        c_t = ufl.as_vector([self.c[k] for k in tangential])
        stick = ufl.as_vector([self.c_stick[k] for k in tangential])
        # In the variables M^-1 c_t, M s every cone is a disk; |M| = 1 keeps their units.
        metric = self.friction.metric(self.sliding)
        self._scale = ufl.as_ufl(1.0)
        if metric is not None:
            self._scale = abs(ufl.det(metric)) ** (1.0 / len(tangential))
            metric = metric / self._scale
            slip, c_t = metric * slip, ufl.inv(metric) * c_t
            stick = ufl.inv(metric) * stick
        self._metric, self._slip, self._c_t, self._stick = metric, slip, c_t, stick
        pressure = self.c[0] - self.r * kin.gap
        limit = self._limit(laws.positive(pressure))
        limits = [limit, self.friction.limit(ufl.as_ufl(1.0), self.sliding)]
        limits.append(self._scale * self.friction.limit(self.c[0], self.sliding))
        # Beside the gap, because UFL folds mu = 0 to an expression that no form can hold.
        self._evaluate = self.evaluator(ufl.as_vector([kin.gap, *slip, *c_t, *limits]))
        self._traction = self.evaluator(kin.traction(self.c))
        self._normal = self.evaluator(kin.normal)
        self._slip_length = self.evaluator(ufl.as_vector([kin.gap, length]))
        way = sum((s * e for s, e in zip(self.sliding.slip, kin.tangents, strict=True)), 0 * X)
        self._slip_vector = self.evaluator(way)
        self.slip_increment: npt.NDArray[np.floating] = np.zeros((self.surface.num_owned, len(X)))
        self._position = self.evaluator(X + u)
        self._own_row = None
        if not self.friction.certifiable:
            row = self.friction.row(slip, c_t, limit, self.r, ufl.as_ufl(0.0))
            self._own_row = self.evaluator(ufl.as_vector([*row]))

    def _limit(self, pressure: Expr) -> Expr:
        """Return the law's limit in contact, zero where the node is open.

        Only what the limit is without pressure needs the switch: the rest vanishes with the
        pressure and must stay smooth with it.
        """
        H = laws.closed(self.kinematics.gap, self.c[0], self.r)
        adhesion = self.friction.limit(ufl.as_ufl(0.0), self.sliding)
        limit = self.friction.limit(pressure, self.sliding) - adhesion + H * adhesion
        return self._scale * limit

    # -- the rows of the three kinds of substep ------------------------------------------

    def stick_rows(self, eps: Expr) -> Expr:
        """Rows of the stick predictor, eq. (14); nothing sticks where there is no friction.

        Bodies that slide on what holds them would be held twice.
        """
        H = laws.closed(self.kinematics.gap, self.c[0], self.r)
        rough = ufl.gt(self.friction.limit(ufl.as_ufl(1.0), self.sliding), 0.0)
        H = ufl.conditional(rough, H, 0.0)
        return self._rows(eps, laws.stick_row(self._slip, self._c_t, self.r, H))

    def projection_rows(self, eps: Expr, xi: Expr) -> Expr:
        """Rows of the natural map, of the fraction ``1 - xi`` of the friction."""
        limit = (1.0 - xi) * self._limit(laws.ramp(self.c[0] - self.r * self.kinematics.gap, eps))
        return self._rows(eps, self.friction.row(self._slip, self._c_t, limit, self.r, eps))

    def slip_rows(self, eps: Expr, xi: Expr, sign: float) -> Expr:
        """Slip rows (15) at the ``slipping`` nodes, projection rows at the others."""
        w = laws.blended_slip(self._slip, self._stick, xi, self.slip_scale, sign)
        limit = self._scale * self.friction.limit(self.c[0], self.sliding)
        slip = laws.slip_row(self._c_t, limit, w, self.slip_scale)
        limit = self._limit(laws.positive(self.c[0] - self.r * self.kinematics.gap))
        other = self.friction.row(self._slip, self._c_t, limit, self.r, ufl.as_ufl(0.0))
        return self._rows(eps, self.slipping * slip + (1.0 - self.slipping) * other)

    def _rows(self, eps: Expr, tangential: Expr) -> Expr:
        """Stack the normal row on the tangential ones."""
        normal = self._normal_row(self.kinematics.gap, self.c[0], self.r, eps)
        if self._metric is not None:
            tangential = self._metric * tangential
        return ufl.as_vector([normal, *tangential])

    # -- nodal values --------------------------------------------------------------------

    def evaluator(self, expression: Expr) -> Callable[[], npt.NDArray[np.floating]]:
        """Return what evaluates a UFL expression at the owned nodes now, one row a node."""
        evaluate, update = self.surface.evaluator(expression), self.obstacle.update

        def values() -> npt.NDArray[np.floating]:
            """Follow the displacement and evaluate; collective."""
            update()
            return evaluate()

        return values

    def nodal(self) -> NodalState:
        """Return the nodal values of this rank's nodes, tractions in the law's disk variables."""
        n, d = self.surface.num_owned, self.surface.mesh.geometry.dim
        values = self._evaluate()
        own = None if self._own_row is None else np.linalg.norm(self._own_row(), axis=1)
        return NodalState(
            gap=values[:, 0],
            slip=values[:, 1:d],
            limit=values[:, 2 * d - 1],
            c=np.column_stack([self.c.x.array[: n * d : d], values[:, d : 2 * d - 1]]),
            r=self.r.x.array[:n].copy(),
            area=self.surface.area.x.array[:n].copy(),
            free=self.free.x.array[: n * d].reshape(n, d) > 0.5,
            own_map=own,
        )

    def gap_and_friction(self) -> tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]:
        """Return the owned nodes' gaps (m) and friction limits at unit pressure."""
        values = self._evaluate()
        return values[:, 0], values[:, -2]

    def nodal_position(self) -> npt.NDArray[np.floating]:
        """Return the owned nodes' current positions (m)."""
        return self._position()

    def nodal_normal(self) -> npt.NDArray[np.floating]:
        """Return the owned nodes' unit normals towards the body."""
        return self._normal()

    def nodal_traction(self) -> npt.NDArray[np.floating]:
        """Return the owned nodes' traction vectors on the body in global axes (Pa)."""
        return self._traction()

    def stiffness_force(self) -> npt.NDArray[np.floating]:
        """Return stiffness times displacement (N) at each owned node, which rounding goes with."""
        n, bs = self.surface.num_owned, self._u.function_space.dofmap.index_map_bs
        u = self._u.x.array.reshape(-1, bs)[self.parent_dofs[:n]]
        stiffness = self.r.x.array[:n] * self.surface.area.x.array[:n]
        return np.asarray(stiffness * np.linalg.norm(u, axis=1))

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

    # -- the slip corrector of the paper -----------------------------------------------------

    def freeze_stick(self, *, violated_only: bool = True) -> int:
        """Freeze the stick traction for the slip rows and choose the nodes that get them.

        Args:
            violated_only: Choose the nodes whose stick traction leaves the cone, or else all nodes
                in contact (without a stick traction eq. (12) would be 0/0).

        Returns:
            How many owned nodes were chosen.
        """
        n, state = self.surface.num_owned, self.nodal()
        traction = np.linalg.norm(state.c[:, 1:], axis=1)
        chosen = (traction > 0.0) & (state.c[:, 0] >= state.r * state.gap)
        if violated_only:
            chosen &= traction > state.limit
        self.c_stick.x.array[:] = self.c.x.array
        self.slipping.x.array[:n] = chosen
        # The elastic displacement under the stick force: a slip length free of units.
        self.slip_scale.x.array[:n] = np.where(chosen, traction / state.r, 1.0)
        self.slipping.x.scatter_forward()
        self.slip_scale.x.scatter_forward()
        return int(np.sum(chosen))

    def has_false_root(self) -> bool:
        """Tell whether a node with slip rows is outside the cone; collective.

        ``c_t |w| + mu c_n w = 0`` holds at ``w = 0`` for any traction.
        """
        n = self.surface.num_owned
        traction = np.linalg.norm(self.nodal().c[:, 1:], axis=1)
        limit = self._evaluate()[:, -1]
        slack = FALSE_ROOT * np.max(traction, initial=0.0)
        outside = traction > limit * (1.0 + FALSE_ROOT) + slack
        found = np.any(outside & (self.slipping.x.array[:n] > 0.5))
        return bool(self.surface.mesh.comm.allreduce(bool(found), MPI.LOR))

    # -- from step to step ---------------------------------------------------------------------

    def commit(self) -> None:
        """Keep the slip of the accepted step and add that of nodes in contact to the path."""
        n = self.surface.num_owned
        self.slip_increment = self._slip_vector()
        closed = self.nodal().states() != OPEN
        self.path.x.array[:n] += np.where(closed, self._slip_length()[:, 1], 0.0)
        self.path.x.scatter_forward()

    def refresh_frames(self) -> None:
        """Choose other first tangents where a frame became ill-defined, and turn ``c`` to them."""
        d, n = self.surface.mesh.geometry.dim, self.surface.num_owned
        if d == 2:
            return
        hints = self.hint.x.array.reshape(-1, d)
        normals = self._normals()
        steep = frame.steep_hints(normals, hints) & (self._fixed.sum(axis=1) != 1)
        if not self.surface.mesh.comm.allreduce(bool(np.any(steep)), MPI.LOR):
            return
        traction = self.nodal_traction()
        hints[steep] = frame.choose_hints(normals, self._fixed)[steep]
        vectors = [self.evaluator(e)() for e in self.kinematics.tangents]
        c = self.c.x.array.reshape(-1, d)
        for k, e in enumerate(vectors):
            c[:n, k + 1] = np.einsum("ij,ij->i", traction, e)
        self.c.x.scatter_forward()

    # -- set-up from the boundary conditions and the bulk stiffness ------------------------

    def set_scale(self, stiffness_diagonal: fem.Function) -> None:
        """Set ``r_p`` at each node from the diagonal of the bulk stiffness (N/m)."""
        V = stiffness_diagonal.function_space
        bs = V.dofmap.index_map_bs
        if self._r_p is not None:
            self.r.x.array[:] = self._r_p
            return
        diagonal = stiffness_diagonal.x.array.reshape(-1, bs)[self.parent_dofs].mean(axis=1)
        self.r.x.array[:] = diagonal / self.surface.area.x.array
        self.r.x.scatter_forward()

    def close_touching(self) -> None:
        """Start nodes that touch, but for rounding, as closed ones.

        Open at the first iteration, they would hold a body that nothing else holds too late.
        """
        gap = self.nodal().gap
        n, d = len(gap), self.surface.mesh.geometry.dim
        touch = TOUCH * self.surface.area.x.array[:n] ** (1.0 / (d - 1))
        c_n = self.c.x.array[: n * d : d]
        touching = (c_n == 0.0) & (abs(gap) < touch) & (self.free.x.array[: n * d : d] > 0.5)
        c_n[touching] = 2.0 * self.r.x.array[:n][touching] * touch[touching]
        self.c.x.scatter_forward()

    def scale_r(self, factor: float) -> None:
        """Multiply ``r_p`` at all nodes."""
        self.r.x.array[:] *= factor

    def pin_prescribed(
        self, V: fem.FunctionSpace, bcs: list[fem.DirichletBC]
    ) -> list[fem.DirichletBC]:
        """Choose the frames and constrain the multipliers of prescribed directions to zero.

        Returns:
            The homogeneous conditions on the multipliers, one a component.
        """
        Q, gdim = self.surface.Q, V.mesh.geometry.dim
        self._fixed = self._fixed_components(V, bcs)
        normals = self._normals()
        self.hint.x.array[:] = frame.choose_hints(normals, self._fixed).ravel()
        pinned = frame.pinned_directions(normals, self._fixed)
        self.free.x.array[:] = np.where(pinned, 0.0, 1.0).ravel()
        return [
            fem.dirichletbc(
                0.0, (np.flatnonzero(pinned[:, k]) * gdim + k).astype(np.int32), Q.sub(k)
            )
            for k in range(gdim)
        ]

    def _normals(self) -> npt.NDArray[np.floating]:
        """Return the normals of owned and ghost nodes."""
        gdim = self.surface.mesh.geometry.dim
        normal = fem.Function(self.surface.Q)
        normal.x.array.reshape(-1, gdim)[: self.surface.num_owned] = self._normal()
        normal.x.scatter_forward()
        return np.asarray(normal.x.array.reshape(-1, gdim))

    def _fixed_components(
        self, V: fem.FunctionSpace, bcs: list[fem.DirichletBC]
    ) -> npt.NDArray[np.bool_]:
        """Return, for each local contact node, which Cartesian components are prescribed."""
        fixed = constrained(V, bcs)
        nodes = fixed.x.array.reshape(-1, V.dofmap.index_map_bs)[self.parent_dofs] > 0.5
        both = fem.Function(self.surface.Q)
        owned = self.obstacle.prescribed(fixed, nodes[: self.surface.num_owned])
        both.x.array[: owned.size] = owned.ravel()
        both.x.scatter_forward()
        return np.asarray(both.x.array.reshape(nodes.shape) > 0.5)
