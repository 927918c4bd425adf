# SPDX-License-Identifier: MIT
"""What a substep reports."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SubstepReport:
    """How one substep went.

    Attributes:
        name: ``stick``, ``slip`` or ``projection``; ``bulk`` if one that is not linear found no
            balance.
        xi: Blend of the slip rows (0 where they are not used).
        eps: Smoothing of the normal complementarity (Pa).
        iterations: Newton iterations, each one linear solve.
        converged: Whether the residual met its tolerance.
        reason: PETSc's name of the reason, ``CYCLE`` or ``NOT_BALANCED``.
        residuals: 2-norms of the residual (N), one an iteration and the initial one, of the last
            try if it was repeated with more memory.
        accepted: Whether the substep's end state was used.
        failure: Why a linear solve failed, in plain words.
        solver: ``full``: an iteration solves the whole system; ``condensed``: a dense system of
            the dofs of the contact surfaces.
        krylov: Iterations of the linear solver in all; none of a direct one.
    """

    name: str
    xi: float
    eps: float
    iterations: int
    converged: bool
    reason: str
    residuals: tuple[float, ...]
    accepted: bool = True
    failure: str = ""
    solver: str = "full"
    krylov: int = 0
