# SPDX-License-Identifier: MIT
"""Names of contact nodes in messages."""

from collections.abc import Sequence

import numpy.typing as npt

from .surface import ContactSurface

#: How many nodes a long message names, and a short one.
NODES_NAMED, FEW_NAMED = 5, 3


def describe(surface: ContactSurface, i: int) -> str:
    """Name the owned node ``i`` of a surface and where it is."""
    return f"node {surface.nodes[i]} of '{surface.name}' at ({_place(surface, i)})"


def named(
    surface: ContactSurface, nodes: Sequence[int] | npt.NDArray, gap: npt.NDArray | None = None
) -> str:
    """Name the first of all ranks' nodes, with their gaps; collective."""
    texts = []
    for i in list(nodes)[:FEW_NAMED]:
        at = "" if gap is None else f": gap {gap[i]:.3g} m"
        number = int(surface.nodes[i])
        texts.append((number, f"node {number} at ({_place(surface, i)}){at}"))
    found = sorted(t for part in surface.mesh.comm.allgather(texts) for t in part)[:FEW_NAMED]
    return "".join(f"\n  {text}" for _, text in found)


def _place(surface: ContactSurface, i: int) -> str:
    """Return the coordinates of an owned node."""
    return ", ".join(f"{value:.6g}" for value in surface.x[i][: surface.mesh.geometry.dim])
