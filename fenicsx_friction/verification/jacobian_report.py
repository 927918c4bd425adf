# SPDX-License-Identifier: MIT
"""What a check of the Jacobians reports."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BlockCheck:
    """One block of rows of one substep at one state.

    Attributes:
        substep: ``stick``, ``slip`` or ``projection``.
        xi: Blend of the slip rows.
        eps: Smoothing (Pa).
        state: ``present`` or ``mixed``.
        block: ``momentum``, ``block i`` (further unknowns of the user) or ``contact 'name'``.
        error: Largest difference between derivative and finite difference over the largest
            derivative of the block, both in one random direction of all unknowns.
        rows: Number of rows compared.
        kinks: Number of rows left out because a kink of the law lies between the differences.
        where: The row of the largest difference.
    """

    substep: str
    xi: float
    eps: float
    state: str
    block: str
    error: float
    rows: int
    kinks: int
    where: str


@dataclass(frozen=True)
class JacobianReport:
    """What :func:`check_jacobian` found.

    Attributes:
        checks: One entry a substep, state and block.
        states: Number of open, sticking and slipping nodes of each contact in the mixed state.
    """

    checks: tuple[BlockCheck, ...]
    states: tuple[tuple[int, int, int], ...]

    @property
    def worst(self) -> BlockCheck:
        """The check with the largest error."""
        return max(self.checks, key=lambda check: check.error)

    @property
    def error(self) -> float:
        """The largest relative error of all; infinite where a residual is not finite."""
        return self.worst.error

    def largest(self) -> dict[tuple[str, str], float]:
        """Return the largest relative error of each (substep, block)."""
        errors: dict[tuple[str, str], float] = {}
        for check in self.checks:
            key = (check.substep, check.block)
            errors[key] = max(errors.get(key, 0.0), check.error)
        return errors

    def __str__(self) -> str:
        """Return a table of the checks and the worst row."""
        lines = [
            f"{c.substep:<10} {c.state:<7} xi {c.xi:<3g} eps {c.eps:<9.3g} {c.block:<20} "
            f"error {c.error:.1e} in {c.rows} rows, {c.kinks} at kinks"
            for c in self.checks
        ]
        return "\n".join([*lines, f"Largest: {self.error:.1e}, {self.worst.where}."])
