# SPDX-License-Identifier: MIT
"""What is written: checkpoints and fields for writers."""
