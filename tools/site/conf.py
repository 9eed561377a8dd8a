"""Sphinx's settings; `python -m tools.site` names this folder."""

from __future__ import annotations

import srprov

project = "srprov"
author = "The srprov authors"
version = release = srprov.__version__
root_doc = "README"
extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
myst_heading_anchors = 4  # as GitHub has them: pages link to `page.md#a-heading`
highlight_language = "text"
html_theme = "furo"
html_title = f"srprov {version}"
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
suppress_warnings = [
    "myst.header",  # a page may begin a list of details at any depth
    "misc.highlighting_failure",  # examples are shortened with …, which no lexer knows
]
