# SPDX-License-Identifier: MIT
"""Load paths of many increments: step sizes, energy, events, relaxation."""
