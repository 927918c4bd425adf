# SPDX-License-Identifier: MIT
"""Exact frictional contact for DOLFINx: stick predictor, slip corrector, certificate."""

from . import bulk, laws
from .adjust import close_initial_gaps
from .certificate import OPEN, SLIP, STICK, Certificate
from .checkpoint import read_checkpoint, write_checkpoint
from .contact import Contact
from .deformable import DeformableObstacle
from .energy import EnergyAudit
from .errors import CheckpointError, ContactInputError, OutOfMemory, StepFailed
from .events import Event, EventLog
from .friction import (
    Coulomb,
    FrictionLaw,
    Frictionless,
    OrthotropicCoulomb,
    PermanentStick,
    Sliding,
)
from .jacobian import JacobianReport, check_jacobian
from .motion import RigidMotion
from .obstacles import ImplicitObstacle, RigidObstacle, RigidPlane
from .output import ContactFields
from .problem import FrictionalContactProblem
from .relaxation import ViscousRelaxation
from .report import ContactReport, FailedAttempt, StepRecord, StepReport
from .round_obstacles import RigidCylinder, RigidSphere
from .search import SearchPolicy
from .settings import StepSettings
from .stepper import LoadStepper, StepperFailed
from .substep import SubstepReport
from .surface import ContactSurface

__version__ = "0.1.0"

__all__ = [
    "OPEN",
    "SLIP",
    "STICK",
    "Certificate",
    "CheckpointError",
    "Contact",
    "ContactFields",
    "ContactInputError",
    "ContactReport",
    "ContactSurface",
    "Coulomb",
    "DeformableObstacle",
    "EnergyAudit",
    "Event",
    "EventLog",
    "FailedAttempt",
    "FrictionLaw",
    "FrictionalContactProblem",
    "Frictionless",
    "ImplicitObstacle",
    "JacobianReport",
    "LoadStepper",
    "OrthotropicCoulomb",
    "OutOfMemory",
    "PermanentStick",
    "RigidCylinder",
    "RigidMotion",
    "RigidObstacle",
    "RigidPlane",
    "RigidSphere",
    "SearchPolicy",
    "Sliding",
    "StepFailed",
    "StepRecord",
    "StepReport",
    "StepSettings",
    "StepperFailed",
    "SubstepReport",
    "ViscousRelaxation",
    "bulk",
    "check_jacobian",
    "close_initial_gaps",
    "laws",
    "read_checkpoint",
    "write_checkpoint",
]
