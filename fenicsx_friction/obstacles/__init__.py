# SPDX-License-Identifier: MIT
"""What a surface meets: rigid obstacles and deformable bodies; gap, slip and frame of each node."""
