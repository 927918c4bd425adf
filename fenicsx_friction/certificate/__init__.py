# SPDX-License-Identifier: MIT
"""How well a state solves the unsmoothed law; NumPy only."""
