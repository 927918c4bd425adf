# SPDX-License-Identifier: MIT
"""The version of the package; packaging reads it here without importing anything."""

__version__ = "0.2.0rc1"
