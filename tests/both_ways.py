"""Solve the same steps on the boundary and as a whole, and compare."""

from dataclasses import replace

import numpy as np
import pytest

from models import Raous, by_place


def follow(model, path, solver):
    """Take a model along a path; return the reports and the largest numbers to compare."""
    problem, step = model.problem, model.load if isinstance(model, Raous) else model.move
    problem.settings = replace(problem.settings, solver=solver)
    reports, states = [], []
    for position in path:
        step(*position)
        reports.append(problem.solve())
        states += [by_place(f) for f in (problem.u, *(k.c for k in problem.contacts))]
    return reports, states


def compare(make, path, tolerance=1e-9):
    """Solve on the boundary and as a whole; return the reports of the former."""
    condensed, found = follow(make("condensed_"), path, "condensed")
    full, right = follow(make("full_"), path, "full")
    for a, b in zip(condensed, full, strict=True):
        assert a.certified and b.certified
        assert (a.solver, b.solver) == ("condensed", "full")
        assert [(k.stick, k.slip) for k in a.contacts] == [(k.stick, k.slip) for k in b.contacts]
    kinds = len(found) // len(path)  # displacement, tractions
    for i in range(kinds):
        scale = max(np.max(abs(b), initial=0.0) for b in right[i::kinds])
        for a, b in zip(found[i::kinds], right[i::kinds], strict=True):
            assert a == pytest.approx(b, abs=tolerance * scale)
    return condensed
