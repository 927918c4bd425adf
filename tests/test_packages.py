"""sdist, wheel, recipe and environment: built, installed apart, and of one mind."""

import os
import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from shutil import copytree, ignore_patterns

import pytest
import yaml

import fenicsx_friction as ff

tomllib = pytest.importorskip("tomllib", reason="comes with Python 3.11")

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
#: Distributions that conda-forge calls otherwise, and what it needs beside those of pip.
CONDA = {"gmsh": "python-gmsh", "build": "python-build"}
ONLY_CONDA = {"c-compiler", "make", "petsc", "pip", "python"}

#: A block of one cell on a plane, of which the pressure is known: E = 1e9, nu = 0, 1 % pressed.
SOLVE = """
from mpi4py import MPI
import numpy as np, ufl
from dolfinx import fem, mesh
import fenicsx_friction as ff
msh = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
bottom = mesh.locate_entities_boundary(msh, 1, lambda x: np.isclose(x[1], 0.0))
tags = mesh.meshtags(msh, 1, bottom, 1)
V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
top.x.array[1::2] = -0.01
bc = fem.dirichletbc(top, fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1.0)))
density = ff.bulk.small_strain_energy(u, ff.bulk.Elastic(E=1e9, nu=0.0))
F = ufl.derivative(ff.bulk.stored_energy(density, ufl.dx), u, v)
floor = ff.RigidPlane((0, 0), (0, 1))
contact = ff.Contact(ff.ContactSurface(msh, tags, 1), floor, ff.Coulomb(0.3))
problem = ff.FrictionalContactProblem(
    F, u, contact=contact, bcs=[bc], petsc_options_prefix="installed_"
)
print(ff.__file__, problem.solve().contacts[0].force[1])
"""


def run(*command, **options):
    """Run a command without the sources on Python's path; return what it printed."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"NO_COLOR": "1"}
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, env=environment, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def name(requirement):
    """Return the name of a requirement of pip or conda, without versions and builds."""
    return re.match(r"[\w.-]+", requirement)[0].lower()


def extra(which):
    """Return the names of an extra, those of others that it takes in with them."""
    found = set()
    for requirement in PROJECT["optional-dependencies"][which]:
        if inner := re.fullmatch(r"fenicsx_friction\[(.*)\]", requirement):
            found |= set.union(*map(extra, inner[1].split(",")))
        else:
            found.add(name(requirement))
    return found


def on_conda(names):
    return {CONDA.get(n, n) for n in names}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The files that `make package` makes, of a copy: a build leaves folders beside the sources."""
    source, dist = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("dist")
    made = ignore_patterns(".*", "_build", "__pycache__", "*.egg-info", "build", "dist", "results")
    copytree(ROOT, source, ignore=made, dirs_exist_ok=True)
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", dist, source)
    return dist


def test_sdist_and_wheel_hold_the_package_and_nothing_else(built):
    version, package = ff.__version__, Path(ff.__file__).parent
    sources = {p.relative_to(ROOT) for p in [*package.rglob("*.py"), package / "py.typed"]}
    assert {p.name for p in built.iterdir()} == {
        f"fenicsx_friction-{version}.tar.gz",
        f"fenicsx_friction-{version}-py3-none-any.whl",
    }
    with tarfile.open(next(built.glob("*.gz"))) as sdist:
        found = {Path(*Path(m.name).parts[1:]) for m in sdist.getmembers() if m.isfile()}
    texts = ["README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff", "MANIFEST.in"]
    texts += ["pyproject.toml", "setup.py"]
    made = {p for p in found if p.parts[0].endswith(".egg-info")}
    assert found == sources | made | set(map(Path, [*texts, "PKG-INFO", "setup.cfg"]))
    with zipfile.ZipFile(next(built.glob("*.whl"))) as wheel:
        inside = {Path(n) for n in wheel.namelist()}
    assert {p for p in inside if ".dist-info" not in p.parts[0]} == sources


def test_descriptions_are_accepted(built):
    pytest.importorskip("twine")
    told = run(sys.executable, "-m", "twine", "check", "--strict", *built.iterdir())
    assert told.count("PASSED") == 2


def test_links_of_the_description_work_outside_the_repository(built):
    """Each target is a place in the repository that exists here."""
    with zipfile.ZipFile(next(built.glob("*.whl"))) as wheel:
        (metadata,) = (n for n in wheel.namelist() if n.endswith("METADATA"))
        told = wheel.read(metadata).decode()
    links = re.findall(r"(!?)\[[^\]]*\]\(([^)]+)\)", told)
    blob, raw = (f"{PROJECT['urls']['Repository']}/{part}/main/" for part in ("blob", "raw"))
    assert len(links) > 20 and any(image for image, _ in links)
    for image, target in links:
        if not target.startswith("#"):
            inside = target.removeprefix(raw if image else blob)
            assert inside != target or not target.startswith(PROJECT["urls"]["Repository"])
            assert inside == target or (ROOT / inside.partition("#")[0]).exists()
            assert target.startswith("https://")


def test_the_wheel_works_where_it_is_installed(built, tmp_path):
    """In an environment of its own, with DOLFINx from the system, without a network."""
    run(sys.executable, "-m", "venv", "--system-site-packages", "--without-pip", tmp_path / "venv")
    python = tmp_path / "venv" / "bin" / "python3"
    install = ("install", "--no-index", "--no-deps", next(built.glob("*.whl")))
    run(sys.executable, "-m", "pip", "--python", python, *install)
    (tmp_path / "solve.py").write_text(SOLVE)
    where, force = run(python, "solve.py", cwd=tmp_path).split()
    assert (tmp_path / "venv") in Path(where).parents
    assert float(force) == pytest.approx(1e7, rel=1e-9)
    told = run(python, "-c", "from importlib.metadata import *; print(version('fenicsx_friction'))")
    assert told.strip() == ff.__version__


@pytest.mark.quick
def test_versions_agree():
    recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text())
    assert recipe["context"]["version"] == ff.__version__
    assert recipe["context"]["python_min"] == PROJECT["requires-python"].removeprefix(">=")
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == ff.__version__
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest[1] == ff.__version__
    assert PROJECT["dynamic"] == ["version", "readme"] and "version" not in PROJECT


def test_addresses_agree():
    urls = PROJECT["urls"]
    recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text())["about"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert recipe["repository"] == citation["repository-code"] == urls["Repository"]
    assert recipe["homepage"] == urls["Homepage"]
    assert recipe["documentation"] == citation["url"] == urls["Documentation"]
    assert recipe["license"] == citation["license"] == PROJECT["license"]


def imported(folder):
    """Return the packages outside the standard library that the files of a folder import."""
    pattern = re.compile(r"^\s*(?:import|from) ([a-zA-Z]\w*)[\w.]*(?: import|\s*$| as|,)", re.M)
    found = {m for p in (ROOT / folder).rglob("*.py") for m in pattern.findall(p.read_text())}
    return found - sys.stdlib_module_names - {"fenicsx_friction"}


def test_dependencies_are_what_is_imported():
    module = lambda n: n.removeprefix("fenics-").replace("-", "_")  # noqa: E731
    needed = {module(name(d)) for d in PROJECT["dependencies"]}
    optional = {module(n) for n in extra("demos")}
    folders = (ROOT / folder for folder in ("demos", "benchmarks", "meshes"))
    own = {path.stem for folder in folders for path in folder.glob("*.py")}
    assert imported("fenicsx_friction") == needed | optional
    assert imported("demos") | imported("meshes") <= needed | optional | own
    tests = imported("tests") - own - {p.stem for p in (ROOT / "tests").glob("*.py")}
    assert tests - needed - {module(n) for n in extra("test")} <= {"yaml"}


def test_conda_has_what_pip_has():
    needed = {name(d) for d in PROJECT["dependencies"]}
    environment = yaml.safe_load((ROOT / "environment.yml").read_text())["dependencies"]
    listed = {name(d) for d in environment if isinstance(d, str)}
    assert listed - ONLY_CONDA == on_conda(needed | extra("test") | extra("docs"))
    recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text())["requirements"]
    assert {name(d) for d in recipe["run"]} - ONLY_CONDA == on_conda(needed)
    assert {name(d) for d in recipe["host"]} == {"python", "pip", "setuptools"}
