# SPDX-License-Identifier: MIT
"""One subdomain_data for the user's boundary terms.

A DOLFINx form accepts a single ``subdomain_data`` object per integral type. It drops terms over ids
that this object does not have. All boundary terms therefore share one list of integration entities.
"""

import numbers
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import mesh

from ..base.compat import exterior_facet_entities, same_topology
from ..base.errors import ContactInputError

Array = npt.NDArray[np.int32]
Entities = list[tuple[int, Array]]


def share_facet_data(forms: Sequence[ufl.Form]) -> list[ufl.Form]:
    """Return the forms with their exterior-facet integrals on a common list of entities.

    Args:
        forms: The bulk residuals, with any ``ds`` measures of their own.

    Raises:
        ContactInputError: If a term would lose its load, or get that of another.
    """
    msh = forms[0].arguments()[0].ufl_function_space().mesh
    entities = _user_entities(forms, msh)
    data: Entities = sorted(entities.items(), key=lambda item: item[0])
    return [
        ufl.Form(
            [
                integral.reconstruct(subdomain_data=data) if _on_boundary(integral) else integral
                for integral in form.integrals()
            ]
        )
        for form in forms
    ]


def _on_boundary(integral: ufl.classes.Integral) -> bool:
    """Tell whether the integral is over exterior facets."""
    return bool(integral.integral_type() == "exterior_facet")


def _user_entities(forms: Sequence[ufl.Form], msh: mesh.Mesh) -> dict[int, Array]:
    """Return the ids of the forms' boundary terms with their integration entities; collective.

    Raises:
        ContactInputError: If a term would lose its load, or get that of another.
    """
    found: dict[int, Array] = {}
    different, used = set(), set()
    for form in forms:
        for integral in filter(_on_boundary, form.integrals()):
            ids, data = _ids(integral), integral.subdomain_data()
            used |= ids
            for tag, entities in _entities(ids, data, msh):
                if not np.array_equal(_sorted(found.setdefault(tag, entities)), _sorted(entities)):
                    different.add(tag)
    if different := set().union(*msh.comm.allgather(different)):
        raise ContactInputError(
            f"Boundary terms of F use the ids {sorted(different)} for different facets, by "
            "different tags; number the facets anew, with one meshtags for all boundary terms."
        )
    marked = set().union(*msh.comm.allgather({tag for tag, e in found.items() if len(e) > 0}))
    if lost := used - marked:
        raise ContactInputError(
            f"A boundary term of F is over ds({min(lost)}), which has no boundary facet: its load "
            "would be lost. Check the tags; present on the boundary are "
            f"{sorted(marked)}."
        )
    return found


def _ids(integral: ufl.classes.Integral) -> set[int]:
    """Return the numbers of the facets of a boundary term, none for the whole boundary."""
    ids = integral.subdomain_id()
    ids = ids if isinstance(ids, tuple) else (ids,)
    return {int(tag) for tag in ids if isinstance(tag, numbers.Integral)}


def _entities(ids: set[int], data: Any, msh: mesh.Mesh) -> Iterable[tuple[int, Array]]:
    """Yield the numbers of a boundary term's data with their integration entities."""
    if isinstance(data, mesh.MeshTags):
        if not same_topology(data, msh) or data.dim != msh.topology.dim - 1:
            raise ContactInputError(
                "A boundary term of F has tags of another mesh, or tags that are not of facets; "
                "make them with meshtags of the body's mesh."
            )
        for tag in ids:
            yield tag, exterior_facet_entities(msh, data.find(tag))
    elif data is not None:
        yield from ((int(tag), np.asarray(e)) for tag, e in data if int(tag) in ids)
    elif ids:
        raise ContactInputError(
            f"A boundary term of F is over ds({min(ids)}) without subdomain_data: its load would "
            "be lost. Give the tags: ufl.Measure('ds', domain=mesh, subdomain_data=tags)."
        )


def _sorted(entities: Array) -> Array:
    """Return (cell, local facet) pairs in order."""
    return np.unique(entities.reshape(-1, 2), axis=0)
