# SPDX-License-Identifier: MIT
"""Exact frictional contact for DOLFINx: stick predictor, slip corrector, certificate."""

from .base import compat as _compat  # noqa: F401, I001  # first: it tells what is missing
from . import laws, plot
from .base.errors import CheckpointError, ContactInputError, OutOfMemory, StepFailed
from .base.version import __version__ as __version__
from .base.versions import show_versions
from .certificate.certificate import Certificate
from .certificate.nodal_state import OPEN, SLIP, STICK
from .contact.bonds import release, tie
from .contact.contact import Contact
from .files.checkpoint import read_checkpoint, write_checkpoint
from .files.fields import ContactFields
from .increment.report import BodyReport, ContactReport, OtherSolution, StepReport
from .increment.settings import StepSettings
from .laws import bulk
from .laws.friction import (
    Coulomb,
    FrictionLaw,
    Frictionless,
    OrthotropicCoulomb,
    PermanentStick,
    Sliding,
)
from .loading.energy import EnergyAudit
from .loading.events import Event, EventLog
from .loading.failures import StepperFailed
from .loading.record import FailedAttempt, StepRecord
from .loading.relaxation import ViscousRelaxation
from .loading.results import Results
from .loading.stepper import LoadStepper
from .meshes.gmsh_model import read_gmsh
from .meshes.joining import join_meshes
from .meshes.named_mesh import NamedMesh
from .obstacles.adjust import close_initial_gaps
from .obstacles.deformable import DeformableObstacle
from .obstacles.motion import RigidMotion
from .obstacles.rigid import RigidObstacle
from .obstacles.rigid_body import RigidBody
from .obstacles.rigid_surface import RigidSurface
from .obstacles.round import RigidCylinder, RigidSphere
from .obstacles.search import SearchPolicy
from .obstacles.self_contact import SelfContact
from .obstacles.shapes import ImplicitObstacle, RigidPlane
from .problem import FrictionalContactProblem
from .solvers.report import SubstepReport
from .surfaces.surface import ContactSurface
from .verification.jacobian import check_jacobian
from .verification.jacobian_report import JacobianReport

__all__ = [
    "OPEN",
    "SLIP",
    "STICK",
    "BodyReport",
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
    "NamedMesh",
    "OrthotropicCoulomb",
    "OtherSolution",
    "OutOfMemory",
    "PermanentStick",
    "Results",
    "RigidBody",
    "RigidCylinder",
    "RigidMotion",
    "RigidObstacle",
    "RigidPlane",
    "RigidSphere",
    "RigidSurface",
    "SearchPolicy",
    "SelfContact",
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
    "join_meshes",
    "laws",
    "plot",
    "read_checkpoint",
    "read_gmsh",
    "release",
    "show_versions",
    "tie",
    "write_checkpoint",
]
