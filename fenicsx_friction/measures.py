# SPDX-License-Identifier: MIT
"""One subdomain_data for the user's boundary terms and for contact.

A DOLFINx form accepts a single ``subdomain_data`` object per integral type, and FFCx cannot
compile a vertex-rule facet integral beside another rule on the same subdomain id. Contact
therefore gets ids of its own, in a list of integration entities that it shares with the loads.
"""

from collections.abc import Iterable, Sequence

import ufl
from dolfinx import mesh

from .compat import exterior_facet_entities
from .surface import ContactSurface

Entities = list[tuple[int, object]]


def share_facet_data(
    forms: Sequence[ufl.Form], surfaces: Sequence[ContactSurface]
) -> tuple[list[ufl.Form], list[ufl.Measure]]:
    """Give the forms and the contact surfaces a common list of boundary entities.

    Args:
        forms: The bulk residuals, with any ``ds`` measures of their own.
        surfaces: The contact surfaces.

    Returns:
        The forms with their exterior-facet integrals on the common list, and one collocation
        measure per surface, which may be added to them.
    """
    entities = dict(_user_entities(forms, surfaces[0].mesh))
    first = max(entities, default=0) + 1
    ids = list(range(first, first + len(surfaces)))
    entities.update((tag, surface.entities) for tag, surface in zip(ids, surfaces, strict=True))
    data: Entities = sorted(entities.items(), key=lambda item: item[0])
    shared = [
        ufl.Form(
            [
                integral.reconstruct(subdomain_data=data) if _on_boundary(integral) else integral
                for integral in form.integrals()
            ]
        )
        for form in forms
    ]
    measures = [s.measure(data, tag) for s, tag in zip(surfaces, ids, strict=True)]
    return shared, measures


def _on_boundary(integral: ufl.classes.Integral) -> bool:
    """Tell whether the integral is over exterior facets."""
    return bool(integral.integral_type() == "exterior_facet")


def _user_entities(forms: Sequence[ufl.Form], msh: mesh.Mesh) -> Iterable[tuple[int, object]]:
    """Yield the ids of the forms' boundary terms with their integration entities."""
    for form in forms:
        for integral in filter(_on_boundary, form.integrals()):
            data, ids = integral.subdomain_data(), integral.subdomain_id()
            if isinstance(data, list):
                yield from data
            elif data is not None:
                for tag in ids if isinstance(ids, tuple) else (ids,):
                    if isinstance(tag, int):
                        yield tag, exterior_facet_entities(msh, data.find(tag))
