# SPDX-License-Identifier: MIT
"""The equations of a problem: what assembles, measures, solves and certifies them."""
