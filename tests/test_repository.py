"""Workflows, hooks and templates call what is there."""

import json
import os
import re
import subprocess
from pathlib import Path

import pytest
import yaml

import fenicsx_friction as ff

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))


def load(path):
    """Return a YAML file; the key ``on`` is no truth value here."""
    return yaml.load(path.read_text(), Loader=yaml.BaseLoader)


def targets():
    makefile = (ROOT / "Makefile").read_text()
    return set(re.findall(r"^([a-z][a-z-]*):", makefile, re.MULTILINE))


def jobs():
    return {f"{p.stem}/{name}": job for p in WORKFLOWS for name, job in load(p)["jobs"].items()}


def commands(job):
    """Return the lines that a job runs, for each value of its matrix."""
    lines = [line.strip() for step in job["steps"] for line in step.get("run", "").splitlines()]
    for key, values in job.get("strategy", {}).get("matrix", {}).items():
        if key not in ("include", "exclude"):
            place = f"${{{{ matrix.{key} }}}}"
            lines = [line.replace(place, v) for line in lines for v in values]
    return lines


@pytest.mark.quick
def test_jobs_call_targets_and_files_that_are_there():
    lines = [line for job in jobs().values() for line in commands(job)]
    called = {line.split()[1] for line in lines if line.startswith("make ")}
    assert {"weekly", "benchmarks", "serial", "ranks", "lint", "package"} <= called
    later = set() if (ROOT / "docs" / "conf.py").exists() else {"docs"}
    assert called <= targets() | later and ".ci/run" in lines
    files = {word for line in lines for word in re.findall(r"\bfenicsx_friction/[\w/]+\.\w+", line)}
    given = {s["with"]["environment-file"] for j in jobs().values() for s in j["steps"]
             if "environment-file" in s.get("with", {})}  # fmt: skip
    assert given == {"environment.yml"} and files == {"fenicsx_friction/base/version.py"}
    assert [path for path in files | given | {".ci/run"} if not (ROOT / path).is_file()] == []


def test_ci_runs_the_command_of_the_readme():
    assert "\nmake test </dev/null\n" in (ROOT / ".ci" / "run").read_text()
    assert "make test " in (ROOT / "README.md").read_text()
    command = ["make", "-n", "check", "RUN="]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True).stdout
    assert [run.count(part) for part in ("ruff check .", "mypy", "not weekly", "-m mpi")] == [1] * 4


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.stem)
def test_workflows_ask_for_little(path):
    workflow = load(path)
    assert workflow["permissions"] == {"contents": "read"}
    for name, job in workflow["jobs"].items():
        assert "timeout-minutes" in job, name
        for step in job["steps"]:
            action, _, version = step.get("uses", "@").partition("@")
            # A major version of who is known; dependabot raises it.
            assert version in ("", "release/v1") or re.fullmatch(r"v\d+", version), action
            if action == "actions/checkout":
                assert step["with"]["persist-credentials"] == "false"
    write = {name: job["permissions"] for name, job in jobs().items() if "permissions" in job}
    assert write == {
        "docs/deploy": {"pages": "write", "id-token": "write"},
        "release/pypi": {"id-token": "write"},
        "release/github": {"contents": "write"},
    }


def test_the_hook_is_make_lint():
    (repository,) = load(ROOT / ".pre-commit-config.yaml")["repos"]
    (hook,) = repository["hooks"]
    assert hook["entry"] == "make lint" and hook["pass_filenames"] == "false"


def test_a_tag_is_compared_with_the_version():
    """What the workflow of releases runs, for the right tag and for a wrong one."""
    (line,) = [c for c in commands(jobs()["release/build"]) if c.startswith("test ")]
    for tag, expected in ((f"v{ff.__version__}", 0), ("v0.0.1", 1)):
        environment = os.environ | {"GITHUB_REF_NAME": tag}
        done = subprocess.run(["sh", "-c", line], cwd=ROOT, env=environment, check=False)
        assert done.returncode == expected


def test_forms_of_issues_are_whole():
    assert {p.stem for p in FORMS} == {"bug", "config", "law", "question"}
    for path in FORMS:
        form = load(path)
        if path.stem == "config":
            continue
        assert {"name", "description", "body"} <= set(form)
        ids = [part["id"] for part in form["body"] if part["type"] != "markdown"]
        assert len(set(ids)) == len(ids) > 0
        assert all(part["attributes"]["label"] for part in form["body"] if "id" in part)
    assert "show_versions()" in (ROOT / ".github" / "ISSUE_TEMPLATE" / "bug.yml").read_text()


def test_the_development_container_is_the_image():
    folder = ROOT / ".devcontainer"
    config = json.loads((folder / "devcontainer.json").read_text())
    assert (folder / config["build"]["dockerfile"]).resolve() == ROOT / "Dockerfile"
    assert (folder / config["build"]["context"]).resolve() == ROOT


def test_the_paper_cites_what_it_lists():
    folder = ROOT / "paper"
    cited = set(re.findall(r"@(\w+)", (folder / "paper.md").read_text()))
    listed = re.findall(r"^@\w+\{(\w+),", (folder / "paper.bib").read_text(), re.MULTILINE)
    assert cited == set(listed) and len(listed) == len(cited) > 8
