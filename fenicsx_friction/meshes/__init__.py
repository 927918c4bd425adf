# SPDX-License-Identifier: MIT
"""Meshes with named parts: read from gmsh, joined of bodies that were meshed apart."""
