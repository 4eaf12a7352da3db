"""The settings of Sphinx, which makes the site from the pages of this folder: `make docs`."""

from __future__ import annotations

import sys
from pathlib import Path

import envgraph

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "envgraph"
author = "The envgraph authors"
copyright = "The envgraph authors"
version = release = envgraph.__version__

extensions = [
    "myst_parser",
    "sphinx_copybutton",
    "highlighting",
    "grammar_diagrams",
    "api_reference",
    "accessible_html",
    "built_links",
    "codes",
    "commands",
    "family_tables",
    "notebook_pages",
]
exclude_patterns = ["changes"]
source_suffix = {".md": "markdown"}
nitpicky = True

myst_enable_extensions = ["attrs_block", "attrs_inline", "colon_fence"]
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False
napoleon_use_rtype = False
python_maximum_signature_line_length = 90
toc_object_entries_show_parents = "hide"

html_theme = "furo"
html_title = "envgraph"
pygments_dark_style = "github-dark-high-contrast"
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["site.css"]
html_js_files = [("site.js", {"defer": "defer"})]
copybutton_selector = "div:not(.highlight-text):not(.wrong) > div.highlight > pre"
copybutton_exclude = ".linenos, .gp, .go"
