# SPDX-License-Identifier: MIT
"""The one place that knows DOLFINx versions."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

# First what may be missing: no other import must fail before with words that tell less.
try:
    from petsc4py import PETSc

    import dolfinx
except ImportError as error:
    raise ImportError(
        f"fenicsx_friction needs DOLFINx >= 0.11 with PETSc and petsc4py ({error}). pip does not "
        "bring them: use the repository's `./container`, conda-forge (fenics-dolfinx) or "
        "Debian/Ubuntu packages (python3-dolfinx)."
    ) from error

if tuple(int(part) for part in dolfinx.__version__.split(".")[:2]) < (0, 11):
    raise ImportError(
        f"fenicsx_friction needs DOLFINx >= 0.11 and found {dolfinx.__version__} in "
        f"{Path(dolfinx.__file__).parent}."
    )
if PETSc.ScalarType().dtype != "float64":
    raise ImportError(
        f"fenicsx_friction needs a PETSc with real scalars of double precision, and found "
        f"{PETSc.ScalarType().dtype}. Of conda-forge, take petsc=*=real*; of Debian, "
        "python3-dolfinx-real; in the DOLFINx images, source dolfinx-real-mode."
    )
if not dolfinx.has_petsc4py:
    raise ImportError("fenicsx_friction needs a DOLFINx that was built with petsc4py.")

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.forms import derivative_block
from ffcx.codegeneration import jit
from ffcx.ir import elementtables
from ufl.algorithms import expand_derivatives


def _keep_quadrature_rules_apart() -> None:
    """Repair FFCx 0.11: integrals of one form with several quadrature rules, one of a single point.

    FFCx shares among the rules what has one value at all points of a rule. With a single point
    everything has. Where this rule comes first, which its integrand decides, the others took its
    values at their own points: B-bar lost the points of its deviatoric part. Now nothing that is
    evaluated at a single point counts as constant.
    """
    kind = elementtables.analyse_table_type
    if kind.__module__ == __name__:
        return

    def analyse_table_type(table: Any, *tolerances: Any, **named: Any) -> Any:
        """As FFCx's function, with tables of a single point as those of several points."""
        found = kind(table, *tolerances, **named)
        if table.shape[2] > 1:
            return found
        return {"fixed": "uniform", "piecewise": "varying"}.get(found, found)

    elementtables.analyse_table_type = analyse_table_type


def _load_compiled_forms_once() -> None:
    """Let FFCx 0.11 keep what it has loaded from its cache, as long as the cache has it.

    It lists the whole folder for each form that it loads, also for one that it has loaded before.
    In a folder of 1 000 forms this was a tenth of all the time of many small problems.
    """
    load = jit.get_cached_module
    if load.__module__ == __name__:
        return
    loaded: dict[tuple[Path, Any], Any] = {}

    def get_cached_module(name: str, objects: Any, cache_dir: Any, timeout: int) -> Any:
        """As FFCx's function, which makes the ``.c`` file where there is none."""
        source = Path(cache_dir, name).with_suffix(".c")
        key = source, tuple(objects)
        if key in loaded and source.exists() and source.with_suffix(".c.cached").exists():
            return loaded[key]
        found = load(name, objects, cache_dir, timeout)
        if found[0] is not None:
            loaded[key] = found
        return found

    jit.get_cached_module = get_cached_module


_keep_quadrature_rules_apart()
_load_compiled_forms_once()


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


def jacobian_blocks(forms: Sequence[ufl.Form], unknowns: Sequence[fem.Function]) -> list[list[Any]]:
    """Differentiate the blocks of a residual, expanded; blocks without integrals are ``None``.

    DOLFINx 0.11 cannot create an empty form between two meshes (two contact surfaces, say).
    """
    blocks: Any = derivative_block(list(forms), list(unknowns))
    return [[_expanded(J) for J in row] for row in blocks]


def _expanded(form: Any) -> Any:
    """Return a form with its derivatives carried out; ``None`` if nothing is left."""
    if isinstance(form, ufl.ZeroBaseForm):
        return None
    expanded = expand_derivatives(form)
    return None if expanded.empty() else expanded


def same_topology(a: Any, b: Any) -> bool:
    """Tell whether two objects (meshes, tags, topologies) are of one topology."""
    return _cpp_topology(a) is _cpp_topology(b)


def _cpp_topology(owner: Any) -> Any:
    """Return the C++ topology of a mesh, of tags, or of a topology's wrapper."""
    topology = getattr(owner, "topology", owner)
    return getattr(topology, "_cpp_object", topology)


def bc_space_contains(V: fem.FunctionSpace, bc: fem.DirichletBC) -> bool:
    """Tell whether ``bc`` constrains ``V`` or one of its subspaces."""
    return bool(V._cpp_object.contains(bc._cpp_object.function_space))


def unrolled_bc_dofs(bc: fem.DirichletBC) -> npt.NDArray[np.int32]:
    """Return the constrained dofs (owned and ghost, block size unrolled) of ``bc``."""
    return np.asarray(bc._cpp_object.dof_indices()[0])


__all__ = [
    "bc_space_contains",
    "exterior_facet_entities",
    "jacobian_blocks",
    "same_topology",
    "unrolled_bc_dofs",
]
