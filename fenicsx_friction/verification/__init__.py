# SPDX-License-Identifier: MIT
"""What no solve needs: the exact reference, the check of the Jacobian."""
