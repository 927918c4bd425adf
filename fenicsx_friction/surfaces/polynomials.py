# SPDX-License-Identifier: MIT
"""Shape functions of faces as sums of monomials, for many points at a time."""

from __future__ import annotations

import itertools

import basix
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]


class Polynomials:
    """The polynomials of a Lagrange element and their derivatives, as sums of monomials.

    Tables of an element are made for each set of points. Where a face does not change from one set
    to the next, as in a search for a point on it, sums of monomials need a fraction of their time.

    Args:
        element: The element.

    Attributes:
        coefficients: Of the shape functions, then of their derivatives along the coordinates:
            (1 + dimension, monomials, dofs).
    """

    def __init__(self, element: basix.finite_element.FiniteElement) -> None:
        points, degree = np.asarray(element.points), element.degree
        powers = list(itertools.product(range(degree + 1), repeat=points.shape[1]))
        if element.cell_type == basix.CellType.triangle:
            powers = [power for power in powers if sum(power) <= degree]
        self._powers = powers
        shapes = np.linalg.inv(self(points.T).T)
        tables = [shapes]
        for axis in range(points.shape[1]):
            slope = np.zeros_like(shapes)
            for power, coefficients in zip(self._powers, shapes, strict=True):
                if power[axis]:
                    lower = tuple(p - (k == axis) for k, p in enumerate(power))
                    slope[self._powers.index(lower)] = power[axis] * coefficients
            tables.append(slope)
        self.coefficients = np.array(tables)

    def __call__(self, xi: Array) -> Array:
        """Return the monomials (monomials, points) at points (dimension, points)."""
        found: Array = np.ones((len(self._powers), xi.shape[1]))
        for row, power in zip(found, self._powers, strict=True):
            for coordinate, exponent in zip(xi, power, strict=True):
                for _ in range(exponent):
                    row *= coordinate
        return found
