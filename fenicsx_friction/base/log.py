# SPDX-License-Identifier: MIT
"""The logger of the package: quiet unless the user configures ``logging``.

At ``INFO`` it tells a line a step, at ``DEBUG`` one a substep and search, on rank 0.
"""

import logging

from mpi4py import MPI

LOGGER = logging.getLogger("fenicsx_friction")
LOGGER.addHandler(logging.NullHandler())


def tell(comm: MPI.Intracomm, level: int, message: str, *values: object) -> None:
    """Log a message on the first rank; not collective."""
    if comm.rank == 0:
        LOGGER.log(level, message, *values)
