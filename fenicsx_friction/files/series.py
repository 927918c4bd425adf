# SPDX-License-Identifier: MIT
"""Series of fields in time for ParaView and pyvista, readable at any moment.

DOLFINx' ``VTKFile`` writes the fields of a step; the collection that names all steps is replaced as
a whole after that. So a killed run leaves a collection of whole files.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from mpi4py import MPI

from dolfinx import fem
from dolfinx.io import VTKFile

from ..base.atomic_file import replace_file
from ..base.collective import on_first_rank
from ..base.errors import ContactInputError

#: The files of a step in the folder of the series; VTKFile adds ``000000`` and the ending.
STEP_FILE = "step_{}_"


def file_name(text: str) -> str:
    """Return a name for files: letters, digits and underscores."""
    return re.sub(r"\W+", "_", text) or "_"


class FieldSeries:
    """Fields of many steps: ``name.pvd``, and the steps in the folder ``name`` beside it.

    Args:
        folder: The folder of the collection; must exist.
        name: Name of the series.
        comm: The ranks that write, each its part.
    """

    def __init__(self, folder: Path, name: str, comm: MPI.Intracomm) -> None:
        self.path, self._folder, self._comm = folder / f"{name}.pvd", folder / name, comm
        self._entries: list[tuple[int, float, str]] = []  # rank 0

    def start(self, first: int) -> None:
        """Keep the steps before the first to come, or start anew; collective."""

        def work() -> None:
            self._folder.mkdir(exist_ok=True)
            if first > 1 and self.path.exists():
                self._entries = [e for e in _entries(self.path) if e[0] < first]

        on_first_rank(self._comm, work)

    def write(self, step: int, time: float, functions: Sequence[fem.Function]) -> None:
        """Write fields of one mesh: Lagrange ones of one degree, and constants of the cells."""
        stem = self._folder / STEP_FILE.format(step)
        with VTKFile(self._comm, stem.with_suffix(".pvd"), "w") as file:
            file.write_function(list(functions), time)
        del file  # it writes its collection of this one step once more
        self._comm.barrier()  # all parts are written

        def publish() -> None:
            stem.with_suffix(".pvd").unlink(missing_ok=True)
            written = f"{self._folder.name}/{stem.name}000000.pvtu"
            self._entries.append((step, time, written))
            replace_file(self.path, _collection(self._entries))

        on_first_rank(self._comm, publish)


def _collection(entries: Sequence[tuple[int, float, str]]) -> bytes:
    """Return a ParaView data file that names the files of all steps."""
    root = ElementTree.Element("VTKFile", type="Collection", version="1.0")
    parts = ElementTree.SubElement(root, "Collection")
    for _, time, file in entries:
        ElementTree.SubElement(parts, "DataSet", timestep=repr(time), part="0", file=file)
    ElementTree.indent(root)
    return ElementTree.tostring(root, xml_declaration=True)


def _entries(path: Path) -> list[tuple[int, float, str]]:
    """Read step, time and file of each entry of a collection that this module wrote."""
    pattern = re.compile(STEP_FILE.format(r"(\d+)"))
    found = []
    try:
        for entry in ElementTree.parse(path).iter("DataSet"):
            file, match = entry.attrib["file"], pattern.search(entry.attrib["file"])
            if match is None:
                raise ValueError(f"it names '{file}'")
            found.append((int(match[1]), float(entry.attrib["timestep"]), file))
    except (ElementTree.ParseError, KeyError, ValueError) as error:
        raise ContactInputError(
            f"'{path}' cannot be continued, it is no such file of results: {error}. Give another "
            "folder, or remove the file."
        ) from error
    return found
