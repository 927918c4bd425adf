"""The rooms of the package stand on each other: no arrow leads up or round; all are small."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import fenicsx_friction as ff

PACKAGE = Path(ff.__file__).parent
#: From the ground up. Modules of a room may import from their own room and from those before.
ROOMS = (
    "base",
    "laws",
    "surfaces",
    "meshes",
    "obstacles",
    "certificate",
    "contact",
    "equations",
    "solvers",
    "increment",
    "problem",
    "files",
    "loading",
    "verification",
    "plot",
)
#: Rooms of one file.
FILES = ("problem", "plot")
MODULE, FUNCTION = 250, 50
TESTS, TEST_FILE = Path(__file__).parent, 400

pytestmark = pytest.mark.quick


def modules():
    """Return the parsed modules of the package by their dotted names."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        name = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = ast.parse(path.read_text())
    return found


def imports(name, tree, known):
    """Return the modules of the package that a module imports, for types only or not."""
    package = name.split(".") if name in ROOMS and name not in FILES else name.split(".")[:-1]
    found = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or node.level == 0:
            continue
        where = package[: len(package) - node.level + 1]
        target = ".".join([*where, *(node.module.split(".") if node.module else [])])
        inner = {f"{target}.{a.name}".lstrip(".") for a in node.names} & set(known)
        found |= inner or ({target} & set(known))
    return found - {"__init__"}


def arrows(trees):
    return {name: imports(name, tree, trees) for name, tree in trees.items() if name != "__init__"}


def upward(graph):
    """Return the arrows that lead to a room above."""
    floor = {room: i for i, room in enumerate(ROOMS)}
    return [
        (name, target)
        for name, targets in graph.items()
        for target in targets
        if floor[target.split(".")[0]] > floor[name.split(".")[0]]
    ]


def test_no_arrow_leads_up_and_none_goes_round():
    graph = arrows(modules())
    assert len(graph) > 60 and sum(map(len, graph.values())) > 150
    assert upward(graph) == []
    TopologicalSorter(graph).prepare()


def test_an_arrow_up_and_a_circle_are_seen():
    trees = modules()
    trees["laws.rows"].body.append(
        ast.parse("from ..increment.system import ContactSystem").body[0]
    )
    assert upward(arrows(trees)) == [("laws.rows", "increment.system")]
    trees = modules()
    guarded = "if TYPE_CHECKING:\n    from .advance import advance"
    trees["increment.snapshot"].body.append(ast.parse(guarded).body[0])
    with pytest.raises(CycleError):
        TopologicalSorter(arrows(trees)).prepare()


def test_modules_and_functions_are_short():
    long = []
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text()
        if (lines := len(text.splitlines())) > MODULE:
            long.append((str(path.relative_to(PACKAGE)), lines))
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                lines = node.end_lineno - node.lineno + 1
                if lines > FUNCTION:
                    long.append((f"{path.relative_to(PACKAGE)}: {node.name}", lines))
    assert long == []


def test_files_of_the_tests_are_short():
    files = sorted(TESTS.rglob("*.py"))
    assert Path(__file__) in files
    lines = {str(path.relative_to(TESTS)): len(path.read_text().splitlines()) for path in files}
    assert {name: n for name, n in lines.items() if n > TEST_FILE} == {}


def test_names_of_the_user_stay_where_they_are():
    for name in ff.__all__:
        assert hasattr(ff, name)
    assert ff.laws.slip_row and ff.bulk.Elastic
