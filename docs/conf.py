# SPDX-License-Identifier: MIT
"""Sphinx builds the documentation from this: ``make docs``."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
# Executed pages import demos, meshes and the references of the tests as scripts of the project do.
PATHS = [str(ROOT / folder) for folder in (".", "demos", "meshes", "tests")]
sys.path[:0] = [str(HERE), *PATHS]
os.environ["PYTHONPATH"] = os.pathsep.join([*PATHS, os.environ.get("PYTHONPATH", "")])

from pages import OF_PAGES, URLS

os.environ["MATPLOTLIBRC"] = str(ROOT / "demos")  # one look of all pictures

import fenicsx_friction

project, author = "fenicsx_friction", "The fenicsx_friction authors"
version = release = fenicsx_friction.__version__
project_copyright = author
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinxcontrib.bibtex",
    "pages",
]
exclude_patterns = ["_build", "_inventories/README.md"]
nitpicky = True
# The inventory of NumPy does not call them classes.
nitpick_ignore = [("py:class", "numpy.int64"), ("py:class", "numpy._typing.ArrayLike")]
# What obstacles say to each other is no public name.
nitpick_ignore_regex = [("py:class", r"fenicsx_friction\.(obstacles|surfaces)\.\w+\.\w+")]

# Text
myst_enable_extensions = ["attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "unsrt"
copybutton_prompt_text = "$ "

# Executed pages: again whenever the package has changed
nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE / "_build" / "executed" / OF_PAGES)
nb_execution_timeout = 300
nb_execution_show_tb = nb_execution_raise_on_error = True
nb_merge_streams = True

# Reference
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_preserve_defaults = True
autosummary_ignore_module_all = False
napoleon_numpy_docstring = False
napoleon_use_ivar = True  # properties that are described beside appear once
templates_path = ["_templates"]
INVENTORIES = {
    "python": "https://docs.python.org/3",
    "numpy": "https://numpy.org/doc/stable",
    "matplotlib": "https://matplotlib.org/stable",
    "scipy": "https://docs.scipy.org/doc/scipy",
    "petsc4py": "https://petsc.org/release/petsc4py",
    "mpi4py": "https://mpi4py.readthedocs.io/en/stable",
    "dolfinx": "https://docs.fenicsproject.org/dolfinx/v0.11.0/python",
    "ufl": "https://docs.fenicsproject.org/ufl/2026.1.0",
}
intersphinx_mapping = {k: (url, f"_inventories/{k}.inv") for k, url in INVENTORIES.items()}

# Pages
html_theme = "sphinx_book_theme"
html_context = {"default_mode": "auto"}
html_title = "fenicsx_friction"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {
    "repository_url": URLS["Repository"],
    "use_repository_button": True,
    "use_issues_button": True,
    "use_download_button": False,
    "show_toc_level": 2,
}
mathjax_path = "mathjax/tex-svg.js"
