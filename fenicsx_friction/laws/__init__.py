# SPDX-License-Identifier: MIT
"""Laws in UFL: rows of contact and friction, friction laws, energies of the bulk."""

from .rows import (
    NORMAL_ROWS,
    blended_slip,
    closed,
    direction,
    fischer_burmeister_row,
    min_row,
    norm,
    normal_row,
    positive,
    projection,
    projection_row,
    ramp,
    slip_row,
    stick_row,
)

__all__ = [
    "NORMAL_ROWS",
    "blended_slip",
    "closed",
    "direction",
    "fischer_burmeister_row",
    "min_row",
    "norm",
    "normal_row",
    "positive",
    "projection",
    "projection_row",
    "ramp",
    "slip_row",
    "stick_row",
]
