# SPDX-License-Identifier: MIT
"""Results of a problem in one folder: fields for ParaView and a table, written while it runs."""

import os
import re
from collections.abc import Mapping
from pathlib import Path

from ufl.core.expr import Expr

from ..base.collective import on_first_rank
from ..base.errors import ContactInputError
from ..base.validators import instance, number
from ..files.bulk_fields import BulkFields
from ..files.fields import ContactFields
from ..files.reading import BODIES, BULK, TABLE
from ..files.series import FieldSeries, file_name
from ..files.step_table import StepTable
from ..increment.report import BodyReport, ContactReport, StepReport
from ..problem import FrictionalContactProblem
from .energy import EnergyBalance


class Results:
    """Writes each accepted step into a folder.

    Give it to the stepper, or call :meth:`write` after each step::

        results = ff.Results(problem, "results", fields={"von_mises": von_mises})
        ff.LoadStepper(problem, loads, end=1.0, step=0.1, results=results).run()

    ``bulk.pvd`` holds displacement and ``fields``, and a file for each contact, named as its
    surface, the :class:`~fenicsx_friction.ContactFields`; ParaView and pyvista open them.
    ``contacts.csv`` has a row for each step and contact: states, force and normal force (N), moment
    (N m), frictional work (J), penetration (m), iterations, the certificate's relative residual,
    and, with an audit, the energies (J) of the step of the whole problem. ``bodies.csv`` has the
    translation (m), rotation (rad), force (N) and moment (N m) of each
    :class:`~fenicsx_friction.RigidBody`.

    All files can be read at any moment. The first step that is written drops what they hold of this
    and later steps: a run that goes on from a checkpoint continues them, a new one begins anew.

    Args:
        problem: The problem.
        folder: The folder; is made.
        fields: Further fields of the bulk: Functions and UFL expressions on the mesh of ``u``, by
            name. Lagrange ones of the degree of ``u`` are written at the nodes, others at the
            midpoints of the cells.

    Attributes:
        folder: As given.

    Raises:
        ContactInputError: On all ranks, for an argument that is not possible.
    """

    def __init__(
        self,
        problem: FrictionalContactProblem,
        folder: str | os.PathLike[str],
        *,
        fields: Mapping[str, Expr] | None = None,
    ) -> None:
        instance(problem, FrictionalContactProblem, "problem", "a FrictionalContactProblem")
        if not isinstance(folder, str):
            instance(folder, os.PathLike, "folder", "the name of a folder")
        self.problem, self.folder = problem, Path(folder)
        self._bulk = BulkFields(problem, {} if fields is None else fields)
        self._contacts = [ContactFields(problem, k) for k in problem.contacts]
        comm = problem.comm
        on_first_rank(comm, self._make_folder)
        d = problem.u.function_space.mesh.geometry.dim
        self._tables = [StepTable(self.folder / TABLE, _columns(d), comm, "folder")]
        if problem.bodies:
            columns = _columns_of_bodies(d)
            self._tables.append(StepTable(self.folder / BODIES, columns, comm, "folder"))
        names = _names([BULK, *(k.surface.name for k in problem.contacts)])
        self._series = [FieldSeries(self.folder, name, comm) for name in names]
        self._started = False

    def check(self, problem: FrictionalContactProblem) -> None:
        """Raise a ContactInputError unless these are results of the problem."""
        if self.problem is not problem:
            raise ContactInputError(
                f"results = {self!r} are those of another problem; give Results(problem, folder)."
            )

    def write(self, time: float, report: StepReport, energy: EnergyBalance | None = None) -> None:
        """Write the last accepted step; collective.

        Args:
            time: The time at its end.
            report: Its report.
            energy: Its energy balance.

        Raises:
            ContactInputError: On all ranks, if no step was accepted, or a file cannot be written.
        """
        time = number(time, "time")
        instance(report, StepReport, "report", "the StepReport of the last accepted step")
        if not self._started:
            for table in self._tables:
                table.start(report.step)
            for series in self._series:
                series.start(report.step)
            self._started = True
        self._bulk.update()
        for fields in self._contacts:
            fields.update()
        parts = [self._bulk.functions, *(k.scalars + k.vectors for k in self._contacts)]
        for series, functions in zip(self._series, parts, strict=True):
            series.write(report.step, time, functions)
        rows = [[_row(time, report, k, energy) for k in report.contacts]]
        rows.append([_row_of_body(time, report, body) for body in report.bodies])
        for file, found in zip(self._tables, rows, strict=False):
            file.write(found)

    def _make_folder(self) -> None:
        """Make the folder, or say why it cannot be used."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ContactInputError(
                f"folder = '{self.folder}' cannot be made: {error}. Give another name."
            ) from error


def _columns(d: int) -> list[str]:
    """Return the columns of the table in 2D or 3D."""
    axes = "xyz"[:d]
    return [
        *("step", "time", "contact", "open", "stick", "slip"),
        *(f"force_{x}" for x in axes),
        "normal_force",
        *(f"moment_{x}" for x in (axes if d == 3 else "z")),
        *("frictional_work", "penetration", "iterations", "certificate"),
        *("external_work", "stored", "dissipation", "defect"),
    ]


def _columns_of_bodies(d: int) -> list[str]:
    """Return the columns of the table of rigid bodies in 2D or 3D."""
    axes, turns = "xyz"[:d], "xyz" if d == 3 else "z"
    parts = (("translation", axes), ("rotation", turns), ("force", axes), ("moment", turns))
    return ["step", "time", "body", *(f"{part}_{x}" for part, xs in parts for x in xs)]


def _row_of_body(time: float, report: StepReport, body: BodyReport) -> list[object]:
    """Return the row of a rigid body in a step."""
    values = (*body.translation, *body.rotation, *body.force, *body.moment)
    return [report.step, time, body.name, *values]


def _row(
    time: float, report: StepReport, contact: ContactReport, energy: EnergyBalance | None
) -> list[object]:
    """Return the row of a contact in a step."""
    energies: list[object] = [""] * 4
    if energy is not None:
        energies = [energy.external_work, energy.stored, energy.dissipation, energy.defect]
    return [
        *(report.step, time, contact.name, contact.open, contact.stick, contact.slip),
        *contact.force,
        contact.normal_force,
        *contact.moment,
        *(contact.dissipation, contact.penetration, report.iterations),
        report.certificate.relative,
        *energies,
    ]


def _names(given: list[str]) -> list[str]:
    """Return different names of files."""
    names: list[str] = []
    for text in given:
        name = file_name(text)
        same = sum(re.fullmatch(rf"{re.escape(name)}(_\d+)?", other) is not None for other in names)
        names.append(f"{name}_{same + 1}" if same else name)
    return names
