# SPDX-License-Identifier: MIT
"""The unit of all costs: one linear elastic solve on the same mesh, in the same run."""

import time

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import LinearProblem

from fenicsx_friction import FrictionalContactProblem

DIRECT: dict[str, object] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}


def elastic_problem(
    problem: FrictionalContactProblem,
    dofs: npt.NDArray[np.int32],
    component: int | None,
    name: str,
    options: dict[str, object] = DIRECT,
) -> LinearProblem:
    """Return the elastic problem of a body that is held instead of being in contact.

    Args:
        problem: The contact problem; its tangent at the present displacement is taken.
        dofs: Dofs that are held: blocked ones, or unrolled ones of the component.
        component: The one component that is held there; all if ``None``.
        name: Begins the prefix of its PETSc options.
        options: PETSc options.
    """
    V = problem.u.function_space
    zero = fem.Constant(V.mesh, np.zeros(() if component is not None else V.dofmap.bs))
    space = V if component is None else V.sub(component)
    return LinearProblem(
        ufl.derivative(problem.bulk, problem.u),
        -problem.bulk,
        bcs=[*problem.bcs, fem.dirichletbc(zero, dofs, space)],
        petsc_options=options,
        petsc_options_prefix=f"elastic_{name}_",
    )


def cpu_of(solve: LinearProblem) -> float:
    """Return the CPU time (s) of assembly, factorisation and back-substitution."""
    start = time.process_time()
    solve.solve()
    return time.process_time() - start
