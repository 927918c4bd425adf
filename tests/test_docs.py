"""The documentation site names what there is: public names, demos, pictures."""

import importlib
import re
from pathlib import Path

import pytest

import fenicsx_friction as ff

tomllib = pytest.importorskip("tomllib")  # of Python 3.11
ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
DEMOS = tomllib.loads((DOCS / "tutorials.toml").read_text())["demo"]


def documented():
    """Return the names in the lists of the reference, and those that it describes by hand."""
    text = (DOCS / "reference" / "index.md").read_text()
    return re.findall(r"^   ~?([\w.]+)$", text, re.M) + re.findall(r"py:data:: (\w+)", text)


def test_the_reference_has_all_public_names_and_no_others():
    names = documented()
    assert len(names) == len(set(names))
    whole = {name for name in names if "." not in name}
    assert whole | {"bulk", "laws", "plot"} == set(ff.__all__)
    for module in ("bulk", "plot"):
        there = getattr(ff, module)
        public = {
            name
            for name, value in vars(there).items()
            if callable(value) and name[0] != "_" and value.__module__ == there.__name__
        }
        assert public <= {name.partition(".")[2] for name in names if name.startswith(module)}
    rows = {name.partition(".")[2] for name in names if name.startswith("laws.")}
    assert rows == set(ff.laws.__all__) - {"NORMAL_ROWS"}


@pytest.mark.parametrize("name", [name for name in documented() if "." in name])
def test_names_in_modules_exist(name):
    path, _, last = name.rpartition(".")
    module = getattr(ff, path, None) or importlib.import_module(f"fenicsx_friction.{path}")
    assert callable(getattr(module, last))


def test_every_demo_is_a_tutorial_with_pictures():
    assert {demo["name"] for demo in DEMOS} == {p.stem for p in (ROOT / "demos").glob("demo_*.py")}
    shown = {picture.get("image") for demo in DEMOS for picture in demo["pictures"]} - {None}
    assert all((DOCS / "images" / name).exists() for name in shown)
    assert all(demo["pictures"] for demo in DEMOS)


def test_links_out_of_the_folder_lead_somewhere():
    for page in DOCS.glob("*.md"):
        for target in re.findall(r"\]\((\.\./[^)#]+)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name}: {target}"
