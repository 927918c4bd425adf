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

from ..base.domains import not_finite
from ..base.errors import ContactInputError
from ..base.validators import instance, number
from ..certificate.nodal_state import OPEN, NodalState
from ..laws import rows
from ..laws.friction import FrictionLaw, Sliding
from ..obstacles.obstacle import Obstacle
from ..surfaces.surface import ContactSurface
from . import frame

#: A node with slip rows this fraction outside the cone is at a false root.
FALSE_ROOT = 1e-6
#: A node touches at gaps below this fraction of its facets' size.
TOUCH = 1e-8
#: The scale is that of the primary surface from this ratio on.
MUCH_SOFTER = 0.1
#: Sine of the angle between a held direction and the tangent plane that passes for rounding, and
#: for the facets of a curved surface.
OBLIQUE, OBLIQUE_FACES = 1e-6, 0.3


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
        r: The scale ``r_p`` at each node (Pa/m), of the rows that are solved.
        scale: The stiffness of the bulk over the area (Pa/m): the scale of the certificate,
            whatever ``r_p`` is.
        slipping: 1 at the nodes where the corrector uses the slip rows (15), else 0.
        accepted: Nodal values of the last accepted step, or ``None``.
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
        instance(surface, ContactSurface, "surface", "a ContactSurface(mesh, facet_tags, tag)")
        instance(obstacle, Obstacle, "obstacle", "RigidPlane(point, normal) or another obstacle")
        instance(friction, FrictionLaw, "friction", "a law such as Coulomb(0.3)")
        if r_p is not None:
            number(r_p, "r_p (Pa/m)", above=0.0)
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
        self.scale = fem.Function(S, name="scale")
        self.slipping = fem.Function(S, name="slipping")
        self.slip_scale = fem.Function(S, name="slip_scale")
        self.slip_scale.x.array[:] = 1.0
        self.accepted: NodalState | None = None

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
        self._normal_row = rows.NORMAL_ROWS[normal]
        X = ufl.SpatialCoordinate(self.surface.mesh)
        kin = self.obstacle.kinematics(self, u, u_old)
        self.kinematics = kin
        # A prescribed tangential direction neither slips nor carries friction here.
        tangential = range(1, u.function_space.mesh.geometry.dim)
        slip = ufl.as_vector([self.free[k] * kin.slip[k - 1] for k in tangential])
        length = rows.norm(slip)
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
        pressure = self.c[0] - self.scale * kin.gap
        limit = self._limit(rows.positive(pressure))
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
            row = self.friction.row(slip, c_t, limit, self.scale, ufl.as_ufl(0.0))
            self._own_row = self.evaluator(ufl.as_vector([*row]))

    def _limit(self, pressure: Expr) -> Expr:
        """Return the law's limit in contact, zero where the node is open.

        Only what the limit is without pressure needs the switch: the rest vanishes with the
        pressure and must stay smooth with it.
        """
        H = rows.closed(self.kinematics.gap, self.c[0], self.r)
        adhesion = self.friction.limit(ufl.as_ufl(0.0), self.sliding)
        limit = self.friction.limit(pressure, self.sliding) - adhesion + H * adhesion
        return self._scale * limit

    # -- the rows of the three kinds of substep ------------------------------------------

    def stick_rows(self, eps: Expr) -> Expr:
        """Rows of the stick predictor, eq. (14); nothing sticks where there is no friction.

        Bodies that slide on what holds them would be held twice.
        """
        H = rows.closed(self.kinematics.gap, self.c[0], self.r)
        rough = ufl.gt(self.friction.limit(ufl.as_ufl(1.0), self.sliding), 0.0)
        H = ufl.conditional(rough, H, 0.0)
        return self._rows(eps, rows.stick_row(self._slip, self._c_t, self.r, H))

    def projection_rows(self, eps: Expr, xi: Expr) -> Expr:
        """Rows of the natural map, of the fraction ``1 - xi`` of the friction."""
        limit = (1.0 - xi) * self._limit(rows.ramp(self.c[0] - self.r * self.kinematics.gap, eps))
        return self._rows(eps, self.friction.row(self._slip, self._c_t, limit, self.r, eps))

    def slip_rows(self, eps: Expr, xi: Expr, sign: Expr) -> Expr:
        """Slip rows (15) at the ``slipping`` nodes, projection rows at the others."""
        w = rows.blended_slip(self._slip, self._stick, xi, self.slip_scale, sign)
        limit = self._scale * self.friction.limit(self.c[0], self.sliding)
        slip = rows.slip_row(self._c_t, limit, w, self.slip_scale)
        limit = self._limit(rows.positive(self.c[0] - self.r * self.kinematics.gap))
        other = self.friction.row(self._slip, self._c_t, limit, self.r, ufl.as_ufl(0.0))
        return self._rows(eps, self.slipping * slip + (1.0 - self.slipping) * other)

    def _rows(self, eps: Expr, tangential: Expr) -> Expr:
        """Stack the normal row on the tangential ones; prescribed directions carry nothing."""
        normal = self._normal_row(self.kinematics.gap, self.c[0], self.r, eps)
        if self._metric is not None:
            tangential = self._metric * tangential
        stacked = [normal, *tangential]
        return ufl.as_vector(
            [self.free[k] * row + (1.0 - self.free[k]) * self.c[k] for k, row in enumerate(stacked)]
        )

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
        """Return the nodal values of the last accepted step, the present ones before the first."""
        return self.present() if self.accepted is None else self.accepted

    def present(self) -> NodalState:
        """Evaluate this rank's nodes, tractions in the law's disk variables; collective."""
        n, d = self.surface.num_owned, self.surface.mesh.geometry.dim
        values = self._evaluate()
        own = None if self._own_row is None else np.linalg.norm(self._own_row(), axis=1)
        if self.obstacle.lost is not None:
            values[self.obstacle.lost, 0] = np.nan  # never certified
        return NodalState(
            gap=values[:, 0],
            slip=values[:, 1:d],
            limit=values[:, 2 * d - 1],
            c=np.column_stack([self.c.x.array[: n * d : d], values[:, d : 2 * d - 1]]),
            r=self.nodal_scale().copy(),
            area=self.nodal_area().copy(),
            free=self.free.x.array[: n * d].reshape(n, d) > 0.5,
            own_map=own,
        )

    def nodal_area(self) -> npt.NDArray[np.floating]:
        """Return the areas of the owned nodes."""
        return self.surface.area.x.array[: self.surface.num_owned]

    def nodal_scale(self) -> npt.NDArray[np.floating]:
        """Return the stiffness over the area (Pa/m) of the owned nodes."""
        return self.scale.x.array[: self.surface.num_owned]

    def multipliers(self) -> npt.NDArray[np.floating]:
        """Return the multipliers (Pa) of the owned nodes, one row a node."""
        n, d = self.surface.num_owned, self.surface.mesh.geometry.dim
        return self.c.x.array[: n * d].reshape(n, d)

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

    def distance(self) -> npt.NDArray[np.floating]:
        """Return how far each owned node has moved (m)."""
        n, bs = self.surface.num_owned, self._u.function_space.dofmap.index_map_bs
        u = self._u.x.array.reshape(-1, bs)[self.parent_dofs[:n]]
        return np.asarray(np.linalg.norm(u, axis=1))

    def check_friction(self) -> None:
        """Raise a ContactInputError, on all ranks, unless the friction limit is ``>= 0``."""
        _, limit = self.gap_and_friction()
        bad = [
            f"{value:g} at ({', '.join(f'{xi:.6g}' for xi in x)})"
            for x, value in zip(self.surface.x, limit, strict=True)
            if not 0.0 <= value < np.inf
        ]
        found = [part for part in self.surface.mesh.comm.allgather(bad) if part]
        if found:
            holding = not_finite(self.friction.limit(ufl.as_ufl(1.0), self.sliding))
            raise ContactInputError(
                f"Contact '{self.surface.name}': the friction limit at unit pressure (mu) must be "
                f">= 0 and finite at every contact node; it is {found[0][0]}{holding}."
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
        n, state = self.surface.num_owned, self.present()
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
        traction = np.linalg.norm(self.present().c[:, 1:], axis=1)
        limit = self._evaluate()[:, -1]
        slack = FALSE_ROOT * np.max(traction, initial=0.0)
        outside = traction > limit * (1.0 + FALSE_ROOT) + slack
        found = np.any(outside & (self.slipping.x.array[:n] > 0.5))
        return bool(self.surface.mesh.comm.allreduce(bool(found), MPI.LOR))

    # -- from step to step ---------------------------------------------------------------------

    def commit(self) -> None:
        """Keep the accepted step and add the slip of nodes in contact to the path."""
        n = self.surface.num_owned
        self.accepted = self.present()
        self.slip_increment = self._slip_vector()
        closed = self.accepted.states() != OPEN
        self.path.x.array[:n] += np.where(closed, self._slip_length()[:, 1], 0.0)
        self.path.x.scatter_forward()

    def choose_frames(self) -> None:
        """Choose anew what is prescribed of each frame, and its first tangent; collective.

        Frames change where the normal has turned or other faces are met; the multipliers turn with
        them.

        Raises:
            ContactInputError: If a node is held in a direction that is neither normal nor
                tangential, so that its friction could not be told from the reaction.
        """
        d, n = self.surface.mesh.geometry.dim, self.surface.num_owned
        fixed, normals = self._fixed_components(), self._normals()
        self._refuse_oblique(fixed[:n], normals[:n])
        free = np.where(frame.pinned_directions(normals, fixed), 0.0, 1.0)
        hints = self.hint.x.array.reshape(-1, d)
        changed = np.any(free != self.free.x.array.reshape(-1, d), axis=1)
        changed |= frame.steep_hints(normals, hints) & (fixed.sum(axis=1) != 1)
        if not self.surface.mesh.comm.allreduce(bool(np.any(changed)), MPI.LOR):
            return
        traction = self.nodal_traction()
        self.free.x.array[:] = free.ravel()
        hints[changed] = frame.choose_hints(normals, fixed)[changed]
        self.obstacle.update()
        c, turned = self.c.x.array.reshape(-1, d), changed[:n]
        for k, tangent in enumerate(self._tangents):
            along = np.einsum("ij,ij->i", traction, tangent())
            c[:n, k + 1][turned] = along[turned]
        c[:n] *= free[:n]
        self.c.x.scatter_forward()

    # -- set-up from the boundary conditions and the bulk stiffness ------------------------

    def set_scale(self, stiffness_diagonal: fem.Function) -> None:
        """Set the scales at each node from the diagonal of the bulk stiffness (N/m)."""
        V = stiffness_diagonal.function_space
        bs = V.dofmap.index_map_bs
        diagonal = stiffness_diagonal.x.array.reshape(-1, bs).mean(axis=1)
        scale = diagonal[self.parent_dofs] / self.surface.area.x.array
        # A stiff body follows a soft one: the softer decides what a gap is worth.
        softer = self.obstacle.stiffness(diagonal, V)
        self.scale.x.array[:] = np.where(softer < MUCH_SOFTER * scale, softer, scale)
        self.scale.x.scatter_forward()
        self.r.x.array[:] = self.scale.x.array if self._r_p is None else self._r_p

    def close_touching(self) -> None:
        """Start nodes that touch, but for rounding, as closed ones.

        Open at the first iteration, they would hold a body that nothing else holds too late.
        """
        n, d = self.surface.num_owned, self.surface.mesh.geometry.dim
        gap, touch = self.gap_and_friction()[0], self._touch()
        c_n = self.c.x.array[: n * d : d]
        touching = (c_n == 0.0) & (abs(gap) < touch) & (self.free.x.array[: n * d : d] > 0.5)
        c_n[touching] = 2.0 * self.r.x.array[:n][touching] * touch[touching]
        self.c.x.scatter_forward()

    def scale_r(self, factor: float) -> None:
        """Multiply ``r_p`` at all nodes."""
        self.r.x.array[:] *= factor

    def hold(self, held: fem.Function) -> None:
        """Set up the frames under the conditions; collective.

        Args:
            held: 1 at the dofs of the displacement under a condition, else 0.
        """
        self._held = held
        self._tangents = [self.evaluator(e) for e in self.kinematics.tangents]
        normals = self._normals()
        self.hint.x.array[:] = frame.choose_hints(normals, self._fixed_components()).ravel()
        self.choose_frames()
        self._overlap = np.maximum(-self.gap_and_friction()[0], 0.0) + self._touch()

    def pushed(self, state: NodalState) -> float:
        """Return how far conditions push held nodes into the obstacle (m), on this rank.

        How deep they were at the beginning, by the facets of a mesh, say, does not count.
        """
        deeper = np.where(state.takes_part, 0.0, -state.gap - self._overlap)
        return float(np.max(deeper, initial=0.0))

    def _touch(self) -> npt.NDArray[np.floating]:
        """Return the gap (m) below which a node touches, for each owned node."""
        d = self.surface.mesh.geometry.dim
        return np.asarray(TOUCH * self.nodal_area() ** (1.0 / (d - 1)))

    def _refuse_oblique(
        self, fixed: npt.NDArray[np.bool_], normals: npt.NDArray[np.floating]
    ) -> None:
        """Refuse nodes with friction that are held obliquely to the surface; collective."""
        most = OBLIQUE_FACES if self.obstacle.deformable else OBLIQUE
        rough = self.gap_and_friction()[1] > 0.0
        bad = np.flatnonzero(frame.oblique(normals, fixed, most) & rough)
        where = [", ".join(f"{xi:.6g}" for xi in self.surface.x[i][: len(normals[i])]) for i in bad]
        found = [x for part in self.surface.mesh.comm.allgather(where) for x in part]
        if found:
            raise ContactInputError(
                f"Contact '{self.surface.name}': boundary conditions hold {len(found)} nodes in a "
                f"direction that is neither normal nor tangential to the obstacle, the first at "
                f"({found[0]}); their friction cannot be told from the reaction. Hold these nodes "
                "in whole, leave them out of the surface, or take Frictionless()."
            )

    def _normals(self) -> npt.NDArray[np.floating]:
        """Return the normals of owned and ghost nodes."""
        gdim = self.surface.mesh.geometry.dim
        normal = fem.Function(self.surface.Q)
        normal.x.array.reshape(-1, gdim)[: self.surface.num_owned] = self._normal()
        normal.x.scatter_forward()
        return np.asarray(normal.x.array.reshape(-1, gdim))

    def _fixed_components(self) -> npt.NDArray[np.bool_]:
        """Return, for each local contact node, which Cartesian components are prescribed."""
        bs = self._held.function_space.dofmap.index_map_bs
        nodes = self._held.x.array.reshape(-1, bs)[self.parent_dofs] > 0.5
        both = fem.Function(self.surface.Q)
        owned = self.obstacle.prescribed(self._held, nodes[: self.surface.num_owned])
        both.x.array[: owned.size] = owned.ravel()
        both.x.scatter_forward()
        return np.asarray(both.x.array.reshape(nodes.shape) > 0.5)
