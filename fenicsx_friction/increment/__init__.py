# SPDX-License-Identifier: MIT
"""One increment: predictor, correctors, what is tried when they fail, commit or roll back."""
