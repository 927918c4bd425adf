# SPDX-License-Identifier: MIT
"""What runs here: the versions of the package and of all that it stands on."""

import platform
import re
from collections.abc import Sequence
from importlib import metadata, util
from pathlib import Path

import petsc4py
from mpi4py import MPI
from petsc4py import PETSc

import dolfinx
import numpy as np

from .version import __version__

#: Distributions that the package needs, and those that parts of it use where they are installed.
NEEDED = ("fenics-ufl", "fenics-ffcx", "fenics-basix", "petsc4py", "mpi4py", "numpy", "scipy")
OPTIONAL = ("gmsh", "h5py", "matplotlib", "meshio", "pyvista", "rich")


def show_versions() -> None:
    """Print the versions of all that matters for a report of a bug, once for all ranks.

    From a shell: ``python3 -c "import fenicsx_friction as ff; ff.show_versions()"``.
    """
    if MPI.COMM_WORLD.rank == 0:
        print("\n".join(f"{name:18}{value}" for name, value in versions().items()))


def versions() -> dict[str, str]:
    """Return what :func:`show_versions` prints, by name."""
    return {
        "fenicsx_friction": __version__,
        "DOLFINx": f"{dolfinx.__version__} ({dolfinx.git_commit_hash})",
        "PETSc": f"{_petsc()}, {_numbers()}",
        "MUMPS": mumps(),
        "MPI": f"{_mpi()}, {MPI.COMM_WORLD.size} ranks",
        **{name: installed(name) for name in NEEDED},
        "Python": platform.python_version(),
        "platform": platform.platform(),
        **{name: installed(name) for name in OPTIONAL},
    }


def versions_line() -> str:
    """Return the versions that matter most, in one line."""
    return (
        f"fenicsx_friction {__version__}, DOLFINx {dolfinx.__version__}, PETSc {_petsc()} "
        f"({_numbers()}), MUMPS {mumps()}, {_mpi()}, Python {platform.python_version()}"
    )


def installed(name: str) -> str:
    """Return the version of a distribution; ``-`` where it is not installed."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:  # some packagers leave the metadata out
        return "installed" if util.find_spec(name) else "-"


def mumps() -> str:
    """Return the version of PETSc's MUMPS; ``-`` without it, ``yes`` where nothing tells which.

    PETSc says it in a header of its own only, which not every installation has.
    """
    if not PETSc.Sys.hasExternalPackage("mumps"):
        return "-"
    config = petsc4py.get_config()
    top = Path(config.get("PETSC_DIR") or "")
    return mumps_version([top, top / (config.get("PETSC_ARCH") or "")])


def mumps_version(folders: Sequence[Path]) -> str:
    """Return the version of MUMPS in the first header of these installations, else ``yes``."""
    headers = [folder / "include" / "petscpkg_version.h" for folder in folders]
    text = next((path.read_text() for path in headers if path.is_file()), "")
    parts = re.findall(r"PKG_MUMPS_VERSION_(?:MAJOR|MINOR|SUBMINOR) +(\d+)\n", text)
    return ".".join(parts) or "yes"


def _petsc() -> str:
    """Return the version of PETSc."""
    return ".".join(map(str, PETSc.Sys.getVersion()))


def _numbers() -> str:
    """Return the types of scalars and indices, such as ``float64, int32``."""
    return f"{np.dtype(PETSc.ScalarType)}, {np.dtype(PETSc.IntType)}"


def _mpi() -> str:
    """Return the MPI library and its version."""
    return " ".join(re.split(r"[,\n]", MPI.Get_library_version())[0].split())
