# SPDX-License-Identifier: MIT
"""Exact frictional contact for DOLFINx: stick predictor, slip corrector, certificate."""

from . import bulk, laws
from .certificate import OPEN, SLIP, STICK, Certificate
from .contact import Contact
from .errors import ContactInputError, StepFailed
from .friction import Coulomb, FrictionLaw
from .obstacles import Obstacle, RigidPlane
from .problem import FrictionalContactProblem, StepSettings
from .report import ContactReport, StepReport
from .substep import SubstepReport
from .surface import ContactSurface

__version__ = "0.1.0"

__all__ = [
    "OPEN",
    "SLIP",
    "STICK",
    "Certificate",
    "Contact",
    "ContactInputError",
    "ContactReport",
    "ContactSurface",
    "Coulomb",
    "FrictionLaw",
    "FrictionalContactProblem",
    "Obstacle",
    "RigidPlane",
    "StepFailed",
    "StepReport",
    "StepSettings",
    "SubstepReport",
    "bulk",
    "laws",
]
