"""Demos as scripts, and the tables that they write."""

import csv
import subprocess
import sys
from pathlib import Path

DEMOS = Path(__file__).parents[1] / "demos"


def run(script, *arguments):
    command = [sys.executable, "-W", "error", str(script), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))
