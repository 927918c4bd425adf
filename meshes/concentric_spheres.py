# SPDX-License-Identifier: MIT
"""Mesh of the compressed concentric spheres: an octant of two hollow spheres in hexahedra.

Each octant has a patch of ``n x n`` faces at the pole, down to 30 degrees from it, two of
``n x 2 n`` faces below, and four layers; nodes on the symmetry planes are at uniform angles. These
are the meshes of the solids4foam benchmark collection. The spheres share a radius and no node:
their faces are mismatched on purpose. As a script it writes a ``.msh`` file::

    ./container python3 meshes/concentric_spheres.py --density medium spheres.msh
"""

import argparse
from itertools import pairwise

import gmsh
import numpy as np

#: Radii (mm): inside of the inner sphere, contact, outside of the outer one.
RADII = (10.0, 12.0, 14.0)
#: Divisions ``n`` of the inner and the outer sphere: 125/45, 405/125 and 405/605 faces, the
#: published ones, and finer.
DENSITIES = {
    "coarse": (5, 3),
    "medium": (9, 5),
    "fine": (9, 11),
    "finer": (14, 17),
    "finest": (18, 22),
}
#: Physical groups of facets.
TAGS = {
    "inner contact": 1,
    "outer contact": 2,
    "top": 3,
    "inside": 4,  # touches the lower plane after buckling
    "x = 0": 5,
    "y = 0": 6,
    "z = 0": 7,
}
LAYERS = 4


#: Polar angles of the patch at the pole: on the symmetry planes, and at its outermost corner.
SIDE, CORNER = np.radians([30.0, 36.5])
#: Directions of the points that bound the three patches of an octant.
POINTS = {
    "x": (1, 0, 0),
    "y": (0, 1, 0),
    "z": (0, 0, 1),
    "xy": (1, 1, 0),
    "yz": (0, np.sin(SIDE), np.cos(SIDE)),
    "zx": (np.sin(SIDE), 0, np.cos(SIDE)),
    "xyz": (np.sin(CORNER), np.sin(CORNER), np.sqrt(2.0) * np.cos(CORNER)),
}
#: Arcs with twice the divisions.
LONG = {frozenset(ends) for ends in (("x", "zx"), ("y", "yz"), ("xy", "xyz"))}
PATCHES = (("x", "xy", "xyz", "zx"), ("y", "yz", "xyz", "xy"), ("z", "zx", "xyz", "yz"))
#: The sides of the patches that lie in the planes x = 0, y = 0 and z = 0.
PLANES = {
    "x = 0": (("y", "yz"), ("yz", "z")),
    "y = 0": (("x", "zx"), ("z", "zx")),
    "z = 0": (("x", "xy"), ("xy", "y")),
}


def build(density: str = "medium", layers: int = LAYERS) -> None:
    """Build and mesh the two spheres in the current gmsh model.

    Args:
        density: A key of :data:`DENSITIES`.
        layers: Elements through each thickness.
    """
    groups: dict[str, list[int]] = {name: [] for name in TAGS}
    volumes = []
    names = (("inside", "inner contact"), ("outer contact", "top"))
    for radii, n, surfaces in zip(pairwise(RADII), DENSITIES[density], names, strict=True):
        shell = _Shell(radii, n, layers)
        volumes += [shell.patch(corners) for corners in PATCHES]
        for side, name in enumerate(surfaces):
            groups[name] += [shell.caps[side, corners] for corners in PATCHES]
        for name, sides in PLANES.items():
            groups[name] += [shell.walls[frozenset(ends)] for ends in sides]
    gmsh.model.geo.synchronize()
    for name, members in groups.items():
        gmsh.model.addPhysicalGroup(2, members, TAGS[name], name)
    gmsh.model.addPhysicalGroup(3, volumes, 1, "spheres")
    gmsh.model.mesh.generate(3)


class _Shell:
    """One sphere's octant between two radii."""

    def __init__(self, radii: tuple[float, float], n: int, layers: int) -> None:
        self._n, self._layers, self._geo = n, layers, gmsh.model.geo
        self._center = self._geo.addPoint(0.0, 0.0, 0.0)
        self._points = {}
        for side, radius in enumerate(radii):
            for name, direction in POINTS.items():
                length = sum(d * d for d in direction) ** 0.5
                place = (radius * d / length for d in direction)
                self._points[side, name] = self._geo.addPoint(*place)
        self._lines: dict[object, tuple[int, str]] = {}
        self.caps: dict[object, int] = {}
        self.walls: dict[object, int] = {}

    def patch(self, corners: tuple[str, ...]) -> int:
        """Make the hexahedral volume over one patch."""
        sides = list(pairwise((*corners, corners[0])))
        for side in (0, 1):
            arcs = [self._arc(side, start, end) for start, end in sides]
            loop = self._geo.addCurveLoop(arcs)
            self.caps[side, corners] = self._geo.addSurfaceFilling(
                [loop], sphereCenterTag=self._center
            )
        surfaces = [self.caps[0, corners], self.caps[1, corners]]
        surfaces += [self._wall(start, end) for start, end in sides]
        for surface in surfaces:
            self._geo.mesh.setTransfiniteSurface(surface)
            self._geo.mesh.setRecombine(2, surface)
        volume = self._geo.addVolume([self._geo.addSurfaceLoop(surfaces)])
        self._geo.mesh.setTransfiniteVolume(volume)
        return volume

    def _arc(self, side: int, start: str, end: str) -> int:
        """Return the arc from start to end, negative where it was made the other way."""
        key = (side, frozenset((start, end)))
        if key not in self._lines:
            ends = self._points[side, start], self._points[side, end]
            line = self._geo.addCircleArc(ends[0], self._center, ends[1])
            n = 2 * self._n if frozenset((start, end)) in LONG else self._n
            self._geo.mesh.setTransfiniteCurve(line, n + 1)
            self._lines[key] = line, start
        line, first = self._lines[key]
        return line if first == start else -line

    def _radial(self, name: str) -> int:
        """Return the line through the thickness."""
        if name not in self._lines:
            line = self._geo.addLine(self._points[0, name], self._points[1, name])
            self._geo.mesh.setTransfiniteCurve(line, self._layers + 1)
            self._lines[name] = line, name
        return self._lines[name][0]

    def _wall(self, start: str, end: str) -> int:
        """Return the plane surface through the thickness over an arc."""
        key = frozenset((start, end))
        if key not in self.walls:
            loop = (
                self._arc(0, start, end),
                self._radial(end),
                -self._arc(1, start, end),
                -self._radial(start),
            )
            self.walls[key] = self._geo.addPlaneSurface([self._geo.addCurveLoop(list(loop))])
        return self.walls[key]


def main() -> None:
    """Write a mesh file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--density", choices=DENSITIES, default="medium")
    parser.add_argument("--layers", type=int, default=LAYERS)
    parser.add_argument("path")
    arguments = parser.parse_args()
    gmsh.initialize()
    build(arguments.density, arguments.layers)
    gmsh.write(arguments.path)
    gmsh.finalize()


if __name__ == "__main__":
    main()
