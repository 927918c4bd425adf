# SPDX-License-Identifier: MIT
"""How a step is solved."""

from dataclasses import dataclass
from typing import Literal

from ..base.validators import choice, flag, instance, integer, number
from ..laws.rows import NORMAL_ROWS


@dataclass(frozen=True)
class StepSettings:
    """How a step is solved; the defaults need no tuning.

    Attributes:
        corrector: ``"projection"``: natural map from the stick state; ``"ramp"``: the paper's
            slip rows with ``xi`` ramped to 0, then the natural map as polish.
        tolerance: Relative tolerance of the certificate.
        predictor_iterations: Newton iterations of the stick predictor; it need not converge.
        extrapolation: Start where the last step points to, if the forces are nearer to balance
            there, and predict no stick then; only with ``corrector="projection"`` and where the
            whole system is solved.
        smoothing: ``eps`` of the predictor relative to the expected traction.
        ramp_nodes: ``"violated"``: slip rows only where the stick force leaves the cone;
            ``"all"``: at all nodes, as printed in the paper.
        ramp_sign: Sign of the stick direction in eq. (12), see
            :func:`fenicsx_friction.laws.blended_slip`.
        normal: Normal complementarity function, ``"chen-mangasarian"`` (the paper's),
            ``"fischer-burmeister"`` or ``"min"``.
        fallbacks: How many further ways to try when full Newton steps fail, on the boundary and
            then on the whole system; all by default. Where a smaller step is possible, a few are
            cheaper.
        solver: ``"condensed"``: contact is solved on the boundary of the bulk, which is factored
            once if it is linear in its unknowns, else a few times a step; ``"full"``: the whole
            system in each iteration; ``"auto"``: condensed for bulks that are linear, up to
            4000 dofs of the contact surfaces, unless the problem's linear solver is multigrid.
        look_for_others: Look for further solutions of each step from other starts, take the one
            nearest to the last accepted state, and warn. ``None``: from starts that cost little,
            on the boundary, where a friction limit at unit pressure is above 5.
        raise_on_uncertified: Raise :class:`~fenicsx_friction.StepFailed`, or else return the report
            with ``certified == False``. The state is the last accepted one either way.
    """

    corrector: Literal["projection", "ramp"] = "projection"
    tolerance: float = 1e-9
    predictor_iterations: int = 1
    extrapolation: bool = True
    smoothing: float = 1e-2
    ramp_nodes: Literal["violated", "all"] = "violated"
    ramp_sign: Literal[-1, 1] = -1
    normal: Literal["chen-mangasarian", "fischer-burmeister", "min"] = "chen-mangasarian"
    fallbacks: int | None = None
    solver: Literal["auto", "condensed", "full"] = "auto"
    look_for_others: bool | None = None
    raise_on_uncertified: bool = True

    @property
    def extrapolates(self) -> bool:
        """Whether steps may start where the last one points to."""
        return self.extrapolation and self.corrector == "projection"

    def __post_init__(self) -> None:
        """Check the values."""
        choice(self.corrector, "corrector", ("projection", "ramp"))
        choice(self.ramp_nodes, "ramp_nodes", ("violated", "all"))
        choice(self.ramp_sign, "ramp_sign", (-1, 1))
        choice(self.normal, "normal", NORMAL_ROWS)
        choice(self.solver, "solver", ("auto", "condensed", "full"))
        number(self.tolerance, "tolerance", above=0.0, below=1.0)
        integer(self.predictor_iterations, "predictor_iterations", at_least=1)
        flag(self.extrapolation, "extrapolation")
        number(self.smoothing, "smoothing", at_least=0.0)
        if self.fallbacks is not None:
            integer(self.fallbacks, "fallbacks (None for all)", at_least=0)
        if self.look_for_others is not None:
            flag(self.look_for_others, "look_for_others (or None)")
        flag(self.raise_on_uncertified, "raise_on_uncertified")


def settings_of(settings: object) -> StepSettings:
    """Return the settings, the default ones for None, or raise a ContactInputError."""
    settings = StepSettings() if settings is None else settings
    return instance(settings, StepSettings, "settings", "StepSettings(...) with keywords")
