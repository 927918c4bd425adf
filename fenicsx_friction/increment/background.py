# SPDX-License-Identifier: MIT
"""What a report of a failed step needs beside its message: versions, settings, sizes."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from ..base.compat import jacobian_blocks
from ..base.versions import versions_line
from ..contact.contact import Contact
from ..equations.dependencies import Dependencies
from .system import ContactSystem


def background(system: ContactSystem) -> str:
    """Return some lines on what was solved, how, and how to save the state."""
    settings, solvers = system.settings, system.solvers
    V = system.u.function_space
    cells = V.mesh.topology.index_map(V.mesh.topology.dim).size_global
    size = V.dofmap.index_map.size_global * V.dofmap.index_map_bs
    elements = ", ".join(_element(f) for f in system.unknowns)
    lines = [
        "For a report of this failure:",
        f"  {versions_line()}",
        f"  {cells} cells, {size} displacements, {system.comm.size} ranks; {elements}; bulk "
        f"{'linear' if _linear(system) else 'not linear'} in u",
        f"  solver {settings.solver!r}, linear solver {' then '.join(solvers.linear_solvers)}, "
        f"corrector {settings.corrector!r}, normal {settings.normal!r}, tolerance "
        f"{settings.tolerance:.0e}",
        *(f"  {_contact(k)}" for k in system.contacts),
        '  The state before the step, for others: ff.write_checkpoint("failed.h5", problem)',
    ]
    return "\n".join(lines)


def _contact(contact: Contact) -> str:
    """Say what a contact is: surface, obstacle, how they are paired, law."""
    surface = contact.surface
    law = contact.friction
    numbers = ", ".join(
        f"{name}={float(value):g}"
        for name, value in getattr(law, "__dict__", {}).items()
        if isinstance(value, int | float | np.number)
    )
    return (
        f"contact '{surface.name}': {surface.Q.dofmap.index_map.size_global} nodes, "
        f"{type(contact.obstacle).__name__} ({type(contact.pairing).__name__}), "
        f"{type(law).__name__}({numbers})"
    )


def _element(f: fem.Function) -> str:
    """Return the element of an unknown, such as ``Lagrange 2 on tetrahedron``."""
    element = f.function_space.ufl_element()
    scalar = element.sub_elements[0] if element.sub_elements else element
    cell = f.function_space.mesh.topology.cell_name()
    return f"{f.name}: {getattr(scalar, 'family_name', str(scalar))} {scalar.degree} on {cell}"


def _linear(system: ContactSystem) -> bool:
    """Tell whether the bulk's forces are linear in the displacement."""
    return not Dependencies(jacobian_blocks([system.bulk], [system.u])).include([system.u])
