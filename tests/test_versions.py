"""What a report of a bug needs: versions, and the background of a failed step."""

import pickle
import platform
import re
from importlib import metadata

from mpi4py import MPI

import dolfinx
import pytest

import fenicsx_friction as ff
from fenicsx_friction.base.versions import installed, mumps_version, versions, versions_line
from fenicsx_friction.increment.background import background
from models import block, raous

pytestmark = pytest.mark.quick


@pytest.mark.mpi
def test_versions_are_told_once(capsys):
    ff.show_versions()
    text = capsys.readouterr().out
    if MPI.COMM_WORLD.rank:
        assert text == ""
        return
    told = dict(line.split(maxsplit=1) for line in text.splitlines())
    assert told == versions()
    assert told["fenicsx_friction"] == ff.__version__
    assert told["DOLFINx"].startswith(dolfinx.__version__)
    assert told["scipy"] == metadata.version("scipy")
    assert told["Python"] == platform.python_version()
    assert re.fullmatch(r"3\.\d+\.\d+, float64, int(32|64)", told["PETSc"])
    assert re.fullmatch(r"\D+ v?\d+\.\d+.*, \d+ ranks", told["MPI"])
    assert told["MPI"].endswith(f"{MPI.COMM_WORLD.size} ranks")
    assert ff.__version__ in versions_line() and "\n" not in versions_line()


def test_what_is_not_installed_has_no_version():
    assert installed("numpy") == metadata.version("numpy")
    assert installed("no_such_package") == "-"
    assert installed("this") == "installed"  # a module without metadata, as some packagers make


def test_mumps_is_read_from_the_header_of_petsc(tmp_path):
    """Written as PETSc's configure writes it, with the macros that compare versions."""
    (tmp_path / "include").mkdir()
    (tmp_path / "include" / "petscpkg_version.h").write_text(
        "#define PETSC_PKG_MUMPS_VERSION_MAJOR 5\n#define PETSC_PKG_MUMPS_VERSION_MINOR 8\n"
        "#define PETSC_PKG_MUMPS_VERSION_SUBMINOR 1\n#define PETSC_PKG_MUMPS_VERSION_ PETSC_PKG\n"
        "      ((PETSC_PKG_MUMPS_VERSION_MAJOR    == (MAJOR)) &&      \\\n"
        "#define PETSC_PKG_PTSCOTCH_VERSION_MAJOR 7\n"
    )
    assert mumps_version([tmp_path / "elsewhere", tmp_path]) == "5.8.1"
    assert mumps_version([tmp_path / "elsewhere"]) == "yes"


def unheld(prefix):
    """Return a problem whose body may float sideways: no step has a solution."""
    model = raous(2, 2, 0.0, prefix)
    contact = ff.Contact(model.contact.surface, ff.RigidPlane((0, 0), (0, 1)), ff.Coulomb(0.25))
    model.load(3.0, 1.0)
    residual = model.problem.bulk
    return ff.FrictionalContactProblem(
        residual, model.problem.u, contact=contact, petsc_options_prefix=prefix + "loose_"
    )


def check(failure, *facts):
    """Check that a failure begins with what went wrong and ends with one background."""
    text, background = str(failure), failure.background
    assert text == f"{failure.message}\n{background}"
    assert background.count("\n") <= 6 and max(map(len, background.splitlines())) < 250
    assert text.count("For a report") == text.count(versions_line()) == 1
    assert f"{MPI.COMM_WORLD.size} ranks" in background
    assert "write_checkpoint" in background
    assert [fact for fact in facts if fact not in background] == []
    assert len(set(MPI.COMM_WORLD.allgather(text))) == 1  # on each rank
    copy = pickle.loads(pickle.dumps(failure))
    assert str(copy) == text and copy.message == failure.message


@pytest.mark.mpi
def test_failed_step_ends_with_its_background():
    problem = unheld("background_")
    with pytest.raises(ff.StepFailed, match=r"^Step 1 has no certified solution") as failed:
        problem.solve()
    check(
        failed.value,
        "4 cells, 18 displacements",
        "P 1 on quadrilateral",
        "bulk linear in u",
        "solver 'auto', linear solver direct, corrector 'projection'",
        "contact 'contact': 3 nodes, RigidPlane",
        "Coulomb(mu=0.25, ",
    )


@pytest.mark.mpi
def test_failed_path_ends_with_the_background_of_its_last_attempt():
    problem = unheld("path_background_")
    stepper = ff.LoadStepper(problem, lambda t: None, end=1.0, step=1.0, smallest=0.4)
    with pytest.raises(ff.StepperFailed, match=r"^No step from time 0 was accepted") as failed:
        stepper.run()
    check(failed.value, "4 cells")
    assert all("For a report" not in f.reason for f in failed.value.failed)


@pytest.mark.mpi
def test_background_tells_strains():
    model = block("hexahedron", 0.3, "strain_background_", energy="finite")
    assert "bulk not linear in u" in (told := background(model.problem))
    assert "u: P 1 on hexahedron" in told


def test_failure_without_background_is_its_message():
    error = ff.StepFailed("made", None)
    assert str(error) == "made" == error.message
