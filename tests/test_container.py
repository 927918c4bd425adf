"""`./container` with an engine made of a few lines of shell."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "container"

#: An image is a file; a stage lasts as long as a file "slow-..." is there; commands run right here.
BUILDAH = """#!/usr/bin/env bash
cd "$STORE"
case $1 in
  inspect) [[ -e ${!#} ]] ;;
  bud)
    while [[ $1 != -t ]]; do shift; done
    echo "bud ${2%:*}" >>calls
    while [[ -e slow-${2%:*} ]]; do sleep 0.05; done
    touch "$2" ;;
  run)
    while [[ $1 != -- ]]; do if [[ $1 == *:/cache ]]; then HOME=${1%:/cache}; fi; shift; done
    cd "$HOME"; export HOME; shift; exec "$@" ;;
esac
"""
MMDEBSTRAP = """#!/usr/bin/env bash
echo mmdebstrap >>"$STORE/calls"
touch "$TMPDIR/scratch" "${!#}"
while [[ -e $STORE/slow-mmdebstrap ]]; do sleep 0.05; done
"""


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A machine without DOLFINx and with the engine above; returns the folder of its images."""
    tools = {"buildah": BUILDAH, "mmdebstrap": MMDEBSTRAP}
    tools |= dict.fromkeys(["python3", "docker", "podman"], "#!/bin/sh\nexit 1\n")
    for name in ("bin", "store", "cache"):
        (tmp_path / name).mkdir()
    for name, text in tools.items():
        (tmp_path / "bin" / name).write_text(text)
        (tmp_path / "bin" / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("STORE", str(tmp_path / "store"))
    return tmp_path / "store"


def container(*command, script=SCRIPT):
    return subprocess.run([script, *command], capture_output=True, text=True)


def wait_for(condition):
    """Wait for what comes sooner or later; the limit of the test ends it otherwise."""
    while not condition():
        time.sleep(0.02)


def test_found_through_symlinks(tmp_path):
    (tmp_path / "a").symlink_to(SCRIPT)
    (tmp_path / "b").symlink_to("a")
    found = container(
        "python3", "-c", "import fenicsx_friction as f; print(f.__file__)", script=tmp_path / "b"
    )
    assert found.stdout.strip() == str(SCRIPT.parent / "fenicsx_friction" / "__init__.py")


COMMANDS = [(["sh", "-c", "exit 3"], 3), (["sh", "-c", "kill -KILL $$"], 137), (["nosuch"], 127)]


@pytest.mark.parametrize(("command", "status"), COMMANDS)
def test_exit_status_is_passed_on_by_an_engine(command, status, machine):
    assert container(*command).returncode == status


@pytest.mark.parametrize(("command", "status"), COMMANDS)
def test_exit_status_is_passed_on_without_one(command, status):
    """The shell's view: 128 + number of the signal."""
    shell = subprocess.run(["bash", "-c", '"$@"; exit', "-", SCRIPT, *command], capture_output=True)
    assert shell.returncode == status


BASE, IMAGE = "bud fenicsx_friction_base", "bud fenicsx_friction"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("stage", "then"),
    [("mmdebstrap", ["mmdebstrap", BASE, IMAGE]), ("fenicsx_friction", [IMAGE])],
)
def test_interrupted_build_leaves_nothing_and_continues(stage, then, number, machine, tmp_path):
    slow, calls = machine / f"slow-{stage}", machine / "calls"
    slow.touch()
    run = subprocess.Popen(
        [SCRIPT, "true"],
        stderr=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    wait_for(lambda: calls.exists() and calls.read_text().endswith(f"{stage}\n"))
    run.send_signal(number)
    assert run.wait() == 128 + number
    assert not list(machine.glob("fenicsx_friction:*"))
    assert not list(tmp_path.glob("cache/*/*/build.??????"))
    slow.unlink()
    calls.unlink()
    assert container("true").returncode == 0
    assert calls.read_text().splitlines() == then
    assert not list(tmp_path.glob("cache/*/*/build.??????"))


def test_killed_compilation_is_cleared_unless_another_container_runs(machine, tmp_path):
    assert container("true").returncode == 0
    (home,) = tmp_path.glob("cache/fenicsx_friction/*/home")
    forms = home / "fenics"
    forms.mkdir()
    whole = [forms / name for name in ("a.c", "a.c.cached", "a.so")]
    dead = [forms / name for name in ("b.c", "b.o", "c.c.cached")]
    for path in whole + dead:
        path.touch()
    other = subprocess.Popen([SCRIPT, "sh", "-c", "echo up; read line"], stdin=subprocess.PIPE,
                             stdout=subprocess.PIPE)  # fmt: skip
    assert other.stdout.readline() == b"up\n"  # alone: it has cleared them
    assert sorted(forms.iterdir()) == whole
    for path in dead:
        path.touch()  # it compiles
    assert container("true").returncode == 0
    assert sorted(forms.iterdir()) == sorted(whole + dead)
    other.communicate(b"\n")
    assert container("true").returncode == 0
    assert sorted(forms.iterdir()) == whole
