# SPDX-License-Identifier: MIT
"""What the pages need before Sphinx reads them: demos that have run, links, one file of MathJax.

The files in docs/ read well on the repository's pages, too. Here their links out of the folder
become pages of this site or addresses in the repository, and their pictures those of this build.
"""

import hashlib
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jupytext
import tomllib
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util import logging

HERE = Path(__file__).parent
ROOT = HERE.parent
RUNS = HERE / "_build" / "runs"
MATHJAX = Path("/usr/share/nodejs/mathjax-full/es5/tex-svg.js")
URLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"]
#: Names of types as the sources import them, and in the inventories.
TYPES = {
    "mesh.Mesh": "dolfinx.mesh.Mesh",
    "mesh.MeshTags": "dolfinx.mesh.MeshTags",
    "fem.Function": "dolfinx.fem.Function",
    "Axes": "matplotlib.axes.Axes",
    "Folder": "os.PathLike",
}
say = logging.getLogger(__name__).info


def digest(*texts: bytes) -> str:
    """Return a name for a content."""
    return hashlib.sha256(b"\0".join(texts)).hexdigest()[:16]


def sources(*folders: str) -> str:
    """Return a name for all modules in some folders that scripts import."""
    return digest(
        *(
            path.read_bytes()
            for folder in folders
            for path in sorted((ROOT / folder).rglob("*.py"))
            if not path.name.startswith(("demo_", "test_"))
        )
    )


#: What demos import; what executed pages import.
OF_DEMOS = sources("fenicsx_friction", "demos", "meshes")
OF_PAGES = sources("fenicsx_friction", "demos", "tests")


@dataclass(frozen=True)
class Demo:
    """A demo that the build runs: one entry of tutorials.toml.

    Attributes:
        name: Name of the script.
        gallery: The gallery that shows it.
        question: What people ask whom it answers.
        summary: One sentence for the gallery.
        arguments: Of the command line.
        pictures: Of each, the file, the caption, and its name in docs/images if it is there, too.
    """

    name: str
    question: str
    summary: str
    pictures: list[dict[str, str]]
    gallery: str = "tutorials"
    arguments: tuple[str | int | float, ...] = ()

    @property
    def script(self) -> Path:
        """The script."""
        return ROOT / "demos" / f"{self.name}.py"

    @property
    def folder(self) -> Path:
        """Where its results are, another one for each version of demo and package."""
        words = " ".join(map(str, self.arguments)).encode()
        return RUNS / f"{self.name}-{digest(OF_DEMOS.encode(), self.script.read_bytes(), words)}"

    @property
    def address(self) -> str:
        """Its page."""
        return f"/tutorials/{self.name}"

    def run(self) -> None:
        """Run it, unless the results are there."""
        folder = self.folder
        done = folder / "output.txt"
        if done.exists():
            return
        for old in RUNS.glob(f"{self.name}-*"):
            shutil.rmtree(old)
        words = map(str, [*self.arguments, "--output", folder])
        say("running %s", self.name)
        told = subprocess.run(
            [sys.executable, "-W", "error", self.script, *words],
            capture_output=True,
            text=True,
            check=False,
        )
        if told.returncode != 0:
            raise ExtensionError(f"{self.name} failed:\n{told.stdout}{told.stderr}")
        done.write_text(told.stdout.replace(str(folder), "results"))

    def figure(self, picture: dict[str, str]) -> str:
        """Return a picture with its caption."""
        path, caption = self.path(picture), picture["caption"]
        return f":::{{figure}} {path}\n:alt: {plain(caption)}\n:width: 100%\n\n{caption}\n:::"

    def path(self, picture: dict[str, str]) -> str:
        """Return where a picture is, from docs/."""
        return f"/{(self.folder / picture['file']).relative_to(HERE).as_posix()}"

    def page(self) -> str:
        """Return the page: the script's text and code, pictures, and what it printed."""
        first, *cells = jupytext.read(self.script, fmt="py:light").cells
        intro = first.source.replace("SPDX-License-Identifier: MIT\n\n", "")
        body = [
            cell.source if cell.cell_type == "markdown" else f"```python\n{cell.source}\n```"
            for cell in cells
            if cell.source.strip()
        ]
        picture, *others = map(self.figure, self.pictures)
        source = f"Script: [{self.script.name}]({blob(f'demos/{self.script.name}')})"
        options = " ".join(map(str, self.arguments))
        told = shortened((self.folder / "output.txt").read_text())
        output = f"```text\n$ python3 demos/{self.script.name} {options}\n{told}```"
        parts = [intro, f"{source}, run by the build of this page.", picture, *body]
        return "\n\n".join([*parts, "## Output", output, *others]) + "\n"

    def card(self) -> str:
        """Return its place in a gallery."""
        title = f"{self.question}\n:link: {self.address}\n:link-type: doc"
        picture = f":img-top: {self.path(self.pictures[0])}\n:img-alt: {plain(self.question)}"
        return f":::{{grid-item-card}} {title}\n{picture}\n\n{self.summary}\n:::\n"


def plain(text: str) -> str:
    """Return a text without the marks of formulas and code."""
    return re.sub(r"[$`\\]", "", text)


def shortened(text: str, most: int = 24) -> str:
    """Return the first and last lines of a long text."""
    lines = text.splitlines()
    if len(lines) > most:
        lines = [*lines[: most // 2], "...", *lines[-most // 2 :]]
    return "".join(f"{line}\n" for line in lines)


def blob(path: str) -> str:
    """Return the address of a file or folder in the repository."""
    kind = "tree" if (ROOT / path).is_dir() else "blob"
    return f"{URLS['Repository']}/{kind}/main/{path}"


def demos() -> list[Demo]:
    """Return the demos, in their order."""
    return [Demo(**entry) for entry in tomllib.loads((HERE / "tutorials.toml").read_text())["demo"]]


def prepare(app: Sphinx) -> None:
    """Run the demos and write their pages; copy MathJax."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(Demo.run, demos()))
    for demo in demos():
        write(HERE / "tutorials" / f"{demo.name}.md", demo.page())
    (HERE / "_static" / "mathjax").mkdir(exist_ok=True)
    shutil.copy2(MATHJAX, HERE / "_static" / "mathjax")


def write(path: Path, text: str) -> None:
    """Write a page if it has changed: Sphinx reads again what is newer."""
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


def read(app: Sphinx, name: str, content: list[str]) -> None:
    """Put in what stands elsewhere: links, pictures, the gallery, the example of the README."""
    text = content[0]
    pages = {demo.script.name: f"{demo.address}.md" for demo in demos()}
    text = re.sub(r"\]\((\.\./[^)#]+)(#[^)]*)?\)", partial(link, pages, HERE / name), text)
    for demo in demos():
        for picture in demo.pictures:
            if "image" in picture:
                text = text.replace(f"](images/{picture['image']})", f"]({demo.path(picture)})")
    for gallery in ("tutorials", "paper"):
        shown = [demo for demo in demos() if demo.gallery == gallery]
        text = text.replace(f"<GALLERY {gallery}>", "\n".join(demo.card() for demo in shown))
        text = text.replace(f"<PAGES {gallery}>", "\n".join(demo.address for demo in shown))
    content[0] = re.sub(r"<README (\d+)>", lambda found: paragraphs()[int(found[1]) - 1], text)


def link(pages: dict[str, str], page: Path, found: re.Match[str]) -> str:
    """Return a link out of docs/ as one of this site, or into the repository."""
    target = (page.parent / found[1]).resolve()
    if target.is_relative_to(HERE):
        return found[0]
    if not target.exists():
        raise ExtensionError(f"{page} has a link to {target}, which does not exist.")
    address = pages.get(target.name) or blob(target.relative_to(ROOT).as_posix())
    return f"]({address}{found[2] or ''})"


def paragraphs() -> list[str]:
    """Return the paragraphs of the examples in the README, which stand between blank lines."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    return [part.strip() for block in blocks for part in re.split(r"\n\n(?=\S)", block)]


def resolve(app: Sphinx, env: Any, node: Any, contnode: Any) -> None:
    """Give a type the name that the inventories have; intersphinx looks it up after this."""
    node["reftarget"] = TYPES.get(node["reftarget"], node["reftarget"])


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the hooks."""
    app.connect("builder-inited", prepare, priority=100)
    app.connect("source-read", read)
    app.connect("missing-reference", resolve, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
