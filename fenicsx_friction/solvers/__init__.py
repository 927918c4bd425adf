# SPDX-License-Identifier: MIT
"""How the equations of a substep are solved: whole, or on the boundary of a condensed bulk."""
