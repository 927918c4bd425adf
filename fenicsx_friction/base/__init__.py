# SPDX-License-Identifier: MIT
"""Ground that every room stands on: errors, checks of values, compilation, files written whole."""
