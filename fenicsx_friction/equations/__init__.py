# SPDX-License-Identifier: MIT
"""The equations of a problem: what assembles them, adds contact and measures residuals."""
