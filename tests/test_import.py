"""Importing the package is cheap, and says what is missing."""

import os
import subprocess
import sys

import pytest

#: What is imported when it is used: half a second of CPU time together, or more.
HEAVY = {
    "gmsh",
    "h5py",
    "matplotlib",
    "meshio",
    "pyvista",
    "rich",
    "scipy.linalg",
    "scipy.sparse",
    "scipy.spatial",
    "vtkmodules",
    "fenicsx_friction.verification.exact",
}
#: Stand-ins of what the package needs, in versions and builds that will not do.
OLD = {"dolfinx": "__version__ = '0.10.0'\n", "petsc4py": "class PETSc: pass\n"}
REAL = "import numpy\nclass PETSc: ScalarType = numpy.{}\n"
WRONG = {
    r"needs DOLFINx >= 0.11 with PETSc .*No module named": {"dolfinx": "import nowhere\n"},
    r"needs DOLFINx >= 0.11 and found 0.10.0 in /": OLD,
    r"real scalars of double precision, and found complex128.* petsc=\*=real": {
        "dolfinx": "__version__ = '0.12.0.dev0'\n",
        "petsc4py": REAL.format("complex128"),
    },
    r"and found float32": {
        "dolfinx": "__version__ = '0.11.1'\n",
        "petsc4py": REAL.format("float32"),
    },
    r"needs a DOLFINx that was built with petsc4py": {
        "dolfinx": "__version__ = '0.11.0'\nhas_petsc4py = False\n",
        "petsc4py": REAL.format("float64"),
    },
}


def python(code, **environment):
    command = [sys.executable, "-W", "error", "-c", code]
    environment = os.environ | environment
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


@pytest.mark.quick
def test_import_leaves_heavy_modules_for_later():
    code = "import sys, {}; print(*sys.modules)"
    base, package = (
        python(code.format(name)) for name in ("dolfinx.fem.petsc", "fenicsx_friction")
    )
    assert package.returncode == 0, package.stderr
    added = set(package.stdout.split()) - set(base.stdout.split())
    assert "fenicsx_friction.problem" in added
    assert added & HEAVY == set()


@pytest.mark.quick
@pytest.mark.parametrize("message", WRONG)
def test_what_is_missing_is_told_at_import(message, tmp_path):
    for name, content in WRONG[message].items():
        (tmp_path / f"{name}.py").write_text(content)
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    found = python("import fenicsx_friction", PYTHONPATH=path)
    assert found.returncode == 1
    last = found.stderr.splitlines()[-1]
    assert last.startswith("ImportError: fenicsx_friction needs")
    with pytest.raises(ImportError, match=message):
        raise ImportError(last)
