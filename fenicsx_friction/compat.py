# SPDX-License-Identifier: MIT
"""The one place that knows DOLFINx versions."""

import numpy as np
import numpy.typing as npt

try:
    import dolfinx
except ImportError as error:  # pragma: no cover - needs a machine without DOLFINx
    raise ImportError(
        "fenicsx_friction needs DOLFINx >= 0.11, which is not on PyPI: use the repository's "
        "`./container`, conda-forge (fenics-dolfinx) or Debian/Ubuntu packages (python3-dolfinx)."
    ) from error

from dolfinx import fem, mesh

MINIMUM_DOLFINX = (0, 11)
_found = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
if _found < MINIMUM_DOLFINX:
    raise ImportError(f"fenicsx_friction needs DOLFINx >= 0.11, found {dolfinx.__version__}.")


def exterior_facet_entities(msh: mesh.Mesh, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Return the (cell, local facet) pairs of the owned exterior facets among ``facets``."""
    tdim = msh.topology.dim
    msh.topology.create_connectivity(tdim - 1, tdim)
    msh.topology.create_connectivity(tdim, tdim - 1)
    owned_exterior = mesh.exterior_facet_indices(msh.topology)
    return np.asarray(
        fem.compute_integration_domains(
            fem.IntegralType.exterior_facet, msh.topology, np.intersect1d(facets, owned_exterior)
        )
    )


def bc_space_contains(V: fem.FunctionSpace, bc: fem.DirichletBC) -> bool:
    """Tell whether ``bc`` constrains ``V`` or one of its subspaces."""
    return bool(V._cpp_object.contains(bc._cpp_object.function_space))


def unrolled_bc_dofs(bc: fem.DirichletBC) -> npt.NDArray[np.int32]:
    """Return the constrained dofs (owned and ghost, block size unrolled) of ``bc``."""
    return np.asarray(bc._cpp_object.dof_indices()[0])


__all__ = ["bc_space_contains", "exterior_facet_entities", "unrolled_bc_dofs"]
