# SPDX-License-Identifier: MIT
"""The description on PyPI: the README, with links and pictures that work there, too."""

import re
from pathlib import Path

from setuptools import setup

REPOSITORY = "https://github.com/fenicsx-friction/fenicsx_friction"


def absolute(link: re.Match[str]) -> str:
    """Return a link to the repository in place of one inside it."""
    where = "raw" if link[1] else "blob"
    return f"{link[1]}[{link[2]}]({REPOSITORY}/{where}/main/{link[3]})"


readme = Path(__file__).with_name("README.md").read_text(encoding="utf-8")
setup(
    long_description=re.sub(r"(!?)\[([^\]]*)\]\((?![a-z]+:|#)([^)]+)\)", absolute, readme),
    long_description_content_type="text/markdown",
)
