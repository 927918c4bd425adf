# SPDX-License-Identifier: MIT
"""Where contact is: surfaces, their faces, what meshes and elements they need."""
