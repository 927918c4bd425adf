# SPDX-License-Identifier: MIT
"""One contact: a surface of the body, an obstacle and a friction law."""

import copy

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from ..base.errors import ContactInputError
from ..base.validators import instance, number
from ..certificate.nodal_state import OPEN, NodalState
from ..laws.friction import FrictionLaw
from ..obstacles.kinematics import Array
from ..obstacles.obstacle import Obstacle
from ..obstacles.side import Side
from ..surfaces.nodal_kernel import NodalKernel
from ..surfaces.surface import ContactSurface
from .law_rows import LawRows
from .prescribed import Prescribed, touch
from .stiffness import over_area


class Contact:
    """Unilateral contact with friction of a surface against an obstacle.

    Args:
        surface: The contact surface of the body.
        obstacle: A rigid obstacle, or the surface of a deformable body.
        friction: The friction law.
        r_p: Scale (Pa/m) of the complementarity functions, the paper's ``r_p``. By default each
            node's stiffness over area, of the size of ``E/L_c``; less at first on fine meshes.

    Attributes:
        c: Multipliers ``(c_n, c_1[, c_2])``, tractions on the body in the contact frame (Pa).
        path: Length slid in contact up to the last accepted step (m).
        c_rate: Change of ``c`` in the last accepted step over its length (Pa/s).
        c_stick: Multipliers of the stick predictor, frozen for the slip corrector (Pa).
        r_p: As given.
        r: The scale ``r_p`` at each node (Pa/m), of the rows that are solved.
        scale: The stiffness of the bulk over the area (Pa/m): the scale of the certificate.
        felt: The same where neighbours give way, if that is far less (Pa/m).
        slipping: 1 at the nodes where the corrector uses the slip rows (15), else 0.
        accepted: Nodal values of the last accepted step, or ``None``.
        slip_increment: Slip of the last accepted step (m), global vectors of the owned nodes.
        bonded: 1 at the nodes that neither open nor slide, see ``tie``, else 0.
        slip_scale: The length of :func:`~fenicsx_friction.laws.blended_slip` (m).
        free: 1 for the free directions of the contact frame, 0 for the prescribed ones.
        hint: Direction whose tangential part is the first tangent.
        parent_dofs: The (blocked) dof of the displacement at each local node.
        pairing: What each node meets of the obstacle.
        rows: The rows of contact and friction in UFL.
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
        surface = copy.copy(surface)
        surface.Q = surface.Q.clone()  # DOLFINx applies conditions by space
        self.surface, self.obstacle, self.friction, self.r_p = surface, obstacle, friction, r_p
        Q, S = surface.Q, surface.S
        self.c = fem.Function(Q, name="contact_traction")
        vectors = ("contact_traction_rate", "stick_traction", "free_directions", "tangent_hint")
        self.c_rate, self.c_stick, self.free, self.hint = (fem.Function(Q, name=n) for n in vectors)
        self.free.x.array[:] = 1.0
        self.path = fem.Function(S, name="slip_path")
        names = ("r_p", "scale", "felt", "slipping", "bonded", "slip_scale")
        scalars = (fem.Function(S, name=n) for n in names)
        self.r, self.scale, self.felt, self.slipping, self.bonded, self.slip_scale = scalars
        self.slip_scale.x.array[:] = 1.0
        self.accepted: NodalState | None = None
        self._bound = False

    # -- set-up ----------------------------------------------------------------------------------

    def bind(self, u: fem.Function, u_old: fem.Function, dt: fem.Constant, normal: str) -> None:
        """Pair the nodes and derive the rows for a displacement; collective.

        Args:
            u: Displacement.
            u_old: Displacement of the last accepted step.
            dt: Length of the step (s).
            normal: Name of the normal complementarity function.
        """
        if self._bound:
            raise ContactInputError(
                f"Contact '{self.surface.name}' already belongs to a problem; make another Contact "
                "(its surface can be shared)."
            )
        self._bound = True
        self._u, self.parent_dofs = u, self.surface.parent_dofs(u.function_space)
        side = Side(self.surface, u, u_old, self.c, self.hint, self.felt, self.parent_dofs)
        self.pairing = self.obstacle.meet(side)
        law = self.friction.on(self.surface.mesh)
        self.rows = LawRows(self.pairing.kinematics, law, self, dt, normal)
        self._nodal = NodalKernel(self.surface, self.rows.nodal)
        self._own_row, self._metric = (
            None if values is None else NodalKernel(self.surface, values)
            for values in (self.rows.own_row, self.rows.metric)
        )
        self._reach: NodalKernel | None = None
        self.slip_increment: Array = np.zeros((self.surface.num_owned, side.d))

    def set_scale(self, diagonal: fem.Function, felt: fem.Function) -> None:
        """Set the scales at each node; collective.

        Args:
            diagonal: Diagonal of the bulk stiffness (N/m).
            felt: What the nodes feel of it, see ``felt_stiffness`` (N/m).
        """
        for scale, stiffness in ((self.scale, diagonal), (self.felt, felt)):
            scale.x.array[:] = over_area(stiffness, self.surface, self.parent_dofs, self.pairing)
            scale.x.scatter_forward()
        self.r.x.array[:] = self.felt.x.array if self.r_p is None else self.r_p

    def hold(self, held: fem.Function) -> None:
        """Set up the frames under the conditions; collective.

        Args:
            held: 1 at the dofs of the displacement under a condition, else 0.
        """
        self._prescribed = Prescribed(self.pairing, self.free, held)
        self.choose_frames()
        self._prescribed.start()

    def choose_frames(self, driven: npt.NDArray | None = None) -> None:
        """Choose the frames anew, see ``Prescribed.choose``; collective."""
        self._prescribed.choose(self._rough, driven)

    def _rough(self) -> npt.NDArray[np.bool_]:
        """Tell which nodes may have friction, at whatever pressure and slip; collective."""
        self.pairing.update()
        self._reach = self._reach or NodalKernel(self.surface, self.rows.reach)  # few ask for it
        return np.asarray(~np.all(self._reach.values() <= 0.0, axis=1))

    def close_touching(self) -> None:
        """Close nodes that touch up to rounding, before Newton's method starts; collective.

        Otherwise the first Newton matrix is singular where only contact holds a body.
        """
        n, near, c = self.surface.num_owned, touch(self.pairing), self.multipliers()
        touching = (c[:, 0] == 0.0) & (abs(self.pairing.gaps()) < near)
        touching &= self.pairing.side.nodal(self.free)[:, 0] > 0.5
        c[touching, 0] = 2.0 * self.r.x.array[:n][touching] * near[touching]
        self.c.x.scatter_forward()

    def scale_r(self, factor: float) -> None:
        """Multiply ``r_p`` at all nodes."""
        self.r.x.array[:] *= factor

    # -- nodal values, one row an owned node -----------------------------------------------------

    def nodal(self) -> NodalState:
        """Return the nodal values of the last accepted step, the present ones before the first."""
        return self.present() if self.accepted is None else self.accepted

    def present(self) -> NodalState:
        """Evaluate this rank's nodes, tractions in the law's disk variables; collective."""
        d, values = self.pairing.side.d, self._values()
        own = None if self._own_row is None else np.linalg.norm(self._own_row.values(), axis=1)
        if self.pairing.lost is not None:
            values[self.pairing.lost, 0] = np.nan  # never certified
        return NodalState(
            gap=values[:, 0],
            slip=values[:, 1:d],
            limit=values[:, 2 * d - 1],
            c=np.column_stack([self.multipliers()[:, 0], values[:, d : 2 * d - 1]]),
            r=self.nodal_scale().copy(),
            area=self.pairing.acting_area().copy(),
            free=self.pairing.side.nodal(self.free) > 0.5,
            own_map=own,
            bonded=self.bonded.x.array[: self.surface.num_owned] > 0.5,
        )

    def nodal_area(self) -> Array:
        """Return the areas."""
        return self.pairing.area()

    def nodal_scale(self) -> Array:
        """Return the stiffness over the area (Pa/m)."""
        return self.scale.x.array[: self.surface.num_owned]

    def multipliers(self) -> Array:
        """Return the multipliers (Pa)."""
        return self.pairing.side.nodal(self.c)

    def friction_without_pressure(self) -> Array:
        """Return the friction limits at no pressure (Pa); collective."""
        return self._values()[:, -4]

    def friction_at_unit_pressure(self) -> Array:
        """Return the friction limits at unit pressure; collective."""
        return self._values()[:, -3]

    def metrics(self) -> Array | None:
        """Return the metric tensors of the law, or ``None`` for the identity; collective."""
        if self._metric is None:
            return None
        self.pairing.update()
        d = self.pairing.side.d - 1
        return self._metric.values().reshape(-1, d, d)

    def nodal_traction(self) -> Array:
        """Return the traction vectors on the body in global axes (Pa); collective."""
        return self.pairing.traction()

    def limit_at_multiplier(self) -> Array:
        """Return the friction limits at the multiplier ``c_n`` (Pa); collective."""
        return self._values()[:, -2]

    def distance(self) -> Array:
        """Return how far each node has moved (m)."""
        return np.asarray(np.linalg.norm(self.pairing.side.owned(self._u.x.array), axis=1))

    def pushed(self, state: NodalState) -> float:
        """Return how far conditions push held nodes into the obstacle (m), on this rank."""
        return self._prescribed.pushed(state)

    def _values(self) -> Array:
        """Return the entries of ``rows.nodal``; collective."""
        self.pairing.update()
        return self._nodal.values()

    # -- from step to step -----------------------------------------------------------------------

    def anchor(self) -> None:
        """Begin an increment at the last accepted displacement; collective."""
        if self._bound:
            self.pairing.anchor()

    def commit(self) -> None:
        """Keep the accepted step and add the slip of nodes in contact to the path; collective."""
        n, side = self.surface.num_owned, self.pairing.side
        self.accepted = self.present()
        frames, free = self.pairing.frames()[:, 1:], side.nodal(self.free)[:, 1:]
        slip: npt.NDArray = free * self.pairing.slips()
        self.slip_increment = np.einsum("nk,nkd->nd", slip, frames)
        closed = self.accepted.states() != OPEN
        self.path.x.array[:n] = np.where(closed, self._values()[:, -1], self.path.x.array[:n])
        self.path.x.scatter_forward()
