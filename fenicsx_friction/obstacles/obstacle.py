# SPDX-License-Identifier: MIT
"""What a body meets."""

from __future__ import annotations

from abc import ABC, abstractmethod

from .motion import Motion
from .pairing import Pairing
from .side import Side


class Obstacle(ABC):
    """What a body meets: a rigid obstacle, or the surface of a deformable body.

    Attributes:
        motion: A rigid motion that the user sets, if any.
    """

    motion: Motion | None = None

    @abstractmethod
    def meet(self, side: Side) -> Pairing:
        """Return the pairing: what each node of a side meets of the obstacle; collective."""
