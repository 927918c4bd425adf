# SPDX-License-Identifier: MIT
"""One contact: a surface, an obstacle and a law."""
