"""The logger: a line a step, one a substep and search, quiet by default."""

import logging

from bodies import stack
from models import block


def test_steps_are_told_at_info_and_substeps_at_debug(caplog):
    model = block("hexahedron", 0.3, "log_")
    with caplog.at_level(logging.INFO, logger="fenicsx_friction"):
        model.move(0.0, 0.0, -0.01)
        report = model.problem.solve()
    (line,) = [r.getMessage() for r in caplog.records]
    assert line.startswith(f"step 1: {report.iterations} iterations, certificate")
    caplog.clear()
    with caplog.at_level(logging.DEBUG, logger="fenicsx_friction"):
        model.move(0.01, 0.0, -0.01)
        report = model.problem.solve()
    lines = [r.getMessage() for r in caplog.records]
    assert len(lines) == len(report.substeps) + 1
    assert lines[0].startswith("stick: ") and "projection: " in lines[1]


def test_searches_are_told(caplog):
    sliding = {
        "cell": "quadrilateral",
        "upper": (4, 2),
        "lower": (8, 2),
        "top": ((0.0, 1.0), (0.5, 1.5)),
        "base": ((0.0, 0.0), (2.0, 1.0)),
    }
    model = stack(0.0, "log_search_", **sliding)
    model.move(0.0, -0.01)
    model.problem.solve()
    model.move(0.6, -0.01)
    with caplog.at_level(logging.DEBUG, logger="fenicsx_friction"):
        assert model.problem.solve().certified
    assert any(r.getMessage().startswith("search 1: ") for r in caplog.records)


def test_nothing_is_told_by_default(capfd):
    model = block("hexahedron", 0.3, "quiet_")
    model.move(0.0, 0.0, -0.01)
    model.problem.solve()
    assert capfd.readouterr() == ("", "")
