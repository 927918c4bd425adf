# SPDX-License-Identifier: MIT
"""Mesh of a block on a longer base, in hexahedra that do not match, for the sweeping test.

As a script it writes a ``.msh`` file::

    ./container python3 meshes/block_on_base.py block.msh
"""

import argparse
from collections.abc import Sequence

import gmsh

#: Corners (m) of the block and the base, and their divisions.
BLOCK = ((0.5, 0.15, 0.5), (1.5, 0.65, 1.0))
BASE = ((0.0, 0.0, 0.0), (3.0, 0.8, 0.5))
DIVISIONS = ((8, 4, 3), (10, 3, 2))
#: Physical groups of facets.
TAGS = {"block contact": 1, "base contact": 2, "top": 3, "bottom": 4}


def build(refinement: int = 1) -> None:
    """Build and mesh the bodies in the current gmsh model, each division ``refinement`` times."""
    groups = (("block contact", "top"), ("bottom", "base contact"))
    volumes = []
    for corners, n, names in zip((BLOCK, BASE), DIVISIONS, groups, strict=True):
        volume, lower, upper = _box(*corners, [refinement * k for k in n])
        volumes.append(volume)
        for surface, name in zip((lower, upper), names, strict=True):
            gmsh.model.addPhysicalGroup(2, [surface], TAGS[name], name)
    gmsh.model.addPhysicalGroup(3, volumes, 1, "bodies")
    gmsh.model.mesh.generate(3)


def _box(low: Sequence[float], high: Sequence[float], n: Sequence[int]) -> tuple[int, int, int]:
    """Extrude a rectangle to a box; return its volume, lower and upper surface."""
    geo = gmsh.model.geo
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    points = [geo.addPoint(x, y, low[2]) for x, y in corners]
    lines = [geo.addLine(points[k], points[(k + 1) % 4]) for k in range(4)]
    for k, line in enumerate(lines):
        geo.mesh.setTransfiniteCurve(line, n[k % 2] + 1)
    lower = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    geo.mesh.setTransfiniteSurface(lower)
    geo.mesh.setRecombine(2, lower)
    extruded = geo.extrude(
        [(2, lower)], 0.0, 0.0, high[2] - low[2], numElements=[n[2]], recombine=True
    )
    geo.synchronize()
    return extruded[1][1], lower, extruded[0][1]


def main() -> None:
    """Write a mesh file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--refinement", type=int, default=1)
    parser.add_argument("path")
    arguments = parser.parse_args()
    gmsh.initialize()
    build(arguments.refinement)
    gmsh.write(arguments.path)
    gmsh.finalize()


if __name__ == "__main__":
    main()
