"""Sphinx configuration of the site: `python -m sphinx -W -b html docs build/site`, from the folder of the clone.

The pages are those that are read in the repository. What only the site has is made while it is built, in `site_pages`.
"""

import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from refsim.core.versions import VERSION  # noqa: E402

project = "refsim"
release = version = VERSION
author = "the authors of refsim"
copyright = author

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.mathjax", "sphinx-mathjax-offline"]
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]  # pages whose first heading is followed by one of the third level
exclude_patterns = ["package.md"]  # the package index shows this page
templates_path: list[str] = []
html_theme = "furo"
html_title = f"refsim {VERSION}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["checks.js"]
html_show_sphinx = False
html_copy_source = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
nitpicky = True


def setup(app: Any) -> None:
    """Called by Sphinx."""
    import site_pages

    app.add_config_value("repository", "", "env", str)  # its address, which `scripts/release.py` gives
    app.connect("source-read", site_pages.as_on_the_site)
    app.connect("doctree-read", site_pages.readable)
    app.connect("autodoc-process-docstring", site_pages.literal_tables)
    app.connect("html-page-context", site_pages.whole_tables)
    app.connect("build-finished", site_pages.moved)
