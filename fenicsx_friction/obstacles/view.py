# SPDX-License-Identifier: MIT
"""How an obstacle looks at a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]


@dataclass(frozen=True)
class View:
    """How an obstacle looks at a surface, one entry an owned node.

    Attributes:
        cosine: Of the obstacle's normal and the surface's averaged outward normal, -1 where they
            oppose each other.
        gap: Distance in front of the obstacle (m); infinite beyond the edge of a surface.
        lost: Depth (m) of a node behind a face that it should meet but is too deep to meet; else 0.
    """

    cosine: Array
    gap: Array
    lost: Array
