# SPDX-License-Identifier: MIT
"""The quadrature degree that an element needs to be stiff in every deformation."""

from typing import Any

import basix
import numpy as np
import ufl
from ufl.core.expr import Expr
from ufl.corealg.traversal import unique_pre_traversal

Element = Any  # the classes of basix.ufl are private
#: Singular values below this fraction of the largest count as zero.
RANK = 1e-9


def strained_elements(density: Expr) -> list[Element]:
    """Return the elements of the functions whose gradient is in an energy density."""
    gradients = [e for e in unique_pre_traversal(density) if isinstance(e, ufl.classes.Grad)]
    found = []
    for gradient in gradients:
        for f in ufl.algorithms.extract_coefficients(gradient):
            if (element := f.ufl_element()) not in found:
                found.append(element)
    return found


def exact_degree(element: Element) -> int:
    """Return twice the degree of the gradient, at least 2, which keeps Q1 at two Gauss points."""
    return max(2, max(2 * _gradient_degree(part) for part in _scalar_parts(element)))


def deforms_freely(element: Element, degree: int) -> bool:
    """Tell whether a cell has more deformations without strain at the points than rigid motions.

    Args:
        element: The element of a displacement; others are not judged.
        degree: Degree of the quadrature.
    """
    gdim = len(basix.topology(element.cell_type)) - 1
    if element.block_size != gdim:
        return False
    scalar = element.sub_elements[0]
    points: Any = basix.make_quadrature(element.cell_type, degree)[0]
    gradient = scalar.tabulate(1, points)[1:]
    rows = []
    for i in range(gdim):
        for j in range(i + 1):
            strain = np.zeros((len(points), scalar.dim, gdim))
            strain[:, :, i] += gradient[j]
            strain[:, :, j] += gradient[i]
            rows.append(strain.reshape(len(points), -1))
    values = np.linalg.svd(np.concatenate(rows), compute_uv=False)
    rank = int(np.sum(values > RANK * values[0]))
    rigid = gdim * (gdim + 1) // 2
    return rank < scalar.dim * gdim - rigid


def _scalar_parts(element: Element) -> list[Element]:
    """Return the scalar elements that a blocked or mixed element consists of."""
    if not element.sub_elements:
        return [element]
    return [part for sub in element.sub_elements for part in _scalar_parts(sub)]


def _gradient_degree(scalar: Element) -> int:
    """Return the degree of the gradient; on quadrilaterals and hexahedra in one direction."""
    if scalar.cell_type in (basix.CellType.quadrilateral, basix.CellType.hexahedron):
        return int(scalar.basix_element.degree)
    return max(int(scalar.embedded_superdegree) - 1, 0)
