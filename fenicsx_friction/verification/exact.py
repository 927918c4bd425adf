# SPDX-License-Identifier: MIT
"""The exact solution of a small-strain problem: condense on the contact nodes, solve the SOCLCP.

Independent of the two-stage algorithm: the bulk enters through one assembled matrix, friction
through :mod:`fenicsx_friction.verification.soclcp` (Kanno, Martins and Pinto da Costa, IJNME
65:62-83, 2006).
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse.linalg as spla
import ufl
from dolfinx import fem
from scipy.sparse import csr_matrix

from ..base.compilation import compiled
from ..base.errors import ContactInputError
from ..base.validators import instance
from ..laws.friction import Coulomb
from ..problem import FrictionalContactProblem
from ..surfaces.elements import nodal_on_facets
from .soclcp import Increment, solve_increment

Array = npt.NDArray[np.floating]
#: The bulk counts as linear if its residual is this close to ``K u - b``, relative.
LINEAR = 1e-9


@dataclass(frozen=True)
class ExactIncrement:
    """The exact solution of an increment at the contact nodes, in the order of the surface.

    Attributes:
        c: Tractions ``(c_n, c_t)`` on the body in the contact frame (Pa).
        u: Displacements in global axes (m).
        gap: Gaps (m).
        slip: Slip increments (m).
        residual: Relative natural residual of the condensed problem.
        iterations: Newton iterations of the SOCLCP solver.
    """

    c: Array
    u: Array
    gap: Array
    slip: Array
    residual: float
    iterations: int


class ExactReference:
    """Exact solutions of a linear elastic problem with one contact against a plane; serial.

    It follows the loads and boundary values of the problem, and keeps a history of its own. It
    starts from ``u_old`` and does not change the problem's unknowns.

    Args:
        problem: The problem, with a bulk residual linear in ``u`` and Coulomb friction.

    Raises:
        ContactInputError: If the problem is not of this kind.
    """

    def __init__(self, problem: FrictionalContactProblem) -> None:
        instance(problem, FrictionalContactProblem, "problem", "a FrictionalContactProblem")
        if problem.comm.size > 1:
            raise ContactInputError("The exact reference is serial; build it on MPI.COMM_SELF.")
        if len(problem.contacts) != 1 or len(problem.unknowns) != 1:
            raise ContactInputError("The exact reference takes one contact and one unknown u.")
        (contact,) = problem.contacts
        law = contact.friction
        if not isinstance(law, Coulomb) or law.cap is not None or law.adhesion != 0.0:
            raise ContactInputError("The exact reference knows Coulomb's law only.")
        if contact.surface.degree == 1 and not nodal_on_facets(problem.u.function_space):
            raise ContactInputError(
                "The exact reference knows contact at nodes, not on average: take a displacement "
                "of degree 1, or ContactSurface(..., degree=2) where there is one."
            )
        if np.any(contact.bonded.x.array > 0.5):
            raise ContactInputError("The exact reference knows no tied nodes: release them.")
        if contact.obstacle.motion is not None:
            raise ContactInputError("The exact reference needs an obstacle at rest.")
        self._problem, self._contact = problem, contact
        V = problem.u.function_space
        d = V.mesh.geometry.dim
        self._residual = compiled(fem.form, problem.comm)(problem.bulk)
        self._K = _stiffness(problem)
        self._C = (contact.parent_dofs[:, None] * d + np.arange(d)).ravel()
        self._D = problem.constrained_dofs
        self._I = np.setdiff1d(np.arange(self._K.shape[0]), np.union1d(self._C, self._D))
        self._lu = spla.splu(self._K[self._I][:, self._I].tocsc())
        self._KCI = self._K[self._C][:, self._I]
        K_IC = self._K[self._I][:, self._C].toarray()
        self._S = self._K[self._C][:, self._C].toarray() - self._KCI @ self._lu.solve(K_IC)
        with self._displacement(np.zeros(self._K.shape[0])):
            self._gap = contact.pairing.gaps().copy()
            self._frames = contact.pairing.frames()
        self._held = self._held_directions()
        old = problem.u_old.x.array[self._C].reshape(-1, d)
        self._previous = np.einsum("nkj,nj->nk", self._frames, old)[:, 1:]

    def advance(self) -> ExactIncrement:
        """Solve the increment from the last one to the current loads and boundary values.

        Raises:
            ContactInputError: If the bulk residual is not linear in ``u``.
            NoExactSolution: If no solution was certified to 1e-10.
        """
        stiffness, load, free = self._increment()
        solution = solve_increment(
            Increment(
                stiffness=stiffness,
                load=load,
                gap=self._gap,
                previous=self._previous,
                mu=self._contact.friction_at_unit_pressure(),
                free=free,
            )
        )
        self._previous = solution.displacement[:, 1:].copy()
        return ExactIncrement(
            c=solution.force / self._contact.surface.area.x.array[:, None],
            u=np.einsum("nkj,nk->nj", self._frames, solution.displacement),
            gap=solution.gap,
            slip=solution.slip,
            residual=solution.residual,
            iterations=solution.iterations,
        )

    def _increment(self) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
        """Condense loads and boundary values; return stiffness, load and free directions."""
        n, d = self._frames.shape[:2]
        values = fem.Function(self._problem.u.function_space)
        for bc in self._problem.bcs:
            bc.set(values.x.array)
        prescribed = np.where(np.isin(self._C, self._D), values.x.array[self._C], 0.0)
        values.x.array[self._C] = 0.0
        load = self._load(values.x.array)
        load_C = load[self._C] - self._KCI @ self._lu.solve(load[self._I])
        R = np.zeros((n * d, n * d))
        for i, frame in enumerate(self._frames):
            R[i * d : (i + 1) * d, i * d : (i + 1) * d] = frame
        stiffness, load_C = R @ self._S @ R.T, R @ load_C
        held, q = self._held.ravel(), (R @ prescribed)[self._held.ravel()]
        load_C -= stiffness[:, held] @ q
        diagonal = np.diag(stiffness)[held].copy()
        stiffness[held, :] = stiffness[:, held] = 0.0
        stiffness[held, held] = diagonal
        load_C[held] = diagonal * q
        free = self._contact.free.x.array.reshape(n, d) > 0.5
        return stiffness, load_C, free

    def _load(self, u: Array) -> Array:
        """Return minus the bulk residual at ``u``, after a check that it is linear."""
        with self._displacement(np.zeros_like(u)):
            load = -fem.assemble_vector(self._residual).array
        current = self._problem.u.x.array
        force = self._K @ current
        nonlinear = fem.assemble_vector(self._residual).array - (force - load)
        # Compare with the terms of K u before they cancel: they determine the rounding error.
        size = np.linalg.norm(abs(self._K) @ abs(current)) + np.linalg.norm(load)
        if np.linalg.norm(nonlinear) > LINEAR * size:
            raise ContactInputError("The exact reference needs a bulk residual linear in u.")
        return np.asarray(load - self._K @ u)

    @contextmanager
    def _displacement(self, u: Array) -> Iterator[None]:
        """Evaluate at another displacement and put the problem's back, bit for bit."""
        array = self._problem.u.x.array
        kept = array.copy()
        array[:] = u
        try:
            yield
        finally:
            array[:] = kept

    def _held_directions(self) -> npt.NDArray[np.bool_]:
        """Return which directions of each node's frame a boundary condition prescribes."""
        n, d = self._frames.shape[:2]
        fixed = np.isin(self._C, self._D).reshape(n, 1, d)
        share = np.linalg.norm(np.where(fixed, self._frames, 0.0), axis=2)
        if np.any((share > 1e-8) & (share < 1.0 - 1e-8)):
            raise ContactInputError(
                "The exact reference needs boundary conditions at contact nodes along the normal "
                "or the tangents of the plane."
            )
        return np.asarray(share > 0.5)


def _stiffness(problem: FrictionalContactProblem) -> csr_matrix:
    """Assemble the bulk stiffness without boundary conditions."""
    form = compiled(fem.form, problem.comm)(ufl.derivative(problem.bulk, problem.u))
    matrix = fem.assemble_matrix(form)
    matrix.scatter_reverse()
    return csr_matrix(matrix.to_scipy())
